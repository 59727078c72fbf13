"""UDP ports on which the capture board sends; the one for data: packets into frames, as fast as they come, with bounded buffers."""

from __future__ import annotations

import errno
import select
import socket
import time
from collections import deque
from collections.abc import Sequence
from dataclasses import asdict
from typing import Final

from radar_core import DeviceError
from radar_driver.components import Report
from radar_driver.dca1000.packets import RawFrame, Reassembler

_KEPT: Final = 4  # finished frames that wait to be read; older ones make room
_WANTED, _NEEDED = 16, 2  # frames that the system is asked to buffer, and that it has to
_OVERHEAD: Final = 3  # network cards take whole pages for a packet: so much of the buffer may be used up by one part of samples
_LEAST: Final = 1 << 18  # bytes
_NAP: Final = 0.001  # s: to wake up for every packet costs a third more, to wait longer gains nothing (benchmark boards)
_AT_ONCE: Final = 4096  # packets; then whoever waits for a frame gets to see what is finished


class UdpPort:
    """A UDP port of this computer (``host``) on which the board sends; what others send is counted and passed over."""

    what = ""  # arrives there, for messages

    def __init__(self, host: str, board: str, port: int) -> None:
        self._host, self._board, self._port = host, board, port
        self._link: socket.socket | None = None

    def open(self) -> None:
        """Open the socket; see `bind`."""
        self._link = bind(self._host, self._port, self.what)

    def close(self) -> None:
        """Let go of the socket."""
        if self._link is not None:
            self._link.close()
            self._link = None


def bind(host: str, port: int, what: str) -> socket.socket:
    """Open a UDP socket that does not block; ``what`` arrives there, for messages.

    A `DeviceError` says that this computer does not have the address ``host``, or that another program has the port.
    """
    link = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    try:
        link.setblocking(False)
        link.bind((host, port))
    except OSError as error:
        link.close()
        raise DeviceError(_why(host, port, what, error), gone=True) from None
    return link


def wait(link: socket.socket, timeout: float) -> bool:
    """Wait until something can be read; whether it can. ``timeout`` in seconds."""
    if timeout <= 0:
        return False
    poll = select.poll()
    poll.register(link, select.POLLIN)
    return bool(poll.poll(timeout * 1e3))


def _why(host: str, port: int, what: str, error: OSError) -> str:
    if error.errno == errno.EADDRNOTAVAIL:
        return (
            f"this computer has no address {host}, to which the capture board sends {what}: plug the board in, then give the network port "
            f"that address: sudo ip address add {host}/24 dev <port>; or set host_address"
        )
    if error.errno == errno.EADDRINUSE:
        return (
            f"another program holds UDP port {port} of {host}, to which the capture board sends {what}: end it (another driver, "
            f"mmWave Studio, a DCA1000 tool); this finds it: ss -lunp sport = :{port}"
        )
    return f"UDP port {port} of {host} cannot be opened for {what} ({error}); check host_address and the ports"


class Receiver(UdpPort):
    """Receives data packets, and finishes frames of ``frame_bytes``; packets gather for ``nap`` [s] before they are taken together.

    Attributes
    ----------
    warning : str
        What the user should change; empty: nothing.
    heard : float
        When the last packet came, on CLOCK_MONOTONIC [s]; 0: none since `start_afresh`.
    """

    what = "its samples"

    def __init__(self, host: str, board: str, port: int, frame_bytes: int, *, nap: float = _NAP) -> None:
        super().__init__(host, board, port)
        self._size, self._nap = frame_bytes, nap
        self._buffer = memoryview(bytearray(1 << 16))
        self._frames: deque[RawFrame] = deque()
        self._stream = Reassembler(frame_bytes)
        self._strange = self._skipped = 0
        self.warning = ""
        self.heard = 0.0

    def open(self) -> None:
        """Open the socket with a buffer for several frames."""
        super().open()
        assert self._link is not None
        self.warning = _enlarge(self._link, self._size)

    def close(self) -> None:
        """Let go of the socket, and of what is unfinished."""
        super().close()
        self._frames.clear()

    def start_afresh(self) -> None:
        """Throw away what has come: a new recording begins."""
        self._drain()
        self._frames.clear()
        self._stream = Reassembler(self._size)
        self._strange = self._skipped = 0
        self.heard = 0.0

    def read(self, timeout: float) -> RawFrame | None:
        """Wait for the next frame; None: it did not come within ``timeout`` [s]."""
        end = time.monotonic() + timeout
        self._drain()
        while not self._frames:
            if self._link is None or not wait(self._link, end - time.monotonic()):
                return None
            time.sleep(self._nap)
            self._drain()
        return self._frames.popleft()

    def after_silence(self) -> None:
        """Finish what is unfinished; the next packet may come from anywhere, also from a new recording."""
        self._keep(self._stream.flush())

    def report(self) -> Report:
        """Give what happened to packets, frames that nobody read in time, and what to change."""
        counts = asdict(self._stream.counts)
        values: dict[str, int | str] = {"packets": counts.pop("packets"), **{f"packets_{name}": count for name, count in counts.items()}}
        values |= {"packets_of_others": self._strange, "frames_skipped": self._skipped}
        return values | ({"advice": self.warning} if self.warning else {})

    def _drain(self) -> None:
        """Take all packets that are there."""
        link, buffer, board, process = self._link, self._buffer, self._board, self._stream.process
        if link is None:
            return
        for _ in range(_AT_ONCE):
            try:
                size, sender = link.recvfrom_into(buffer)
            except BlockingIOError:
                return
            now = time.monotonic_ns()
            if sender[0] != board:
                self._strange += 1
                continue
            self.heard = now * 1e-9
            if frames := process(buffer[:size], now):
                self._keep(frames)

    def _keep(self, frames: Sequence[RawFrame]) -> None:
        self._frames.extend(frames)
        while len(self._frames) > _KEPT:
            self._frames.popleft()
            self._skipped += 1


def _enlarge(link: socket.socket, frame_bytes: int) -> str:
    """Ask for a buffer of several frames; what to do when the system gives too little."""
    wanted = max(_LEAST, _WANTED * _OVERHEAD * frame_bytes)
    link.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, wanted // 2)  # Linux doubles it
    granted = link.getsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF)
    if granted >= _NEEDED * _OVERHEAD * frame_bytes:
        return ""
    return (
        f"the system buffers {granted >> 10} KiB of packets, less than two frames may need, so that packets are lost whenever this "
        f"computer is busy: sudo sysctl -w net.core.rmem_max={wanted // 2}"
    )
