"""A connection over TCP of which bytes are read as they come."""

from __future__ import annotations

import select
import socket
import time

from radar_core import DeviceError
from radar_driver.a121 import wire
from radar_driver.components import Component, Report

_CHUNK = 1 << 16


class Link(Component):
    """The connection to an exploration server, and its answers.

    Attributes
    ----------
    parser : Parser
        Cuts what comes.
    """

    name = "link"

    def __init__(self, address: str, timeout: float) -> None:
        self._address, self._timeout = address, timeout
        self._socket: socket.socket | None = None
        self.parser = wire.Parser()

    def power_up(self) -> None:
        """Connect; a `DeviceError` says what to check."""
        self.power_down()
        host, port = self._where()
        try:
            self._socket = socket.create_connection((host, port), timeout=self._timeout)
            self._socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        except OSError as error:
            raise DeviceError(
                f"nobody answers at {host}:{port} ({error}): switch the board on, start the exploration server on it, check knob address",
                gone=True,
            ) from None
        self.parser.reset()

    def _where(self) -> tuple[str, int]:
        if not self._address:
            raise DeviceError("say where the exploration server is: knob address, e.g. 192.168.1.10 or 192.168.1.10:6110", gone=True)
        host, colon, port = self._address.rpartition(":")
        if not colon:
            return self._address, wire.PORT
        if not (host and port.isascii() and port.isdigit() and 0 < int(port) < 1 << 16):
            raise DeviceError(f"{self._address!r} is no address: say host, or host:port", gone=True)
        return host, int(port)

    def power_down(self) -> None:
        """Disconnect."""
        held, self._socket = self._socket, None
        if held is not None:
            held.close()

    def write(self, data: bytes) -> None:
        """Send a command; a `DeviceError` says that the connection is lost."""
        try:
            self._open().sendall(data)
        except OSError as error:
            raise self._lost(error) from None

    def read(self, timeout: float) -> list[wire.Message]:
        """Wait ``timeout`` seconds at most for bytes; give the messages that they complete."""
        link = self._open()
        try:
            if not select.select([link], [], [], max(timeout, 0.0))[0]:
                return []
            data = link.recv(_CHUNK)
        except (OSError, ValueError) as error:
            raise self._lost(error) from None
        if not data:
            raise self._lost("it hung up")
        return self.parser.feed(data)

    def ask(self, data: bytes, wanted: str, patience: float | None = None) -> wire.Message:
        """Send a command and wait for the answer that has the key ``wanted``, or that status; frames meanwhile are thrown away.

        A `DeviceError` says that the board refuses, or does not answer for ``patience`` seconds (None: the link's own).
        """
        self.write(data)
        patience = self._timeout if patience is None else patience
        end = time.monotonic() + patience
        while (left := end - time.monotonic()) > 0:
            for message in self.read(left):
                if message.status == "error":
                    raise DeviceError(f"the exploration server refuses: {str(message.head.get('message', 'no reason'))[:200]}")
                if wanted in message.head or message.status == wanted:
                    return message
        raise DeviceError(f"{self._address}: no answer ({wanted}) for {patience:g} s: is it an exploration server?", gone=True)

    def _lost(self, reason: object) -> DeviceError:
        return DeviceError(f"the connection to {self._address} is lost ({reason}): check cable, power and network", gone=True)

    def _open(self) -> socket.socket:
        if self._socket is None:
            raise DeviceError(f"{self._address} is not connected", gone=True)
        return self._socket

    def report(self) -> Report:
        """Say where it is, and what came that was nothing."""
        return {"address": self._address, **{name: self.parser.counts[name] for name in ("refused", "garbage_bytes")}}
