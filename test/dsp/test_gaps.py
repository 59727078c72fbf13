"""Lost chirps: filled in from the others, and said when that is a guess."""

import math

import numpy as np
import pytest
from echoes import amplitude_for, echo, frame, noise
from hypothesis import given, settings
from hypothesis import strategies as st
from losses import draw, numbers, radar, tones
from oracles import gaps as oracle

from radar_core import DataError, Quality, RadarFrame, RadarInfo, known_symbols
from radar_core.cloud import ARRAY_FIELDS
from radar_dsp import Baseband, BasebandConfig, SpectrumConfig
from radar_dsp.gaps import LOADING, Gaps, autoregressive, cubic, longest_gap, usable_order
from radar_dsp.spectrum import make_spectrum

INFO = RadarInfo()


@pytest.mark.parametrize("share", [0.01, 0.05, 0.2])
@pytest.mark.parametrize("n_tx", [1, 2, 3])
def test_compiled_prediction_equals_the_least_squares_it_stands_for(n_tx, share):
    """Normal equations by compiled loops against explicit matrices and lstsq: equal to a thousandth of the noise."""
    rng = np.random.default_rng([41, n_tx, round(100 * share)])
    info = radar(n_tx)
    lost = draw(info, rng, share)
    cube = (tones(info, rng) + 0.01 * noise(info, rng)).astype(np.complex64)
    cube[lost] = 0
    expected = oracle.fill_in(cube, lost, usable_order(lost), LOADING)
    np.testing.assert_allclose(autoregressive(cube, lost, lost), expected, atol=1e-5)


@settings(max_examples=40, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), share=st.floats(0.0, 0.15), n_tx=st.integers(1, 3))
def test_echoes_of_constant_speed_come_back_whole(seed, share, n_tx):
    """Without noise the prediction is exact at any speed, wherever the gaps are: to a thousandth of the echo."""
    rng = np.random.default_rng(seed)
    info = radar(n_tx)
    cube = tones(info, rng, 2)
    lost = draw(info, rng, share)
    if max(map(longest_gap, lost)) > 6:
        return
    given_cube = cube.copy()
    Gaps("autoregressive", info).process(given_cube, numbers(lost))
    np.testing.assert_array_equal(given_cube[~lost], cube[~lost])
    np.testing.assert_allclose(given_cube[lost], cube[lost], atol=3e-3)


def rise(method: str, speeds: np.ndarray, share: float, burst: int = 1) -> float:
    """By how much the floor rises beside an echo of 50 dB [dB]; cells that the echo itself fills are left out."""
    rng = np.random.default_rng(42)
    spectrum, filler = make_spectrum(SpectrumConfig(), INFO), Gaps(method, INFO)
    whole = struck = 0.0
    for speed in speeds:
        clean = echo(INFO, 2.5, speed, 0.2, 0.1, amplitude_for(50, INFO)).astype(np.complex64)
        cells = np.arange(24, 27) + round(speed * INFO.waveform.carrier / INFO.waveform.slope / 0.1)
        beside = np.abs(spectrum.process(clean)[..., cells]).max(axis=(0, 2)) ** 2 < 0.1
        cube = (clean + noise(INFO, rng)).astype(np.complex64)
        whole += np.mean((np.abs(spectrum.process(cube)[..., cells]) ** 2).mean(axis=(0, 2))[beside])
        lost = np.zeros(128, np.bool_)
        while not lost.any():
            for start in np.flatnonzero(rng.random(128) < share / burst):
                lost[start : start + burst] = True
        filler.process(cube, np.flatnonzero(lost).astype(np.uint32))
        struck += np.mean((np.abs(spectrum.process(cube)[..., cells]) ** 2).mean(axis=(0, 2))[beside])
    return 10 * math.log10(struck / whole)


@pytest.mark.parametrize("burst", [1, 8])
@pytest.mark.parametrize("fastest", [0.3, 4.0])
@pytest.mark.parametrize("share", [0.01, 0.1])
def test_the_floor_beside_a_strong_echo_stays(share, fastest, burst):
    """At most 1 dB, for single chirps and for bursts of eight, slow and fast, even with one chirp in ten lost."""
    assert rise("autoregressive", np.linspace(-fastest, fastest, 12), share, burst) < 1.0


def test_zeros_raise_the_floor_and_a_polynomial_suits_slow_echoes_only():
    """What the other choices cost at 1 %: 8 dB for zeros whatever the speed; nothing for a cubic at 0.3 m/s, over 6 dB at 4 m/s."""
    slow, fast = np.linspace(-0.3, 0.3, 12), np.array([-4.0, -3.5, 3.5, 4.0] * 3)
    assert rise("zero", slow, 0.01) > 5.0
    assert rise("zero", fast, 0.01) > 5.0
    assert rise("cubic", slow, 0.01) < 1.0
    assert rise("cubic", fast, 0.01) > 6.0


def test_cubic_is_exact_on_cubics_and_holds_at_the_ends():
    """A gap of two within a cubic; beyond the first and the last chirp, their values."""
    info = radar(1, 16)
    time = np.arange(16.0)[None, :, None, None] / 16
    cube = np.broadcast_to(1 + time - 2 * time**2 + 3j * time**3, info.cube_shape).astype(np.complex64)
    lost = np.isin(np.arange(16), [0, 5, 6, 15])[None]
    found = cubic(cube, lost, lost)
    np.testing.assert_allclose(found[1:3], cube[0, 5:7], atol=1e-5)
    np.testing.assert_array_equal(found[0], cube[0, 1])
    np.testing.assert_array_equal(found[3], cube[0, 14])


def test_a_weak_echo_beside_a_very_strong_one():
    """Coupling 90 dB above the noise, in float32: what is filled in errs by no more than the noise."""
    info = INFO
    rng = np.random.default_rng(46)
    quiet = noise(info, rng)
    strong = 3e4 * np.exp(2j * np.pi * 0.01 * np.arange(info.waveform.n_sample)).astype(np.complex64)
    cube = (quiet + strong + echo(info, 2.0, 1.0, 0.0, 0.0)).astype(np.complex64)
    lost = draw(info, rng, 0.02)
    got = cube.copy()
    Gaps("autoregressive", info).process(got, numbers(lost))
    assert np.sqrt(np.mean(np.abs((got - cube)[lost]) ** 2)) < 2.0


@pytest.mark.parametrize("modulation", ["cw", "ofdm"])
def test_other_modulations(modulation):
    """A tone has no range; an OFDM symbol has another code each time, which has to come off before and on again after."""
    info = radar(modulation=modulation, **({"chirp_duration": 16 / 1.5e9, "chirp_pause": 100e-6} if modulation == "ofdm" else {}))
    cube = tones(info, np.random.default_rng(47), 2)
    if modulation == "ofdm":
        carriers = cube * known_symbols(info.waveform)[:, :, None, :].conj()
        cube = np.fft.fft(carriers, axis=3, norm="ortho").astype(np.complex64)
    got = cube.copy()
    assert Gaps("autoregressive", info).process(got, np.array([5, 40, 41], np.uint32))
    np.testing.assert_allclose(got, cube, atol=3e-3)


def test_nothing_lost_is_bit_for_bit_what_it_was(monkeypatch):
    """Without a lost chirp the choice does not matter, and nothing of it runs."""
    given_frame = frame(INFO, noise(INFO, np.random.default_rng(48)), echo(INFO, 2.0, 1.0, 0.1, 0.0, amplitude_for(30, INFO)))
    basebands = [Baseband(BasebandConfig(spectrum=SpectrumConfig(missing=name)), INFO) for name in ("autoregressive", "cubic", "zero")]
    monkeypatch.setattr(Gaps, "process", None)
    clouds = [baseband.process(given_frame) for baseband in basebands]
    for cloud in clouds[1:]:
        for name in ARRAY_FIELDS:
            np.testing.assert_array_equal(getattr(cloud, name), getattr(clouds[0], name))


@pytest.mark.parametrize("value", [math.nan, math.inf])
def test_other_samples_have_to_be_finite(value):
    """A chirp that is there and holds a NaN is refused as ever."""
    cube = noise(INFO, np.random.default_rng(50)).astype(np.complex64)
    cube[1, 3, 2, 5] = value
    with pytest.raises(DataError, match="cube"):
        Baseband(BasebandConfig(), INFO).process(RadarFrame(cube, 0, 0, "radar", np.array([0, 50], np.uint32)))


@pytest.mark.parametrize(
    ("lost", "expected"),
    [
        (np.arange(0, 32), Quality.GOOD),  # sixteen of each transmitter in a row: a quarter
        (np.arange(0, 34), Quality.INCOMPLETE),
        (np.arange(0, 128, 2), Quality.INCOMPLETE),  # all of one transmitter
        (np.arange(0, 128, 4), Quality.GOOD),  # every second chirp of one transmitter
        (np.arange(128), Quality.INCOMPLETE | Quality.NO_SIGNAL),
    ],
)
def test_a_frame_that_lost_too_much_says_so(lost, expected):
    """More than a quarter of a transmitter's chirps in a row, or more than half of them in all."""
    cube = noise(INFO, np.random.default_rng(51)).astype(np.complex64)
    cloud = Baseband(BasebandConfig(), INFO).process(RadarFrame(cube, 0, 0, "radar", lost.astype(np.uint32)))
    assert cloud.quality == Quality.MISSING_CHIRPS | expected
