"""The emulated board below the real libusb: a process that makes a USB device out of it with umockdev.

Started as ``umockdev-wrapper /usr/bin/python3 tinyrad_umockdev.py [FRAMES]``, where FRAMES holds the samples of frames, 65,536 bytes each.
It prints one JSON line with the environment in which a program finds the device, and then obeys lines of its standard input: ``unplug``,
``plug``, ``fault NAME VALUE``, ``report``; each gets a JSON line in return. It ends with its input.
"""

import errno
import json
import struct
import sys
import threading
import time
from pathlib import Path

import gi

gi.require_version("UMockdev", "1.0")
from gi.repository import GLib, UMockdev

sys.path.insert(0, str(Path(__file__).parent))
from tinyrad_board import CONFIGURATION, DEVICE, Board, GoneError, StallError, TooMuchError

FRAME_BYTES = 65536
SUBMIT, DISCARD, REAP_NOW = 0x8038550A, 0x550B, 0x4008550D
SET_CONFIGURATION, CLAIM, RELEASE, CLEAR_HALT, RESET, CAPABILITIES = 0x80045505, 0x8004550F, 0x80045510, 0x80045515, 0x5514, 0x8004551A
GET_DRIVER, SPEED, CONTROL = 0x41045508, 0x551F, 0xC0185500
URB = 56
PATIENCE = 0.004  # s: for which "nothing yet" is held back, or libusb would ask again at once and take a whole core
ERRORS = {StallError: errno.EPIPE, TooMuchError: errno.EOVERFLOW, GoneError: errno.ENODEV}


class Urb:
    """A transfer that a program has handed to its kernel."""

    def __init__(self, address, data):
        self.address, self.data = address, data
        raw = data.retrieve()
        self.end, self.length = raw[1], struct.unpack_from("<i", raw, 24)[0]
        self.status, self.actual, self.done = -errno.EINPROGRESS, 0, False
        self.buffer = data.resolve(16, self.length) if self.length else None
        self.got = bytearray()

    def finish(self, status=0):
        """Write back what came of it, as the kernel does."""
        self.status, self.done = status, True
        if self.end & 0x80 and self.got:
            self.buffer.update(0, bytes(self.got))
        if self.end & 0x80:
            self.actual = len(self.got)
        self.data.update(4, struct.pack("<i", status))
        self.data.update(28, struct.pack("<i", self.actual))


class Program:
    """One program that has the device open."""

    def __init__(self):
        self.urbs, self.waiting, self.claimed = [], None, False


class Bus(UMockdev.IoctlBase):
    """The kernel's usbfs for one board."""

    def __init__(self, board):
        super().__init__()
        self.board, self.programs = board, {}
        self.gone = False
        self.lock = threading.RLock()  # system calls come in a thread of umockdev's

    def do_client_connected(self, client):
        with self.lock:
            self.programs[client] = Program()

    def forget_the_dead(self):
        """Take back what ended programs held, as the kernel does; umockdev does not tell when a program was killed."""
        for client in [client for client in self.programs if not client.get_connected()]:
            del self.programs[client]

    def do_handle_ioctl(self, client):
        with self.lock:
            return self.serve(client)

    def serve(self, client):
        program = self.programs.setdefault(client, Program())
        request = client.get_request() & 0xFFFFFFFF
        if self.gone and request not in (REAP_NOW, DISCARD):
            client.complete(-1, errno.ENODEV)
            return True
        handlers = {
            SUBMIT: self.submit,
            REAP_NOW: self.reap,
            DISCARD: self.discard,
            CLAIM: self.claim,
            RELEASE: self.release,
            SET_CONFIGURATION: self.configure,
            CLEAR_HALT: self.clear_halt,
            RESET: self.restart,
            CAPABILITIES: self.capabilities,
        }
        if request in handlers:
            try:
                handlers[request](client, program)
            except GLib.Error:  # the program was killed in the middle of the call
                self.programs.pop(client, None)
                client.abort()
        else:  # what libusb can do without
            client.complete(-1, errno.ENODATA if request == GET_DRIVER else errno.ENOTTY)
        return True

    def held(self, program):
        self.forget_the_dead()
        return any(other.claimed for other in self.programs.values() if other is not program)

    def capabilities(self, client, program):
        client.get_arg().resolve(0, 4).update(0, struct.pack("<I", 0x01 | 0x10))  # zero packets; reap after disconnect
        client.complete(0, 0)

    def configure(self, client, program):
        if self.held(program):
            client.complete(-1, errno.EBUSY)
            return
        self.board.halted = False
        client.complete(0, 0)

    def claim(self, client, program):
        if self.held(program):
            client.complete(-1, errno.EBUSY)
            return
        program.claimed = True
        client.complete(0, 0)

    def release(self, client, program):
        program.claimed = False
        client.complete(0, 0)

    def clear_halt(self, client, program):
        self.board.clear_halt()
        client.complete(0, 0)

    def restart(self, client, program):
        self.board.power_cycle()
        client.complete(0, 0)

    def submit(self, client, program):
        address = bytes(client.get_arg().retrieve())  # before it is resolved: what to discard is named by it
        urb = Urb(address, client.get_arg().resolve(0, URB))
        program.urbs.append(urb)
        client.complete(0, 0)
        self.pump()

    def discard(self, client, program):
        address = bytes(client.get_arg().retrieve())
        for urb in program.urbs:
            if urb.address == address and not urb.done:
                urb.finish(-errno.ENOENT)
                client.complete(0, 0)
                return
        client.complete(-1, errno.EINVAL)

    def reap(self, client, program):
        self.pump()
        if self.give(client, program):
            return
        if not any(not urb.done for urb in program.urbs):
            client.complete(-1, errno.ENODEV if self.gone else errno.EAGAIN)
            return
        program.waiting = (client, time.monotonic() + PATIENCE)

    def give(self, client, program):
        """Give the program the first transfer that is done."""
        for urb in program.urbs:
            if urb.done:
                program.urbs.remove(urb)
                client.get_arg().resolve(0, 8).set_ptr(0, urb.data)
                client.complete(0, 0)
                return True
        return False

    def pump(self):
        """Move what can be moved, in the order of submission at each endpoint."""
        for program in list(self.programs.values()):
            blocked = set()
            for urb in program.urbs:
                if urb.done or urb.end in blocked:
                    continue
                if not self.transfer(urb):
                    blocked.add(urb.end)

    def transfer(self, urb):
        """Let the board take or give; whether the transfer is over."""
        try:
            if urb.end & 0x80:
                if not self.board.fill(urb.got, urb.length):
                    return False
            else:
                urb.actual = self.board.accept(bytes(urb.buffer.retrieve()))
        except tuple(ERRORS) as problem:
            urb.finish(-ERRORS[type(problem)])
            return True
        urb.finish()
        return True

    def tick(self):
        """Look after programs that wait; often, and all the time."""
        try:
            with self.lock:
                self.forget_the_dead()
                self.pump()
                self.answer()
        except GLib.Error:  # a program was killed while it was served; it is forgotten next time
            pass
        return True

    def answer(self):
        """Answer the programs that wait for a transfer."""
        now = time.monotonic()
        for program in list(self.programs.values()):
            if program.waiting is None:
                continue
            client, until = program.waiting
            program.waiting = None
            if not self.give(client, program):
                if now > until:
                    client.complete(-1, errno.ENODEV if self.gone and not program.urbs else errno.EAGAIN)
                else:
                    program.waiting = (client, until)


class Machine:
    """A machine into which the board is plugged, and out of which it is pulled."""

    def __init__(self, board):
        self.board, self.bed = board, UMockdev.Testbed.new()
        self.bed.add_from_string(
            "P: /devices/pci0000:00/usb1\nN: bus/usb/001/001\nE: DEVTYPE=usb_device\nE: SUBSYSTEM=usb\n"
            "E: BUSNUM=001\nE: DEVNUM=001\nE: MAJOR=189\nE: MINOR=0\nE: DEVNAME=/dev/bus/usb/001/001\n"
            "A: busnum=1\\n\nA: devnum=1\\n\nA: speed=480\\n\nA: bConfigurationValue=1\\n\n"
            f"H: descriptors={self.hub()}\n"
        )
        self.bus = None
        self.plug()

    @staticmethod
    def hub():
        device = struct.pack("<BBHBBBBHHHBBBB", 18, 1, 0x0200, 9, 0, 1, 64, 0x1D6B, 2, 0x0100, 0, 0, 0, 1)
        return (device + struct.pack("<BBHBBBBB", 9, 2, 9, 0, 1, 0, 0xE0, 0)).hex().upper()

    def plug(self):
        number = self.board.address
        node = f"/dev/bus/usb/001/{number:03d}"
        self.path = "/sys/devices/pci0000:00/usb1/1-1"
        self.bed.add_from_string(
            f"P: /devices/pci0000:00/usb1/1-1\nN: bus/usb/001/{number:03d}\nE: DEVTYPE=usb_device\nE: SUBSYSTEM=usb\nE: BUSNUM=001\n"
            f"E: DEVNUM={number:03d}\nE: DEVNAME={node}\nE: MAJOR=189\nE: MINOR={number - 1}\nA: busnum=1\\n\nA: devnum={number}\\n\n"
            f"A: devpath=1\\n\nA: speed=480\\n\nA: bConfigurationValue=1\\n\nH: descriptors={(DEVICE + CONFIGURATION).hex().upper()}\n"
        )
        self.bus = Bus(self.board)
        self.bed.attach_ioctl(node, self.bus)
        self.node = node
        self.bed.uevent(self.path, "add")

    def obey(self, line):
        with self.bus.lock:
            return self.do(line)

    def do(self, line):
        word, *rest = line.split()
        if word == "unplug":
            self.board.unplug()
            self.bus.gone = True
            self.bus.tick()
            self.bed.uevent(self.path, "remove")
            self.bed.remove_device(self.path)
        elif word == "plug":
            self.board.plug()
            self.plug()
        elif word == "fault":
            self.board.faults[rest[0]] = json.loads(rest[1])
        elif word == "report":
            self.bus.forget_the_dead()
            holders = sum(program.claimed for program in self.bus.programs.values())
            times = {"ready_ns": self.board.ready_ns, "began_ns": self.board.began_ns}
            return {**times, "commands": len(self.board.commands), "holders": holders}
        return {}


def main():
    frames = Path(sys.argv[1]).read_bytes() if len(sys.argv) > 1 else b""
    board = Board([frames[i : i + FRAME_BYTES] for i in range(0, len(frames), FRAME_BYTES)], paced=True)
    machine, loop = Machine(board), GLib.MainLoop()
    environment = {"UMOCKDEV_DIR": machine.bed.get_root_dir(), "LD_PRELOAD": "libumockdev-preload.so.0"}
    # ROS loads a tracing library that waits 3 s for a thread of its own, which the preloaded library blocks in the meantime.
    environment["LTTNG_UST_REGISTER_TIMEOUT"] = "0"
    print(json.dumps(environment), flush=True)

    def heard(channel, condition):
        line = sys.stdin.readline()
        if not line:
            loop.quit()
            return False
        print(json.dumps(machine.obey(line)), flush=True)
        return True

    GLib.io_add_watch(0, GLib.PRIORITY_DEFAULT, GLib.IOCondition.IN | GLib.IOCondition.HUP, heard)
    GLib.timeout_add(1, lambda: machine.bus.tick())
    loop.run()


if __name__ == "__main__":
    main()
