"""Frames on the cable: the golden ones byte for byte, and what is no answer is refused."""

import struct

import pytest
from hypothesis import given
from hypothesis import strategies as st

from radar_core import ConfigError, DeviceError
from radar_driver.tinyrad import registers, wire

GOLDEN = {
    "version": (wire.VERSION, "08000e90020000000000"),
    "reset": (wire.RESET, "0c00319003000100000000000000"),
    "converter clock": (wire.CONVERTER_CLOCK, "1c0031900700010000000c00000003000000050000004c00000064000000"),
    "sizes": (wire.sizes(2, 100, 64, 2), "1c0031900700010000000200000002000000640000004000000002000000"),
    "sequence": (wire.sequence((1, 2)), "14003190050001000000030000000100000002000000"),
    "start": (wire.start(100e-6, 64), "14003190050001000000010000001027000040000000"),
    "data": (wire.get_data(32768), "14003290050001000000010000000080000000000000"),
    "receiver": (
        wire.registers(wire.Chip.RECEIVER, registers.receiver()),
        "300017900c00070000000100000000000000030000000600020099140020991400409914006099140080190000a0a07c0080",
    ),
}


@pytest.mark.parametrize("name", GOLDEN)
def test_golden_command_frames(name):
    """Byte for byte, and padded with zeros to one transfer of 2048 bytes."""
    frame, wanted = GOLDEN[name]
    assert frame.hex() == wanted.ljust(4096, "0")


def test_the_other_commands():
    """Unique number, one byte of the memory, software and temperature: layout as documented, no golden bytes are known."""
    for frame, code, words in (
        (wire.UNIQUE_ID, 0x9030, (1, 0)),
        (wire.eeprom(77), 0x9030, (1, 2, 77)),
        (wire.INFO, 0x9013, (0,)),
    ):
        n = len(words) + 1
        assert frame[: 2 + 4 * n] == struct.pack(f"<H{n}I", 4 * n, n << 16 | code, *words)
        assert len(frame) == 2048


@given(code=st.integers(0, 0xFFFF), words=st.lists(st.integers(0, 2**32 - 1), max_size=28))
def test_any_response_comes_back(code, words):
    """Pack an answer, take it apart; with a byte more or less, or of another command, it is none."""
    n = len(words) + 1
    data = struct.pack(f"<{n}I", n << 16 | code, *words)
    assert wire.words(data, code, len(words)) == tuple(words)
    for other in (data + b"\0", data[:-1], data + bytes(4), b""):
        with pytest.raises(DeviceError, match="no answer to it") as caught:
            wire.words(other, code)
        assert caught.value.gone
    with pytest.raises(DeviceError, match="no answer to it"):
        wire.words(data, code ^ 1)
    with pytest.raises(DeviceError, match=f"with {len(words)} words instead of {n}; its firmware is another"):
        wire.words(data, code, n)


@pytest.mark.parametrize(
    ("word", "degrees"), [(0, 0.0), (125, 31.25), (0x3FF, -0.25), (0x200, -128.0), (0x1FF, 127.75), (0xFC00 | 125, 31.25)]
)
def test_temperature(word, degrees):
    """Ten bits, two's complement, quarters of a degree."""
    assert wire.temperature(word) == degrees


def test_too_many_registers_for_one_command():
    """28 is what one command takes."""
    wire.registers(wire.Chip.TRANSMITTER, range(28))
    with pytest.raises(ConfigError, match="29 register words for transmitter; one command takes 28"):
        wire.registers(wire.Chip.TRANSMITTER, range(29))
