"""Register words of the three radio chips: those that were seen, and what the formulas promise for all others."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from radar_core import ConfigError
from radar_driver.tinyrad import registers

RECEIVER = "00000003 00020006 20001499 40001499 60001499 80001499 A0000019 80007CA0"
TRANSMITTER = (
    "03000007 1FFFFFEA 2A20B929 40003E88 809FE520 011F4827 00000006 01E28005 00200004 01890803 00020642 FFF5EC81 809FE700",
    "809FE560 809FED60",
    "809FE5A0 809FF5A0",
    "2800B929 809F2560",
)
SWEEPS = {
    128e-6: "00100007 00000406 0080040E 0030A005 00C813DD 00980104 00980144 00020843 04408192 00000001 803C0000",
    64e-6: "00100007 00000206 0080040E 0038A005 00D009ED 00980104 00980144 00020843 04408192 00000001 803C0000",
}


def text(words):
    return " ".join(f"{word:08X}" for word in words)


def test_receiver_words():
    """All receivers on, as captured from a real board; and which bits each receiver has."""
    assert text(registers.receiver()) == RECEIVER
    assert [f"{registers.receiver((k,))[-1]:08X}" for k in (1, 2, 3, 4)] == ["80000CA0", "800014A0", "800024A0", "800044A0"]


def test_transmitter_words():
    """Power 100 with the first transmitter; the words that change with power 80, the second transmitter, and none."""
    assert tuple(map(text, registers.transmitter(100))) == TRANSMITTER
    assert f"{registers.transmitter(80)[0][11]:08X}" == "FFF5EA01"
    assert f"{registers.transmitter(100, 2)[3][1]:08X}" == "809F25A0"
    assert f"{registers.transmitter(100, 0)[3][1]:08X}" == "809F2520"


@pytest.mark.parametrize("ramp", SWEEPS)
def test_synthesiser_words(ramp):
    """24.00 to 24.25 GHz in 128 and in 64 microseconds."""
    assert text(registers.synthesiser(24.0e9, 250e6, ramp)) == SWEEPS[ramp]


@given(power=st.integers(0, 255), tx=st.integers(0, 2))
def test_only_power_and_transmitter_change_the_transmitter(power, tx):
    """Against power 100 and the first transmitter: bits 5 to 12 of register 1, bits 6 and 7 of the last word."""
    flat = [word for group in registers.transmitter(power, tx) for word in group]
    seen = [int(word, 16) for group in TRANSMITTER for word in group.split()]
    changed = {i: a ^ b for i, (a, b) in enumerate(zip(flat, seen, strict=True)) if a != b}
    assert set(changed) <= {11, len(flat) - 1}
    assert changed.get(11, 0) & ~(0xFF << 5) == 0
    assert flat[11] >> 5 & 0xFF == power
    assert flat[-1] >> 6 & 3 == {0: 0, 1: 1, 2: 2}[tx]


@given(start=st.floats(24.0e9, 24.2e9), bandwidth=st.floats(10e6, 250e6), ramp=st.integers(16, 1000))
def test_words_describe_the_sweep_that_was_asked_for(start, bandwidth, ramp):
    """Decode the fields as the data sheet says: start, steps and slope come back."""
    words = {}
    for word in registers.synthesiser(start, bandwidth, ramp * 1e-6):
        words.setdefault(word & 7, []).append(word)
    divider = (words[0][0] >> 15 & 0xFFF) + ((words[0][0] >> 3 & 0xFFF) << 13 | words[1][0] >> 15 & 0x1FFF) / 2**25
    # The fraction has 25 bits of twice the comparison frequency: half a step is 3 Hz.
    assert divider * 200e6 == pytest.approx(start, abs=3.1)
    assert words[6][0] >> 3 & 0xFFFFF == ramp
    deviation, offset = words[5][0] >> 3 & 0xFFFF, words[5][0] >> 19 & 0xF
    swept = deviation * 2**offset * (100e6 / 2**25) * ramp * 2
    # The word is rounded to a multiple of 4 and lies in 4000 to 8000, or below that where the exponent is 0: 2 of 4000, or 2 steps of 3 Hz.
    assert swept == pytest.approx(bandwidth, rel=0.51e-3, abs=2 * 2 * 2.99 * ramp)
    assert registers.swept(bandwidth, ramp * 1e-6) == swept
    assert deviation <= 8000


def test_what_the_chips_cannot_do_is_refused():
    """A power beyond its bits, and a sweep too steep for the synthesiser."""
    with pytest.raises(ConfigError, match="power is 256; it has 8 bits"):
        registers.transmitter(256)
    with pytest.raises(ConfigError, match="too steep for the synthesiser"):
        registers.synthesiser(24e9, 250e6, 8e-6)
    with pytest.raises(ConfigError, match="a sweep needs more than 0"):
        registers.synthesiser(24e9, 0.0, 64e-6)
