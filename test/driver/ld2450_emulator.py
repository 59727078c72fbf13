"""An LD2450 at the other end of a real pseudo terminal: reports as the board sends them, and answers to its commands."""

import contextlib
import os
import select
import struct
import threading

import ti_demo_emulator as ti

VERSION = bytes.fromhex("0000 0201 16240622")  # as the maker's protocol prints it: V1.02.22062416


def raw(value):
    """A number whose highest bit says that it is positive."""
    whole = round(abs(value))
    return whole | 0x8000 if value >= 0 and whole else whole


def report(*targets, cell=360):
    """Up to three targets (x [m], y [m], speed [m/s]); None: this place in the list is empty."""
    rows = [(0, 0, 0, 0) if t is None else (raw(t[0] * 1e3), raw(t[1] * 1e3), raw(t[2] * 1e2), cell) for t in targets]
    rows += [(0, 0, 0, 0)] * (3 - len(rows))
    return b"\xaa\xff\x03\x00" + b"".join(struct.pack("<4H", *row) for row in rows) + b"\x55\xcc"


def answer(word, value=b"", status=0):
    return b"\xfd\xfc\xfb\xfa" + struct.pack("<3H", 4 + len(value), word | 0x100, status) + value + b"\x04\x03\x02\x01"


class Board(ti.Board):
    """Answers every command at once; ``mute``: its RX is not connected."""

    def __init__(self, link, version=VERSION, mute=False):
        super().__init__(link)
        self.version, self.mute, self.said = version, mute, []
        self._end = threading.Event()
        self._thread = threading.Thread(target=self._work, daemon=True)
        self._thread.start()

    def _work(self):
        text = b""
        while not self._end.is_set():
            with contextlib.suppress(OSError, ValueError):
                if self.master >= 0 and select.select([self.master], [], [], 0.01)[0]:
                    text += os.read(self.master, 4096)
            while b"\x04\x03\x02\x01" in text:
                command, _, text = text.partition(b"\x04\x03\x02\x01")
                word = struct.unpack_from("<H", command, 6)[0]
                self.said.append(word)
                values = {0xFF: b"\x01\x00\x40\x00", 0xA0: self.version}
                if not self.mute:
                    self.send(report() + answer(word, values.get(word, b"")))  # reports go on between answers
            self._end.wait(0.003)

    def close(self):
        self._end.set()
        self._thread.join()
        self.unplug()
