"""Data packets of a DCA1000, put in order, filled where some were lost, cut into frames."""

from __future__ import annotations

import struct
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

HEAD: Final = struct.Struct("<IIH")
"""In front of the samples: sequence number from 1 (32 bits), number of the first byte in the stream (48 bits)."""
LARGEST: Final = 1456  # samples of one packet [bytes]; the last one of a recording may hold fewer
_WINDOW: Final = 16 * LARGEST  # bytes: packets overtake each other by less, so a hole that far behind is a loss
_MODULUS: Final = 1 << 32
_LONGEST: Final = 1472  # bytes: what an Ethernet frame holds
_SEEN: Final = b"\x01" * _LONGEST


@dataclass(eq=False)
class RawFrame:
    """The bytes of one frame.

    Attributes
    ----------
    number : int
        Counts the frames of the recording, lost ones too.
    data, seen : bytearray
        As sent, 0 where packets were lost; 1 for every byte that arrived.
    arrived_ns, sent : int
        When the first packet with bytes of this frame came [ns], and how many of its bytes had been sent by then.
    received : int
        Bytes that arrived.
    """

    number: int
    data: bytearray
    seen: bytearray
    arrived_ns: int
    sent: int
    received: int = 0

    def missing(self, n_chirp: int) -> NDArray[np.uint32]:
        """Numbers of the chirps that lack bytes, ascending, of ``n_chirp`` that the frame has in all, shape (n_missing,)."""
        if self.received == len(self.data):
            return np.empty(0, np.uint32)
        whole = np.frombuffer(self.seen, np.uint8).reshape(n_chirp, -1).all(axis=1)
        return np.flatnonzero(~whole).astype(np.uint32)


@dataclass
class Counts:
    """What happened to packets.

    Attributes
    ----------
    packets, lost : int
        Accepted; left out in the sequence numbers and not come later.
    reordered, duplicated, late : int
        Accepted though others overtook them; came twice; came when their frame was gone already.
    garbled : int
        Refused: too short, too long, or a place that contradicts the packets around.
    jumps, restarts : int
        Times that the counters went elsewhere and stayed there, and of these to the first packet of a new recording.
    """

    packets: int = 0
    lost: int = 0
    reordered: int = 0
    duplicated: int = 0
    late: int = 0
    garbled: int = 0
    jumps: int = 0
    restarts: int = 0


class _Packet(NamedTuple):
    sequence: int
    place: int
    payload: memoryview
    stamp_ns: int


@dataclass
class _Line:
    """Where the stream is: the newest packet that was believed."""

    sequence: int
    place: int
    end: int
    largest: int

    def leads_to(self, packet: _Packet) -> bool:
        """Whether a packet lies where its sequence number says, packets between being full."""
        ahead = _ahead(packet.sequence, self.sequence)
        return ahead >= 1 and packet.place == self.end + (ahead - 1) * self.largest

    def has_passed(self, packet: _Packet) -> bool:
        """Whether a packet is one of those before the newest, or that one again, packets between being full."""
        behind = -_ahead(packet.sequence, self.sequence)
        return behind >= 0 and self.place - packet.place == behind * self.largest

    @classmethod
    def at(cls, packet: _Packet, largest: int) -> _Line:
        """Be where a packet lies."""
        size = len(packet.payload)
        return cls(packet.sequence, packet.place, packet.place + size, max(largest, size))


class Reassembler:
    """Cuts a stream of packets into frames, by the byte counts in their heads: frame ``k`` begins at byte ``k * frame_bytes``.

    A packet that contradicts the others is kept until the next one confirms it (the counters jumped, a new recording began) or does not (it
    is garbled), so neither a jump nor a garbled head shifts a frame. Sequence numbers may overflow; the byte count, good for more than a
    year, may not.

    Parameters
    ----------
    frame_bytes, window : int
        Bytes of one frame, at least 1. An incomplete one is waited for until packets ``window`` bytes behind its end have come.

    Attributes
    ----------
    counts : Counts
        Since the beginning.
    """

    def __init__(self, frame_bytes: int, *, window: int = _WINDOW) -> None:
        if frame_bytes < 1:
            raise ValueError(f"frame_bytes is {frame_bytes}; a frame has at least one byte")
        self._size, self._window = frame_bytes, window
        self._pending: dict[int, RawFrame] = {}
        self._line: _Line | None = None
        self._doubtful: _Packet | None = None
        self._next = 0  # number of the frame that leaves next
        self._due = 0  # bytes; once the stream is there, it leaves even if incomplete
        self.counts = Counts()

    def process(self, packet: bytes | bytearray | memoryview, stamp_ns: int) -> Sequence[RawFrame]:
        """Take one packet, the payload of a UDP datagram that came at ``stamp_ns``; give the frames that are finished now, in order.

        What is needed of the packet is copied.
        """
        if not HEAD.size < len(packet) <= _LONGEST:
            self.counts.garbled += 1
            return ()
        sequence, low, high = HEAD.unpack_from(packet)
        new = _Packet(sequence, low | high << 32, memoryview(packet)[HEAD.size :], stamp_ns)
        line = self._line
        if line is None:
            return self._begin(new)
        if line.end == new.place and (line.sequence + 1) % _MODULUS == sequence:  # as nearly always
            return self._go_on(line, new)
        return self._unusual(line, new)

    def flush(self) -> list[RawFrame]:
        """Give the frames that are not finished, as far as they have come; later packets begin anew, at whatever place they name."""
        self.counts.garbled += self._doubtful is not None
        self._line = self._doubtful = None
        return [self._leave(number) for number in sorted(self._pending)]

    def _begin(self, new: _Packet) -> Sequence[RawFrame]:
        """Take the first packet of a recording; within one, the first two that agree."""
        if new.sequence == 1 and new.place == 0:
            return self._set_out([new])
        doubtful = self._doubtful
        if doubtful is not None and _Line.at(doubtful, 0).leads_to(new):
            return self._set_out([doubtful, new])
        return self._doubt(new)

    def _unusual(self, line: _Line, new: _Packet) -> Sequence[RawFrame]:
        doubtful = self._doubtful
        if doubtful is not None and _Line.at(doubtful, line.largest).leads_to(new):
            self.counts.jumps += 1
            self.counts.lost += max(0, _ahead(doubtful.sequence, line.sequence) - 1)
            frames: list[RawFrame] = []
            if doubtful.place < line.end:
                self.counts.restarts += doubtful.sequence == 1
                self._doubtful = None
                frames += self.flush()
            return [*frames, *self._set_out([doubtful, new])]
        if line.leads_to(new):
            self.counts.lost += _ahead(new.sequence, line.sequence) - 1
            return self._go_on(line, new)
        if line.has_passed(new):
            if new.place + len(new.payload) > self._next * self._size:
                return self._catch_up(new)
            if new.sequence != 1:  # else it may be the first one of a new recording
                self.counts.late += 1
                return ()
        return self._doubt(new)

    def _doubt(self, new: _Packet) -> Sequence[RawFrame]:
        """Keep a packet that lies elsewhere until another one agrees with it."""
        self.counts.garbled += self._doubtful is not None
        self._doubtful = _Packet(new.sequence, new.place, memoryview(bytes(new.payload)), new.stamp_ns)
        return ()

    def _set_out(self, packets: Sequence[_Packet]) -> Sequence[RawFrame]:
        """Go on from where these packets lie."""
        self._doubtful = None
        first = packets[0]
        if not self._pending:
            self._wait_for(first.place // self._size)
        self._line = line = _Line(first.sequence - 1, first.place, first.place, len(first.payload))
        frames: list[RawFrame] = []
        for packet in packets:
            frames += self._go_on(line, packet)
        return frames

    def _go_on(self, line: _Line, new: _Packet) -> Sequence[RawFrame]:
        """Take the packet that comes next, perhaps behind a gap."""
        size = len(new.payload)
        line.sequence, line.place, line.end, line.largest = new.sequence, new.place, new.place + size, max(line.largest, size)
        self.counts.packets += 1
        frames: Sequence[RawFrame] = ()
        if self._write(new) or line.end >= self._due:
            frames = self._finished(line.end)
        doubtful, self._doubtful = self._doubtful, None
        if doubtful is None:
            return frames
        if line.leads_to(doubtful):  # it had overtaken the one that explains it
            return [*frames, *self._unusual(line, doubtful)]
        self.counts.garbled += 1
        return frames

    def _catch_up(self, new: _Packet) -> Sequence[RawFrame]:
        """Take a packet that others overtook, unless it has come before."""
        seen = self._overlap(new)
        if seen == len(new.payload):
            self.counts.duplicated += 1
        elif seen:
            self.counts.garbled += 1
        else:
            self.counts.packets += 1
            self.counts.reordered += 1
            self.counts.lost -= 1
            if self._write(new) and self._line is not None:
                return self._finished(self._line.end)
        return ()

    def _overlap(self, new: _Packet) -> int:
        """Count the packet's bytes that are there already or no longer needed."""
        count = 0
        for number, start, part in self._parts(new):
            frame = self._pending.get(number)
            if number < self._next:
                count += len(part)
            elif frame is not None:
                count += frame.seen.count(1, start, start + len(part))
        return count

    def _write(self, new: _Packet) -> bool:
        """Put bytes where they belong; whether that finished a frame."""
        finished = False
        for number, start, part in self._parts(new):
            if number < self._next:
                continue
            end = start + len(part)
            frame = self._pending.get(number)
            if frame is None:
                frame = self._pending[number] = RawFrame(number, bytearray(self._size), bytearray(self._size), new.stamp_ns, end)
            frame.data[start:end] = part
            frame.seen[start:end] = _SEEN[: len(part)]
            frame.received += len(part)
            finished |= frame.received >= self._size
        return finished

    def _parts(self, new: _Packet) -> list[tuple[int, int, memoryview]]:
        """Share the bytes out among frames: number, where in it, bytes."""
        number, start = divmod(new.place, self._size)
        payload = new.payload
        if start + len(payload) <= self._size:
            return [(number, start, payload)]
        parts = []
        while payload:
            n = self._size - start
            parts.append((number, start, payload[:n]))
            payload, number, start = payload[n:], number + 1, 0
        return parts

    def _finished(self, end: int) -> list[RawFrame]:
        """Let go of what is complete, and of what no packet is to come for, in order."""
        frames = []
        expired = (end - self._window) // self._size  # numbers below are no longer waited for
        while self._pending:
            frame = self._pending.get(self._next)
            if frame is None:
                number = min(min(self._pending), max(self._next, expired))
                if number == self._next:
                    break
                self._wait_for(number)
            elif frame.received >= self._size or self._next < expired:
                frames.append(self._leave(self._next))
            else:
                break
        return frames

    def _leave(self, number: int) -> RawFrame:
        frame = self._pending.pop(number)
        self._wait_for(number + 1)
        return frame

    def _wait_for(self, number: int) -> None:
        self._next = number
        self._due = (number + 1) * self._size + self._window


def _ahead(sequence: int, other: int) -> int:
    """How many packets a sequence number is ahead of another, whatever overflowed between."""
    return (sequence - other + _MODULUS // 2) % _MODULUS - _MODULUS // 2
