"""Sockets to the capture board, with errors that say what to do."""

from __future__ import annotations

import errno
import select
import socket

from radar_core import DeviceError
from radar_driver.components import Device


class UdpPort(Device):
    """A UDP port on which the board sends.

    Parameters
    ----------
    host, board : str
        Addresses of this computer and of the board; what others send is counted and passed over.
    port : int
        On this computer.
    """

    what = ""  # arrives there, for messages

    def __init__(self, host: str, board: str, port: int) -> None:
        self._host, self._board, self._port = host, board, port
        self._link: socket.socket | None = None

    def open(self) -> None:
        """Open the socket; a `DeviceError` says that the address or the port cannot be had."""
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


def explain_send(board: str, error: OSError) -> DeviceError:
    """Make the error for a datagram that could not be sent to the board."""
    return DeviceError(
        f"nothing can be sent to the capture board at {board} ({error.strerror or error}): is its network cable plugged in, and its "
        "power on?",
        gone=True,
    )
