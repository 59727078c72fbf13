"""The capture board's configuration port: little-endian words between two marks, asked, answered, and asked again without an answer."""

from __future__ import annotations

import struct
import time
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from enum import IntEnum
from typing import Final

from radar_core import ConfigError, DeviceError
from radar_driver.components import Report
from radar_driver.dca1000.receiver import UdpPort, wait

_HEADER, _FOOTER = 0xA55A, 0xEEAA
_COMMAND: Final = struct.Struct("<HHH")  # mark, code, bytes of data that follow
_REPLY: Final = struct.Struct("<HHHH")  # mark, code, status, mark
_LONGEST: Final = 504  # bytes of data of one command
_TICKS: Final = 125  # of the packet delay in a microsecond
_RAW, _CAPTURE, _ETHERNET, _BITS_16 = 1, 1, 2, 3  # of 1 raw, 2 multi; 1 capture, 2 playback; 1 SD card, 2 Ethernet; 12, 14, 16 bits
_TRIES: Final = 3
_FLOOD: Final = 1000  # datagrams: whoever sends more of them at once cannot keep us busy for ever
_POLL: Final = 0.05  # s
_SETTLE: Final = 2.0  # s: after it was configured the FPGA hears nothing for a while, far shorter than this


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
    """What the board says: the code of the command that is answered, or SYSTEM_STATUS, and a status.

    0 is done, 1 failed; a version or bits of events where the code says so.
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
    """Pack the data of CONFIGURE_FPGA: raw samples of 16 bits over Ethernet; missing ones are reported after ``timer`` [s]."""
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


class Control(UdpPort):
    """The configuration port, the same on both sides; one answer may take ``timeout`` [s], and the board is asked three times."""

    what = "its answers"

    def __init__(self, host: str, board: str, port: int, timeout: float) -> None:
        super().__init__(host, board, port)
        self._timeout = timeout
        self._events: list[Event] = []
        self._counts: Counter[str] = Counter()
        self._version = ""

    def open(self) -> None:
        """Open the socket and see whether the board answers; a `DeviceError` says that it does not, or why there is no socket."""
        super().open()
        try:
            self.events()  # forget what is left of an earlier life
            self.request(Code.SYSTEM_CONNECT)
        except DeviceError:
            self.close()
            raise

    def report(self) -> Report:
        """Give the FPGA's version, requests that had to be repeated, and events by name."""
        return {"fpga": self._version, **self._counts}

    def configure(self, lvds: Lvds, packet_delay: float) -> None:
        """Set the board up for raw samples over the network; a recording that goes on is ended. A `DeviceError` says that it refuses."""
        self._ask(Code.RECORD_STOP, tries=_TRIES)  # fails where nothing was recorded, which is fine
        config = fpga_config(lvds=lvds)
        if self._ask(Code.CONFIGURE_FPGA, config).status != 0:  # as after a crash: once more from the start
            self.request(Code.RESET_FPGA)
            self._settle()
            self.request(Code.CONFIGURE_FPGA, config)
        self._settle()
        self.request(Code.CONFIGURE_PACKETS, packet_config(packet_delay))
        major, minor, playback = self._ask(Code.READ_VERSION).version
        self._version = f"{major}.{minor}{' (playback)' if playback else ''}"
        if playback:
            raise DeviceError("the capture board's FPGA is one for playback; load the one for capture, as its guide says", gone=True)

    def start(self) -> None:
        """Record from now on: what the sensor sends goes to the data port, counted from 0."""
        self.events()
        self.request(Code.RECORD_START)

    def stop(self) -> None:
        """Record no more; may be called twice, and is not repeated for long where nobody answers."""
        if self._link is not None:
            self._ask(Code.RECORD_STOP, tries=1)

    def events(self) -> tuple[Event, ...]:
        """Take what the board told unasked since the last time."""
        for _ in range(_FLOOD):
            reply = self._receive(0.0)
            if reply is None:
                break
            self._note(reply)
        found, self._events = tuple(self._events), []
        return found

    def request(self, code: Code, data: bytes = b"") -> Reply:
        """Ask, and want it done; a `DeviceError` says that nobody answers, or that the board says it failed."""
        reply = self._ask(code, data)
        if reply.status != 0:
            raise DeviceError(
                f"the capture board refuses {_spoken(code)} (status {reply.status}): switch it off and on; its DIP switches must leave "
                "the settings to the computer",
                gone=True,
            )
        return reply

    def _ask(self, code: Code, data: bytes = b"", tries: int = _TRIES, timeout: float = 1e9) -> Reply:
        """Send a command until it is answered; late answers to others are passed over."""
        if self._link is None:
            raise DeviceError("the capture board's configuration port is not open", gone=True)
        command = encode_command(code, data)
        for number in range(tries):
            self._counts["repeated"] += number > 0
            try:
                self._link.sendto(command, (self._board, self._port))
            except OSError as error:
                raise DeviceError(
                    f"nothing can be sent to the capture board at {self._board} ({error.strerror or error}): is its network cable plugged "
                    "in, and its power on?",
                    gone=True,
                ) from None
            end = time.monotonic() + min(timeout, self._timeout)
            while (left := end - time.monotonic()) > 0:
                reply = self._receive(left)
                if reply is not None and reply.code == code:
                    return reply
                if reply is not None:
                    self._note(reply)
        raise DeviceError(
            f"the capture board at {self._board} does not answer {_spoken(code)}: check its power, the network cable, that this "
            f"computer is {self._host} in the same network, and that no firewall drops UDP port {self._port}",
            gone=True,
        )

    def _settle(self) -> None:
        """Ask until the FPGA, busy with its settings, hears again."""
        end = time.monotonic() + _SETTLE
        while True:
            try:
                self._ask(Code.SYSTEM_CONNECT, tries=1, timeout=_POLL)
            except DeviceError:
                if time.monotonic() > end:
                    raise
            else:
                return

    def _receive(self, timeout: float) -> Reply | None:
        """Wait for a reply of the board; None: there is none. What is no reply, or comes from elsewhere, is passed over."""
        if self._link is None:
            return None
        end = time.monotonic() + timeout
        for _ in range(_FLOOD):
            try:
                datagram, sender = self._link.recvfrom(2048)
            except BlockingIOError:
                if not wait(self._link, end - time.monotonic()):
                    return None
                continue
            reply = decode_reply(datagram) if sender[0] == self._board else None
            if reply is not None:
                return reply
            self._counts["strange"] += 1
        return None

    def _note(self, reply: Reply) -> None:
        if reply.code == Code.SYSTEM_STATUS:
            for event in reply.events:
                self._counts[event.name.lower()] += 1
                if event not in self._events:
                    self._events.append(event)


def _spoken(code: Code) -> str:
    return code.name.lower().replace("_", " ")
