"""The TinyRad's USB link through pyusb: finding it, transfers whose lengths are checked, and errors that say what to do."""

from __future__ import annotations

import errno
import os
import time
from array import array
from collections import Counter
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any, Final, TypeVar

from radar_core import DeviceError
from radar_core.paths import share_dir
from radar_driver.tinyrad import wire

T = TypeVar("T")
RULE: Final = "70-handwave-tinyrad.rules"
_GONE: Final = (errno.ENODEV, errno.ENOENT, errno.ESHUTDOWN)
_ATTEMPTS: Final = 8  # to find the beginning of a command again: a half command is up to three packets
_ATTEMPT: Final = 0.3  # s: for one of them
_FLOOD: Final = 8 << 20  # bytes: more than the board can have stored; whatever sends more is not a TinyRad
_QUIET: Final = 0.02  # s: so long without a byte, and nothing was left


def usb_devices(backend: Any = None) -> list[Any]:
    """List the TinyRads that are plugged in, as pyusb's devices; a `DeviceError` says that pyusb or libusb is not there."""
    try:
        import usb.core
    except ImportError:
        raise DeviceError("the TinyRad needs pyusb: pip install pyusb") from None
    try:
        return list(usb.core.find(find_all=True, idVendor=wire.VENDOR, idProduct=wire.PRODUCT, backend=backend))
    except usb.core.NoBackendError:
        raise DeviceError("the TinyRad needs libusb, which is not there: sudo apt-get install libusb-1.0-0") from None


def port_of(device: Any) -> str:
    """Where a device is plugged in, as ``bus-port.port``: stays the same when it is plugged in there again."""
    ports = ".".join(map(str, device.port_numbers or ())) or f"address {device.address}"
    return f"{device.bus}-{ports}"


def _node(device: Any) -> Path:
    return Path(f"/dev/bus/usb/{device.bus:03d}/{device.address:03d}")


def access_problem(device: Any) -> str:
    """Say why the user may not use a device, and what to do; empty: the user may, as far as can be seen without opening it."""
    node = _node(device)
    return _no_permission(device) if node.exists() and not os.access(node, os.R_OK | os.W_OK) else ""


def _no_permission(device: Any) -> str:
    return (
        f"no permission for the TinyRad at {port_of(device)}: sudo cp {share_dir() / 'config' / 'udev' / RULE} /etc/udev/rules.d/ && "
        "sudo udevadm control --reload, "
        "then unplug it and plug it in again (without a desktop also: sudo usermod -aG plugdev $USER, and log in again)"
    )


def _holders(device: Any) -> str:
    """Name the programs that have a device open, as far as the user may see them."""
    node, found = _node(device), []
    for entry in Path("/proc").glob("[0-9]*/fd/*"):
        try:
            if int(entry.parts[2]) != os.getpid() and os.readlink(entry).endswith(str(node).removeprefix("/dev")):
                found.append(f"{(entry.parents[1] / 'comm').read_text().strip()} (process {entry.parts[2]})")
        except OSError:
            continue
    return ", ".join(sorted(set(found))) or "perhaps another Handwave, or one of another user"


class UsbLink:
    """One TinyRad on the bus. One thread at a time may use it.

    Parameters
    ----------
    port : str
        Which one, see `port_of`; empty: the only one.
    timeout : float
        How long a command may take [s].
    backend : usb.backend.IBackend or None
        How to reach it; None: libusb.

    Attributes
    ----------
    counts : Counter
        ``stalls``, ``resynchronised``: since it was made.
    """

    def __init__(self, port: str = "", *, timeout: float = 1.0, backend: Any = None) -> None:
        self._port, self._timeout, self._backend = port, timeout, backend
        self._device: Any = None
        self._out = self._in = 0
        self.counts: Counter[str] = Counter()

    def open(self) -> None:
        """Find the board and claim it; a `DeviceError` says why that cannot be."""
        import usb.core
        import usb.util

        self.close()
        self._device = self._choose()
        try:
            self._guard("open", self._device.set_configuration)
            interface = self._device.get_active_configuration()[(0, 0)]
            ends = {
                usb.util.endpoint_direction(end.bEndpointAddress): end.bEndpointAddress
                for end in reversed(list(interface))
                if usb.util.endpoint_type(end.bmAttributes) == usb.util.ENDPOINT_TYPE_BULK
            }
            if set(ends) != {usb.util.ENDPOINT_IN, usb.util.ENDPOINT_OUT}:
                raise DeviceError("the TinyRad lacks its bulk endpoints: is this an EV-TINYRAD24G? Unplug it and plug it in again")
            self._out, self._in = ends[usb.util.ENDPOINT_OUT], ends[usb.util.ENDPOINT_IN]
            self._guard("open", lambda: usb.util.claim_interface(self._device, 0))
        except usb.core.USBError as error:  # from reading descriptors
            raise self._failed("open", error) from error
        except DeviceError:
            self.close()
            raise

    def close(self) -> None:
        """Let go of it; may be called twice, and never fails."""
        if self._device is not None:
            import usb.core
            import usb.util

            device, self._device = self._device, None
            with suppress(usb.core.USBError):  # it was unplugged: nothing is left to release
                usb.util.dispose_resources(device)

    def report(self) -> dict[str, Any]:
        """Where it is, and what happened on the link."""
        return {"port": port_of(self._device) if self._device is not None else self._port or "none", **self.counts}

    def write(self, frame: bytes) -> None:
        """Send bytes; a `DeviceError` when not all of them went."""
        sent = self._guard("send a command to", lambda: self._device.write(self._out, frame, self._milliseconds(self._timeout)))
        if sent is None:
            raise self._silent(f"did not take a command within {self._timeout:g} s")
        if sent != len(frame):
            raise self._silent(f"took {sent} of the {len(frame)} bytes of a command")

    def read(self, n_byte: int, timeout: float) -> bytes:
        """Read what comes as one transfer, at most ``n_byte``; what had come when the time [s] was up; nothing when nothing had."""
        buffer = array("B", bytes(n_byte))
        n = self._guard("read from", lambda: self._device.read(self._in, buffer, self._milliseconds(timeout)))
        return memoryview(buffer)[: n or 0].tobytes()

    def ask(self, frame: bytes, least: int = 0, timeout: float | None = None) -> tuple[int, ...]:
        """Send a command and return the words of its answer, ``least`` or more, within ``timeout`` [s] (None: the link's).

        A `DeviceError` says that the answer does not come, or that something else does; ``gone`` then.
        """
        code, patience = int.from_bytes(frame[2:4], "little"), timeout or self._timeout
        for attempt in (1, 2):
            self.write(frame)
            try:
                answer = self.read(wire.PACKET, patience)
                while wire.is_response(answer, wire.Code.DATA) and code != wire.Code.DATA:  # of a frame that nobody waits for any more
                    answer = self.read(wire.PACKET, patience)
            except DeviceError as error:
                if error.gone or attempt == 2:
                    raise
                continue  # a stall that was cleared: once more
            if answer:
                return wire.words(answer, code, least)
            break
        raise self._silent(f"did not answer command {code:#06x} within {patience:g} s")

    def synchronise(self, attempts: int = _ATTEMPTS, patience: float = _ATTEMPT) -> None:
        """Come in step with a board of which nothing is known: throw away what it still sends, and find where its next command begins.

        A program that was killed may leave answers and samples that nobody read, a request that the board still works on, and a command of
        which only some packets went. After the last, whole commands are read from their middle; single packets of zeros shift them. At most
        ``attempts`` times (once is enough where all commands went whole), each ended by ``patience`` seconds without a byte.
        """
        for attempt in range(attempts):
            self.write(wire.VERSION)
            if self._await(wire.Code.VERSION, patience):
                if attempt == 0:
                    return
                self._await(-1, _QUIET)  # that may have been a late answer to an earlier attempt: only a prompt one counts now
                self.write(wire.VERSION)
                if self._await(wire.Code.VERSION, patience):
                    return
            self.counts["resynchronised"] += 1
            if attempt + 1 < attempts:
                self.write(bytes(wire.PACKET))
        raise self._silent("does not answer")

    def reset(self) -> None:
        """Reset the USB device itself, as unplugging would; for a board that `synchronise` could not reach."""
        self._guard("reset", self._device.reset)

    def drain(self) -> None:
        """Throw away what the board still sends, until it is quiet."""
        self._await(-1, _QUIET)

    def _await(self, code: int, patience: float) -> bool:
        """Throw everything away until the answer to a command; False when nothing more comes."""
        thrown, deadline = 0, time.monotonic() + patience
        while thrown < _FLOOD and time.monotonic() < deadline:
            try:
                answer = self.read(wire.COMMAND_BYTES * 8, _QUIET)
            except DeviceError as error:
                if error.gone:
                    raise
                continue
            if wire.is_response(answer, code):
                return True
            if answer:
                thrown, deadline = thrown + len(answer), time.monotonic() + patience
        return False

    def _choose(self) -> Any:
        devices = usb_devices(self._backend)
        ports = {port_of(device): device for device in devices}
        if not devices:
            raise DeviceError("no TinyRad is plugged in: plug it in, and look at its lamp; handwave devices shows what is found", gone=True)
        if self._port:
            if self._port not in ports:
                raise DeviceError(
                    f"no TinyRad is at {self._port}, but at {', '.join(ports)}; set tinyrad.port, or leave it empty for the only one",
                    gone=True,
                )
            return ports[self._port]
        if len(devices) > 1:
            raise DeviceError(f"{len(devices)} TinyRads are plugged in; choose one by tinyrad.port: {', '.join(ports)}")
        return devices[0]

    @staticmethod
    def _milliseconds(timeout: float) -> int:
        return max(1, round(timeout * 1e3))  # 0 would be for ever

    def _guard(self, doing: str, call: Callable[[], T]) -> T | None:
        """Do something with the device; None when its time was up, a `DeviceError` when it failed."""
        import usb.core

        if self._device is None:
            raise DeviceError("the TinyRad is not open: power it up first", gone=True)
        try:
            return call()
        except usb.core.USBTimeoutError:
            return None
        except usb.core.USBError as error:
            raise self._failed(doing, error) from error

    def _failed(self, doing: str, error: Any) -> DeviceError:
        """Make the message of what libusb said."""
        number, device = error.errno, self._device
        if number in _GONE:
            return DeviceError("the TinyRad was unplugged: plug it in again, and it goes on by itself", gone=True)
        if number == errno.EACCES:
            return DeviceError(_no_permission(device), gone=True)
        if number == errno.EBUSY:
            return DeviceError(f"another program holds the TinyRad at {port_of(device)}: {_holders(device)}; end it", gone=True)
        if number == errno.EPIPE:
            return self._stalled(doing)
        if number == errno.EOVERFLOW:
            return DeviceError("the TinyRad sent more than was asked for: the link is out of step; it is set up anew", gone=True)
        return self._silent(f"cannot be used: to {doing} it gave {error}")

    def _stalled(self, doing: str) -> DeviceError:
        self.counts["stalls"] += 1
        import usb.core

        try:
            for end in (self._in, self._out):
                self._device.clear_halt(end)
        except usb.core.USBError as error:
            return self._silent(f"stalled and did not recover ({error})")
        return DeviceError(f"the TinyRad stalled ({doing} it); the stall was cleared, and it goes on; if it comes again, try another cable")

    @staticmethod
    def _silent(what: str) -> DeviceError:
        return DeviceError(f"the TinyRad {what}; it is opened anew; if this goes on, unplug it and plug it in again", gone=True)
