"""What goes over the TinyRad's cable: command frames, responses, blocks of samples."""

from __future__ import annotations

import struct
from collections.abc import Sequence
from enum import IntEnum
from typing import Final

from radar_core import ConfigError, DeviceError

VENDOR: Final = 0x064B
PRODUCT: Final = 0x7823
COMMAND_BYTES: Final = 2048  # a command is always one transfer of this length, padded with zeros
PACKET: Final = 512  # largest packet of the bulk endpoints; whatever is shorter ends a transfer
N_RX: Final = 4
SAMPLE_RATE: Final = 1e6  # of every channel, fixed [Hz]
VOLTS: Final = 0.498 / 65536  # per count of the converter [V]
RING_VALUES: Final = 0x60000  # samples that the board's ring buffer holds
_MAX_WORDS: Final = 28


class Code(IntEnum):
    """Which command."""

    VERSION = 0x900E
    INFO = 0x9013
    REGISTERS = 0x9017
    BOARD = 0x9030
    RADAR = 0x9031
    DATA = 0x9032
    ERRORS = 0x9033


class Chip(IntEnum):
    """Which chip registers are for."""

    RECEIVER = 0
    TRANSMITTER = 1
    SYNTHESISER = 2


def command(code: int, *arguments: int) -> bytes:
    """Frame a command: payload length, header with number of words and code, arguments; all little endian."""
    words = (len(arguments) + 1 << 16 | code, *arguments)
    return struct.pack(f"<H{len(words)}I", 4 * len(words), *words).ljust(COMMAND_BYTES, b"\0")


VERSION: Final = command(Code.VERSION, 0)  # ask for the firmware's version
UNIQUE_ID: Final = command(Code.BOARD, 1, 0)  # ask for the board's number
INFO: Final = command(Code.INFO, 0)  # ask for software number and temperature
RESET: Final = command(Code.RADAR, 1, 0)  # reset the radar: measuring ends and registers are lost; the USB link stays
CONVERTER_CLOCK: Final = command(Code.RADAR, 1, 12, 3, 5, 76, 100)
"""Set up the clock of the converter (ADAR7251): dividers X, R, N, M of its loop for 1 MHz per channel."""


def eeprom(address: int) -> bytes:
    """Ask for one byte of the calibration memory."""
    return command(Code.BOARD, 1, 2, address)


def registers(chip: Chip, words: Sequence[int]) -> bytes:
    """Write register words to a radio chip."""
    if len(words) > _MAX_WORDS:
        raise ConfigError(f"{len(words)} register words for {chip.name.lower()}; one command takes {_MAX_WORDS}")
    return command(Code.REGISTERS, 7, 1, chip, *words)


def sizes(n_sequence: int, chirps: int, measured: int, buffers: int) -> bytes:
    """Say how a frame is made up: length of the sequence, how often it runs and is recorded per frame, frames in the board's ring."""
    return command(Code.RADAR, 1, 2, n_sequence, chirps, measured, buffers)


def sequence(transmitters: Sequence[int]) -> bytes:
    """Say which transmitter sends in turn: 1 or 2, 0 for none."""
    return command(Code.RADAR, 1, 3, *transmitters)


def start(period: float, n_sample: int) -> bytes:
    """Begin to measure: a chirp every ``period`` [s], ``n_sample`` samples of each."""
    return command(Code.RADAR, 1, 1, round(period * 1e8), n_sample)


def get_data(n_value: int) -> bytes:
    """Ask for the next frame of ``n_value`` 16-bit values: they come, then the response."""
    return command(Code.DATA, 1, 1, n_value, 0)


def is_response(data: bytes, code: int) -> bool:
    """Whether bytes are exactly one response to a command."""
    if len(data) < 4 or len(data) % 4:
        return False
    (header,) = struct.unpack_from("<I", data)
    return bool(header & 0xFFFF == code and header >> 16 & 0xFF == len(data) // 4)


def words(data: bytes, code: int, least: int = 0) -> tuple[int, ...]:
    """Take the words, ``least`` or more, out of one transfer that answers the command ``code``.

    A `DeviceError` says that it is no such answer (the link is out of step), or that words are missing.
    """
    if not is_response(data, code):
        raise DeviceError(
            f"the TinyRad answered command {code:#06x} with {len(data)} bytes that are no answer to it ({data[:8].hex()}...); "
            "it is set up anew; if this goes on, unplug it and plug it in again",
            gone=True,
        )
    found = struct.unpack(f"<{len(data) // 4}I", data)[1:]
    if len(found) < least:
        raise DeviceError(
            f"the TinyRad answered command {code:#06x} with {len(found)} words instead of {least}; its firmware is another than this "
            "driver was written for: write the vendor's current one, or tell us its version"
        )
    return found


def temperature(word: int) -> float:
    """Temperature of the board [degree Celsius]: ten bits, two's complement, quarters."""
    raw = word & 0x3FF
    return (raw - 0x400 if raw & 0x200 else raw) / 4
