"""The emulated board inside pyusb: everything above libusb is real."""

import errno
import struct
import threading
import time
from types import SimpleNamespace

import usb.backend
import usb.core
from tinyrad_board import CONFIGURATION, DEVICE, GoneError, StallError, TooMuchError

_ERRORS = {StallError: (-9, errno.EPIPE), TooMuchError: (-8, errno.EOVERFLOW), GoneError: (-4, errno.ENODEV)}

_DEVICE = (
    *("bLength", "bDescriptorType", "bcdUSB", "bDeviceClass", "bDeviceSubClass", "bDeviceProtocol", "bMaxPacketSize0", "idVendor"),
    *("idProduct", "bcdDevice", "iManufacturer", "iProduct", "iSerialNumber", "bNumConfigurations"),
)
_CONFIGURATION = (
    *("bLength", "bDescriptorType", "wTotalLength", "bNumInterfaces", "bConfigurationValue", "iConfiguration", "bmAttributes"),
    "bMaxPower",
)
_INTERFACE = (
    *("bLength", "bDescriptorType", "bInterfaceNumber", "bAlternateSetting", "bNumEndpoints", "bInterfaceClass", "bInterfaceSubClass"),
    *("bInterfaceProtocol", "iInterface"),
)
_ENDPOINT = ("bLength", "bDescriptorType", "bEndpointAddress", "bmAttributes", "wMaxPacketSize", "bInterval")


def error(number, code=-1):
    return usb.core.USBError("emulated", code, number)


class Backend(usb.backend.IBackend):
    """Boards on a bus.

    Parameters
    ----------
    boards : Board
        What is plugged in.

    Attributes
    ----------
    forbidden : bool
        The user may not open them.
    handles : set
        Open handles; claims are by device.
    """

    def __init__(self, *boards):
        self.boards, self.forbidden = boards, False
        self.handles, self.claims, self.resets = set(), {}, 0
        self._lock = threading.Lock()

    def _do(self, call):
        with self._lock:
            try:
                return call()
            except tuple(_ERRORS) as problem:
                code, number = _ERRORS[type(problem)]
                raise error(number, code) from None

    def enumerate_devices(self):
        return [board for board in self.boards if board.plugged]

    def get_device_descriptor(self, dev):
        names = _DEVICE
        values = dict(zip(names, struct.unpack("<BBHBBBBHHHBBBB", DEVICE), strict=True))
        where = self.boards.index(dev) + 1
        return SimpleNamespace(**values, bus=1, address=dev.address, port_number=where, port_numbers=(where,), speed=3)

    def get_configuration_descriptor(self, dev, config):
        if config > 0:
            raise IndexError
        names = _CONFIGURATION
        return SimpleNamespace(**dict(zip(names, struct.unpack_from("<BBHBBBBB", CONFIGURATION), strict=True)), extra_descriptors=[])

    def get_interface_descriptor(self, dev, intf, alt, config):
        if intf > 0 or alt > 0:
            raise IndexError
        names = _INTERFACE
        return SimpleNamespace(**dict(zip(names, struct.unpack_from("<9B", CONFIGURATION, 9), strict=True)), extra_descriptors=[])

    def get_endpoint_descriptor(self, dev, ep, intf, alt, config):
        names = _ENDPOINT
        values = dict(zip(names, struct.unpack_from("<BBBBHB", CONFIGURATION, 18 + 7 * ep), strict=True))
        return SimpleNamespace(**values, bRefresh=0, bSynchAddress=0, extra_descriptors=[])

    def open_device(self, dev):
        if self.forbidden:
            raise error(errno.EACCES, -3)
        self._do(dev._check)
        handle = SimpleNamespace(board=dev, address=dev.address)
        self.handles.add(id(handle))
        return handle

    def close_device(self, handle):
        self.handles.discard(id(handle))

    def set_configuration(self, handle, value):
        self._do(lambda: self._there(handle))
        if self.claims.get(handle.board, handle) is not handle:
            raise error(errno.EBUSY, -6)
        handle.board.halted = False

    def get_configuration(self, handle):
        return 1

    def claim_interface(self, handle, intf):
        if self.claims.setdefault(handle.board, handle) is not handle:
            raise error(errno.EBUSY, -6)

    def release_interface(self, handle, intf):
        if self.claims.get(handle.board) is handle:
            del self.claims[handle.board]

    def _there(self, handle):
        """A handle of a device that was unplugged stays dead, whatever is plugged in later."""
        if not handle.board.plugged or handle.board.address != handle.address:
            raise GoneError

    def bulk_write(self, handle, ep, intf, data, timeout):
        def send():
            self._there(handle)
            return handle.board.accept(data.tobytes())

        return self._do(send)

    def bulk_read(self, handle, ep, intf, buff, timeout):
        deadline, got = time.monotonic() + timeout * 1e-3, bytearray()

        def take():
            self._there(handle)
            return handle.board.fill(got, len(buff))

        while not self._do(take) and time.monotonic() < deadline:
            time.sleep(0.0005)
        if not got:
            raise usb.core.USBTimeoutError("emulated", -7, errno.ETIMEDOUT)
        memoryview(buff)[: len(got)] = got
        return len(got)

    def clear_halt(self, handle, ep):
        self._do(lambda: self._there(handle))
        handle.board.clear_halt()

    def reset_device(self, handle):
        self._do(lambda: self._there(handle))
        self.resets += 1
        handle.board.power_cycle()

    def is_kernel_driver_active(self, handle, intf):
        return False
