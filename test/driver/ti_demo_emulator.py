"""A TI board with a demo, at the other end of a real pseudo terminal: packets as the boards send them, faults, and its command line."""

import contextlib
import os
import select
import struct
import threading
import tty
from pathlib import Path

import numpy as np

MAGIC = bytes.fromhex("0201040306050807")
UNITS = (0.01, 0.01, 0.00028, 0.00025, 0.04)  # of the 3D people counting's points, as a real board sent them
SDK = 0x03060200
CHIP = 0x000A6843


def item(kind, value, whole=False):
    """One TLV; ``whole``: its length counts its own head."""
    return struct.pack("<2I", kind, len(value) + 8 * whole) + value


def demo_packet(number, items, n_points=0, version=SDK):
    """A packet of the out-of-the-box demo: 40 bytes of header, filled up to a multiple of 32."""
    body = b"".join(items)
    length = -(-(40 + len(body)) // 32) * 32
    head = MAGIC + struct.pack("<8I", version, length, CHIP, number, 123456, n_points, len(items), 0)
    return (head + body).ljust(length, b"\x0f")


def checksummed(head):
    """Put the checksum in: the 16 bit words then add up to all ones."""
    total = sum(struct.unpack(f"<{len(head) // 2}H", head))
    while total >> 16:
        total = (total >> 16) + (total & 0xFFFF)
    return head[:-2] + struct.pack("<H", 0xFFFF - total)


def people_3d_packet(number, items):
    """A packet of the older 3D people counting: 48 bytes of header with a checksum; give items with ``whole``."""
    body = b"".join(items)
    head = MAGIC + struct.pack("<9I2H", SDK, 48 + len(body), CHIP, number, 0, 12568, 18, 1370, 700, len(items), 0)
    return checksummed(head) + body


def people_2d_packet(number, items):
    """A packet of the older people counting: 52 bytes of header with a checksum."""
    body = b"".join(items)
    head = MAGIC + struct.pack("<10I2H", SDK, CHIP, 99, 52 + len(body), number, 0, 12568, 18, 1370, 700, len(items), 0)
    return checksummed(head) + body


def floats(*columns):
    return np.stack([np.asarray(c, "<f4") for c in columns], axis=-1).tobytes()


def side(snr, noise):
    """Item 7: 0.1 dB."""
    return np.stack([np.rint(np.asarray(c) * 10).astype("<i2") for c in (snr, noise)], axis=-1).tobytes()


def packed(distance, azimuth, elevation, doppler, ratio):
    """Items 1020 and 6 of people counting 3D: five units, then 8 bytes a point."""
    scaled = [np.rint(np.asarray(v) / u) for v, u in zip((elevation, azimuth, doppler, distance, ratio), UNITS, strict=True)]
    raw = np.zeros(len(scaled[0]), [("e", "<i1"), ("a", "<i1"), ("d", "<i2"), ("r", "<u2"), ("s", "<u2")])
    for name, column in zip(raw.dtype.names, scaled, strict=True):
        raw[name] = column
    return struct.pack("<5f", *UNITS) + raw.tobytes()


def cloud_packet(number, cloud):
    """One of our clouds as the out-of-the-box demo would send it: TI's axes, points and side info."""
    points = floats(-cloud.y, cloud.x, cloud.z, cloud.radial_speed)
    return demo_packet(number, [item(1, points), item(7, side(cloud.snr, np.full(len(cloud), 40.0)))], len(cloud))


class Board:
    """A pseudo terminal behind a link that stays the same over unplugging, as udev's links do."""

    def __init__(self, link: Path):
        self.link = Path(link)
        self.master = -1
        self.plug()

    def plug(self):
        self.master, slave = os.openpty()
        tty.setraw(slave)
        self.link.unlink(missing_ok=True)
        self.link.symlink_to(os.ttyname(slave))
        os.close(slave)
        os.set_blocking(self.master, False)

    def unplug(self):
        self.link.unlink(missing_ok=True)
        if self.master >= 0:
            os.close(self.master)
        self.master = -1

    def send(self, data: bytes) -> int:
        """Write what fits, as a line does that nobody reads; gives how much that was."""
        done = 0
        with contextlib.suppress(BlockingIOError):
            while done < len(data):
                done += os.write(self.master, data[done : done + 1024])
        return done

    def send_all(self, data: bytes, timeout=5.0):
        """Write everything, as fast as it is read."""
        while data:
            _, ready, _ = select.select([], [self.master], [], timeout)
            assert ready, "nobody reads"
            data = data[self.send(data[:1024]) :]


class CommandLine(Board):
    """The demo's command port: echoes, answers Done or an error, and knows what was said."""

    def __init__(self, link, refuse=(), silent=False):
        super().__init__(link)
        self.said, self.refuse, self.silent = [], set(refuse), silent
        self._end = threading.Event()
        self._thread = threading.Thread(target=self._work, daemon=True)
        self._thread.start()

    def _work(self):
        text = b""
        while not self._end.is_set():
            if not select.select([self.master], [], [], 0.02)[0]:
                continue
            try:
                text += os.read(self.master, 4096)
            except OSError:  # nobody has it open
                self._end.wait(0.02)
                continue
            while b"\n" in text:
                line, _, text = text.partition(b"\n")
                self._answer(line.decode().strip())

    def _answer(self, line):
        if line:
            self.said.append(line)
        if not self.silent:
            answer = "" if not line else "Error -1" if line.split()[0] in self.refuse else "Done"
            self.send(f"{line}\r\n{answer}\r\n\nmmwDemo:/>".encode())

    def close(self):
        self._end.set()
        self._thread.join()
        self.unplug()
