"""The capture board's configuration port: asked, answered, and asked again where no answer came."""

from __future__ import annotations

import time
from collections import Counter
from typing import Final

from radar_core import DeviceError
from radar_driver.components import Report
from radar_driver.dca1000.commands import Code, Event, Lvds, Reply, decode_reply, encode_command, fpga_config, packet_config
from radar_driver.dca1000.sockets import UdpPort, explain_send, wait

_TRIES: Final = 3
_FLOOD: Final = 1000  # datagrams: whoever sends more of them at once cannot keep us busy for ever
_POLL: Final = 0.05  # s
_SETTLE: Final = 2.0  # s: after it was configured the FPGA hears nothing for a while, far shorter than this


class Control(UdpPort):
    """The configuration port.

    Parameters
    ----------
    host, board, port : str, str, int
        As of `UdpPort`; the port on both sides.
    timeout : float
        How long to wait for one answer [s]; the board is asked three times.
    """

    name = "configuration port"
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
                raise explain_send(self._board, error) from None
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
