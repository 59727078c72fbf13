"""An emulated EV-TINYRAD24G: what its firmware does with the packets it gets. Standard library only, so that any Python can run it.

Two front ends carry the packets: `tinyrad_backend` (inside pyusb) and `tinyrad_umockdev` (below the real libusb).
"""

import struct
import time
from collections import deque

PACKET, COMMAND = 512, 2048
UID = (0x89ABCDEF, 0x01234567)
# Class 255, 64-byte control packets, one configuration; interface 0 with bulk OUT 0x01 and bulk IN 0x81 of 512 bytes.
DEVICE = struct.pack("<BBHBBBBHHHBBBB", 18, 1, 0x0200, 0xFF, 0, 0, 64, 0x064B, 0x7823, 0x0100, 0, 0, 0, 1)
ENDPOINTS = (0x01, 0x81)
CONFIGURATION = (
    struct.pack("<BBHBBBBB", 9, 2, 32, 1, 1, 0, 0xC0, 50)
    + struct.pack("<9B", 9, 4, 0, 0, 2, 0xFF, 0, 0, 0)
    + b"".join(struct.pack("<BBBBHB", 7, 5, end, 2, PACKET, 0) for end in ENDPOINTS)
)


class StallError(Exception):
    """The endpoint is halted."""


class TooMuchError(Exception):
    """A packet is longer than what is left of the buffer."""


class GoneError(Exception):
    """Nobody is there any more."""


def calibration(seed=1):
    """Return 128 bytes of a calibration, and its factors by channel."""
    state, pairs = seed, []
    for _ in range(16):
        state = state * 6364136223846793005 + 1442695040888963407 & (1 << 64) - 1
        pairs.append((state >> 40) % (1 << 23) + (1 << 23) if len(pairs) % 2 == 0 else (state >> 40) % (1 << 23) - (1 << 22))
    tail = (3, 20240501, int(2.5 * 65536), 65536, 0, 0)
    factors = [complex(re, im) / 2**24 for re, im in zip(pairs[::2], pairs[1::2], strict=True)]
    return struct.pack("<16i6I", *pairs, *tail).ljust(128, b"\0"), factors


class Board:
    """Firmware of one board.

    Parameters
    ----------
    frames : list of bytes
        Samples of the frames that it measures, one after the other, then again; empty: zeros.
    paced : bool
        Whether a frame takes its time; otherwise the next is always ready.
    """

    def __init__(self, frames=(), *, paced=False, version=(3, 0, 3), memory=None, clock=time.monotonic):
        self.frames, self.paced, self.version, self.clock = list(frames), paced, version, clock
        self.memory = calibration()[0] if memory is None else memory
        self.temperature = 0x3FF & round(31.25 * 4)
        self.commands = []  # whole command frames, in order
        self.plugged = True
        self.address = 5
        self.faults = {}
        self.ready_ns = []  # when each frame that was sent was ready, on the clock
        self.began_ns = []  # when it began to measure, each time
        self.power_cycle()

    def power_cycle(self):
        """Forget everything, as without power."""
        self.incoming, self.outgoing = bytearray(), deque()
        self.halted, self.later = False, None
        self.reset()

    def reset(self):
        """Forget what the radar does; the link goes on."""
        self.registers = {0: [], 1: [], 2: []}
        self.locked, self.sizes, self.sequence, self.measuring, self.request = False, None, None, None, None

    def unplug(self):
        self.plugged = False
        self.power_cycle()

    def plug(self):
        """Come back at another address, as a replugged device does."""
        self.plugged, self.address = True, self.address + 1

    # What the bus does

    def accept(self, data):
        """Take what the host sends."""
        self._check()
        if self.halted:
            raise StallError
        if self.faults.pop("short_write", None):
            return len(data) // 2
        self.incoming += data
        while len(self.incoming) >= COMMAND:
            frame = bytes(self.incoming[:COMMAND])
            del self.incoming[:COMMAND]
            self._obey(frame)
        return len(data)

    def fill(self, buffer, length):
        """Move what the board has into a host's buffer; True: the transfer is over."""
        self._check()
        if self.halted:
            raise StallError
        if self.later and self.clock() > self.later[0]:
            self.outgoing.append(self.later[1])
            self._respond(0x9032, 0)
            self.later = None
        self._work()
        while len(buffer) < length:
            if not self.outgoing:
                return False
            chunk = self.outgoing[0]
            room = length - len(buffer)
            n = len(chunk) if len(chunk) <= room else room // PACKET * PACKET
            if n == 0:
                raise TooMuchError
            buffer += chunk[:n]
            if n == len(chunk):
                self.outgoing.popleft()
                if n % PACKET:
                    return True  # a packet that is not full ends the transfer
            else:
                self.outgoing[0] = chunk[n:]
        return True

    def clear_halt(self):
        self._check()
        self.halted = False

    def due(self):
        """Seconds until the frame that the host waits for; None: it waits for none."""
        if self.request is None or self.measuring is None:
            return None
        return self._ready_at(self._next()) - self.clock() if self.paced else 0.0

    def _check(self):
        if not self.plugged:
            raise GoneError

    # What the firmware does

    def _obey(self, frame):
        n_byte, header = struct.unpack_from("<HI", frame)
        n, code = header >> 16 & 0xFF, header & 0xFFFF
        if n < 1 or n_byte != 4 * n:
            return  # no command of this board
        self.commands.append(frame)
        arguments = struct.unpack_from(f"<{n - 1}I", frame, 6)
        if self.faults.get("hang"):
            return
        if self.faults.pop("mute", None):
            return
        if self.faults.pop("stall", None):
            self.halted = True
            return
        answer = self._answer(code, arguments)
        if answer is not None:
            self._respond(code, *answer)

    def _respond(self, code, *words):
        self.outgoing.append(struct.pack(f"<{len(words) + 1}I", len(words) + 1 << 16 | code, *words))

    def _answer(self, code, arguments):
        """Words of the answer; None: it comes later, or never."""
        if code == 0x900E:
            major, minor, patch = self.version
            return (major << 16 | minor << 8 | patch, 1, 2)
        if code == 0x9013:
            return (1, self.temperature)
        if code == 0x9030:
            if arguments[1] == 2:
                return (self.memory[arguments[2]],) if arguments[2] < len(self.memory) else ()
            return UID
        if code == 0x9017:
            self.registers[arguments[2]] += arguments[3:]
            return (1,)
        if code == 0x9031:
            return self._radar(arguments[1], arguments[2:])
        if code == 0x9032:
            self.request = arguments[2]
            return None
        return None

    def _radar(self, what, arguments):
        if what == 0:
            self.reset()
        elif what == 12:
            self.locked = not self.faults.get("unlocked")
            return (int(self.locked),)
        elif what == 2:
            self.sizes = arguments
        elif what == 3:
            self.sequence = arguments
        elif what == 1 and self.sizes and self.sequence:
            period, n_sample = arguments
            self.began_ns.append(round(self.clock() * 1e9))
            self.measuring = {"began": self.clock(), "period": period * 1e-8, "n": n_sample, "sent": 0, "skipped": 0}
        return (0,)

    def _turns(self):
        n_sequence, chirps, measured, _ = self.sizes
        return n_sequence * chirps, n_sequence * measured

    def _ready_at(self, number):
        m = self.measuring
        stride, recorded = self._turns()
        return m["began"] + (number * stride + recorded) * m["period"]

    def _next(self):
        """Which frame comes next: the oldest that the ring still has."""
        m = self.measuring
        if not self.paced:
            return m["sent"]
        stride, recorded = self._turns()
        done = int(((self.clock() - m["began"]) / m["period"] - recorded) // stride) + 1
        return max(m["sent"], done - self.sizes[3])

    def _work(self):
        """Send the frame that the host waits for, once it is ready."""
        if self.request is None or self.measuring is None:
            return
        number = self._next()
        if self.paced and self.clock() < self._ready_at(number):
            return
        n_value, self.request = self.request, None
        self.measuring["sent"] = number + 1
        self.ready_ns.append(round(self._ready_at(number) * 1e9))
        self._send(self._block(number, n_value))

    def _block(self, number, n_value):
        stride, recorded = self._turns()
        block = bytearray(self.frames[number % len(self.frames)]) if self.frames else bytearray(2 * n_value)
        if len(block) != 2 * n_value or n_value != 4 * self.measuring["n"] * recorded:
            raise AssertionError(f"asked for {n_value} values, measuring {4 * self.measuring['n'] * recorded}, have {len(block)} bytes")
        jump = self.faults.pop("counter_jump", 0)
        self.measuring["skipped"] += jump
        first = number * stride + self.measuring["skipped"]
        lost, at = self.faults.pop("lost_chirps", (0, 0))
        step = len(block) // recorded
        for chirp in range(recorded):
            count = first + chirp + (lost if chirp >= at else 0)
            block[chirp * step : chirp * step + 8] = struct.pack("<H", count & 0xFFFF) * 4
        return block

    def _send(self, block):
        if "partial" in self.faults:  # so much, and then nothing more
            self.outgoing.append(memoryview(bytes(block))[: self.faults.pop("partial")])
            self.faults["hang"] = True
            return
        if "cut" in self.faults:  # bytes that got lost
            block = block[: len(block) - self.faults.pop("cut")]
        if self.faults.pop("stall_data", None):
            self.halted = True
            return
        if "pause" in self.faults:  # so much, and the rest later
            n, seconds = self.faults.pop("pause")
            self.outgoing.append(memoryview(bytes(block))[:n])
            self.later = (self.clock() + seconds, memoryview(bytes(block))[n:])
            return
        if self.faults.get("response_first"):
            self._respond(0x9032, 0)
        self.outgoing.append(memoryview(bytes(block)))
        if not self.faults.get("response_first"):
            self._respond(0x9032, 0)
