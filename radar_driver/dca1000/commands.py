"""What a DCA1000's configuration port understands and answers: little-endian words between two marks."""

from __future__ import annotations

import struct
from collections.abc import Sequence
from dataclasses import dataclass
from enum import IntEnum
from typing import Final

from radar_core import ConfigError

_HEADER, _FOOTER = 0xA55A, 0xEEAA
_COMMAND: Final = struct.Struct("<HHH")  # mark, code, bytes of data that follow
_REPLY: Final = struct.Struct("<HHHH")  # mark, code, status, mark
_LONGEST: Final = 504  # bytes of data of one command
_TICKS: Final = 125  # of the packet delay in a microsecond
_RAW, _CAPTURE, _ETHERNET, _BITS_16 = 1, 1, 2, 3  # of 1 raw, 2 multi; 1 capture, 2 playback; 1 SD card, 2 Ethernet; 12, 14, 16 bits


class Code(IntEnum):
    """Commands; replies carry the code of what they answer."""

    RESET_FPGA = 0x01
    RESET_RADAR = 0x02
    CONFIGURE_FPGA = 0x03
    CONFIGURE_EEPROM = 0x04
    RECORD_START = 0x05
    RECORD_STOP = 0x06
    PLAYBACK_START = 0x07
    PLAYBACK_STOP = 0x08
    SYSTEM_CONNECT = 0x09
    SYSTEM_STATUS = 0x0A
    CONFIGURE_PACKETS = 0x0B
    CONFIGURE_AR_MODE = 0x0C
    PLAYBACK_INIT = 0x0D
    READ_VERSION = 0x0E


class Lvds(IntEnum):
    """Lanes between sensor and capture board."""

    FOUR_LANES = 1
    TWO_LANES = 2


class Event(IntEnum):
    """What the board tells unasked: numbers of the bits of the status of a SYSTEM_STATUS message."""

    NO_LVDS_DATA = 0
    NO_HEADER = 1
    EEPROM_FAILURE = 2
    SD_CARD_INSERTED = 3
    SD_CARD_REMOVED = 4
    SD_CARD_FULL = 5
    MODE_FAILURE = 6
    MEMORY_FULL = 7
    RECORD_COMPLETED = 8
    LVDS_BUFFER_FULL = 9
    PLAYBACK_COMPLETED = 10
    PLAYBACK_OUT_OF_SEQUENCE = 11


ADVICE: Final = {
    Event.NO_LVDS_DATA: "the sensor sends no samples to the capture board: is it started, does its .cfg say lvdsStreamCfg -1 0 1 0, "
    "does the number of lanes suit it, and is the 60-pin cable plugged in on both sides?",
    Event.NO_HEADER: "the capture board misses headers between the samples: the .cfg must say lvdsStreamCfg -1 0 1 0 (no headers)",
    Event.EEPROM_FAILURE: "the capture board cannot read its EEPROM: it uses its default addresses then (192.168.33.180 to 192.168.33.30)",
    Event.SD_CARD_FULL: "the capture board's SD card is full; it is not used by this driver: take it out",
    Event.MODE_FAILURE: "the capture board refuses its settings: check that lanes suits the sensor and that no DIP switch contradicts it",
    Event.MEMORY_FULL: "the capture board's memory is full: the network is too slow for the samples; lower packet_delay, "
    "plug the board straight into a gigabit port, or measure less often",
    Event.RECORD_COMPLETED: "the capture board has ended the recording; somebody else may have stopped it",
    Event.LVDS_BUFFER_FULL: "the capture board cannot take the samples fast enough; lower packet_delay or the sample rate",
}
"""What events mean and what to do, for those that matter to a recording over the network."""


@dataclass(frozen=True)
class Reply:
    """What the board says.

    Attributes
    ----------
    code : int
        Of the command that is answered, or SYSTEM_STATUS.
    status : int
        0: done, 1: failed; a version or bits of events where the code says so.
    """

    code: int
    status: int

    @property
    def events(self) -> tuple[Event, ...]:
        """Events of a SYSTEM_STATUS message; bits that nobody knows are left out."""
        return tuple(event for event in Event if self.status >> event & 1)

    @property
    def version(self) -> tuple[int, int, bool]:
        """Major and minor version of the FPGA, and whether it is one for playback; of an answer to READ_VERSION."""
        return self.status & 0x7F, self.status >> 7 & 0x7F, bool(self.status >> 14 & 1)


def encode_command(code: Code, data: bytes = b"") -> bytes:
    """Pack a command; a `ConfigError` says that there is more data than one command can carry."""
    if len(data) > _LONGEST:
        raise ConfigError(f"command {code.name} has {len(data)} bytes of data; at most {_LONGEST} fit")
    return _COMMAND.pack(_HEADER, code, len(data)) + data + struct.pack("<H", _FOOTER)


def decode_reply(datagram: bytes) -> Reply | None:
    """Unpack what came to the configuration port; None: it is no reply of a DCA1000."""
    if len(datagram) != _REPLY.size:
        return None
    header, code, status, footer = _REPLY.unpack(datagram)
    return Reply(code, status) if (header, footer) == (_HEADER, _FOOTER) else None


def fpga_config(*, lvds: Lvds, timer: int = 30) -> bytes:
    """Pack the data of CONFIGURE_FPGA: raw samples of 16 bits over Ethernet.

    ``timer`` is the time after which missing samples are reported [s].
    """
    if not 0 <= timer <= 255:
        raise ConfigError(f"the capture board's timer is {timer} s; it must be between 0 and 255")
    return bytes((_RAW, lvds, _CAPTURE, _ETHERNET, _BITS_16, timer))


def packet_config(delay: float, *, largest: int = 1470) -> bytes:
    """Pack the data of CONFIGURE_PACKETS: delay between packets, 5 to 500 us [s], and bytes of the largest packet, head included."""
    if not 5e-6 <= delay <= 500e-6:
        raise ConfigError(f"packet_delay is {delay * 1e6:g} us; the capture board can do 5 to 500 us")
    return struct.pack("<HHH", largest, round(delay * 1e6 * _TICKS), 0)


def advice(events: Sequence[Event]) -> str:
    """Say what events mean and what to do; empty for those that do not matter."""
    return "; ".join(ADVICE[event] for event in events if event in ADVICE)
