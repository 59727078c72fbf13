"""Packets of TI's radar demos on the data port: a magic word, a header, and items of type, length and value (TLV).

Four families are known. The header of "demo" (the out-of-the-box demo of SDK 3 and what grew out of it, the 3D people counting of TI's
toolboxes from 2021 on) has 40 bytes, its lengths leave out the 8 bytes of an item's own head, and packets are filled up to multiples of 32
bytes. The "area scanner" has one more number at the end of its header, and its item 1 holds ranges and angles. The older people-counting
demos ("people 3D" with 48 bytes, "people 2D" with 52) end their header with a checksum, which tells them apart, and their lengths include
the head. Facts from TI's "Understanding UART Data Output Format" and "Understanding the Out of Box Demo Data Output", and from captures of
boards that people show in TI's forum (994264: people 3D, 1236655: area scanner).
"""

from __future__ import annotations

import struct
from collections import Counter
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from typing import Any, Final

from radar_driver.ti_demo import items

MAGIC: Final = bytes((2, 1, 4, 3, 6, 5, 8, 7))
LONGEST: Final = 1 << 16  # bytes of the longest packet that is believed: 0.7 s of the line at 921600 baud; heat maps of a small frame fit
SHORTEST: Final = 40
_DEMOS: Final = (("demo", 40), ("area scanner", 44))
_KINDS: Final = 64  # counts that are kept apart: a broken board may send items of four thousand million types
_PIECE: Final = 4096  # bytes taken in at a time, so that a long read does not pile up before it is looked through


@dataclass(frozen=True)
class Head:
    """What a head says.

    Attributes
    ----------
    family : str
        ``demo``, ``area scanner``, ``people 3D`` or ``people 2D``, see this module's text.
    size, length : int
        Bytes of the head, and of the whole packet.
    version, platform : int
        Of the SDK: major, minor, bugfix and build in one byte each, the major one highest ("demo" only, else as it comes). Chip, in
        hexadecimal digits: 0xA6843 is an xWR6843.
    number, subframe : int
        The radar's count of frames, and part of the frame where it has several.
    n_items, n_points : int
        How many items follow; how many points they have, where it says so.
    """

    family: str
    size: int
    version: int
    platform: int
    number: int
    subframe: int
    length: int
    n_items: int
    n_points: int


def _checksum_holds(head: bytes) -> bool:
    """Whether the 16 bit words of a header add up to all ones in ones' complement, as its checksum makes them."""
    total = sum(struct.unpack(f"<{len(head) // 2}H", head))
    while total >> 16:
        total = (total >> 16) + (total & 0xFFFF)
    return bool(total == 0xFFFF)


def read_heads(held: bytearray, limit: int) -> list[Head] | None:
    """Read the header at the front in every way that makes sense, the likeliest first; None: it is not complete yet.

    ``held`` begins with a magic word, and ``limit`` of its bytes may belong to this packet. An `ItemError` says that it makes no sense.
    """
    more = limit == len(held)  # bytes may still come
    if limit < SHORTEST:
        if more:
            return None
        raise items.ItemError("a header is cut off by the next packet: bytes were lost on the line")
    # One header of "demo" in 30,000 has a right checksum by chance, hence all that fit and not the first.
    heads = [
        _people(family, size, held)
        for size, family in ((48, "people 3D"), (52, "people 2D"))
        if limit >= size and _checksum_holds(bytes(held[:size]))
    ]
    version, length, platform, number, _, n_points, n_items, subframe = struct.unpack_from("<8I", held, len(MAGIC))
    if n_items <= length // 8 and n_points <= length:
        heads += [Head(family, size, version, platform, number, subframe, length, n_items, n_points) for family, size in _DEMOS]
    heads = [head for head in heads if head.size <= head.length <= LONGEST]
    if more and limit < 52 and not (heads and heads[0].length < 52):
        return None  # wait for the bytes that tell the families apart
    if not heads:
        raise items.ItemError(
            f"a header says {length} bytes, {n_items} items and {n_points} points, which no demo known here sends "
            f"(version {version:#x}, platform {platform:#x})"
        )
    return heads


def _people(family: str, size: int, held: bytearray) -> Head:
    words = struct.unpack_from("<9I" if size == 48 else "<10I", held, len(MAGIC))
    n_items = struct.unpack_from("<H", held, size - 4)[0]
    if size == 48:
        version, length, platform, number, subframe = words[:5]
    else:
        version, platform, _, length, number, subframe = words[:6]
    return Head(family, size, version, platform, number, subframe, length, n_items, 0)


@dataclass(frozen=True, eq=False)
class Packet(Head):
    """What one packet holds, beside its head.

    Attributes
    ----------
    end : int
        Bytes of the stream up to its last one.
    points : Points or None
        None: the packet has none.
    processing : float
        From the end of the chirps until the packet was sent, as the demo says [s]; NaN: it does not.
    skipped : tuple of int
        Types of the items that are not used.
    own : Own or None
        What the demo itself found; None: it does not say.
    """

    end: int
    points: items.Points | None
    processing: float
    skipped: tuple[int, ...]
    own: items.Own | None


class Parser:
    """Finds packets in a stream of bytes, whatever is between them; never raises and keeps at most `LONGEST` bytes.

    A packet is believed when its header makes sense, its items fit into its length, and no second magic word is in it: one that lost
    bytes on the line has the next packet's inside, which is then found at once.

    Attributes
    ----------
    received : int
        Bytes so far.
    counts : Counter
        ``packets``, ``refused`` (a magic word without a packet), ``garbage_bytes``, and ``item_N``: items of type N that are not used
        (``item_others`` beyond 64 counts).
    reason : str
        Why the last packet was refused; empty: none was.
    """

    def __init__(self) -> None:
        self._held = bytearray()
        self._fresh = 0  # bytes of _held that no packet had: those kept of the last packet are not garbage
        self._columns = 0  # numbers that the points of an old demo have, where one packet alone does not tell
        self.received = 0
        self.counts: Counter[str] = Counter()
        self.reason = ""

    @property
    def held(self) -> int:
        """Bytes that wait for more."""
        return len(self._held)

    def reset(self) -> None:
        """Forget what waits; for a line that was interrupted."""
        self._held.clear()
        self._fresh = 0

    def feed(self, data: bytes) -> list[Packet]:
        """Take in the next bytes, however many; give the packets that are complete now, in the order of the stream."""
        found: list[Packet] = []
        for start in range(0, len(data), _PIECE):
            piece = data[start : start + _PIECE]
            self._held += piece
            self._fresh += len(piece)
            self.received += len(piece)
            while (packet := self._next()) is not None:
                found.append(packet)
        return found

    def _next(self) -> Packet | None:
        """Give the first complete packet; None: there is none yet."""
        while True:
            at = self._held.find(MAGIC)
            if at < 0:
                self._discard(max(len(self._held) - len(MAGIC) + 1, 0))  # the last bytes may begin a magic word
                return None
            self._discard(at)
            if len(self._held) < SHORTEST and MAGIC not in self._held[len(MAGIC) :]:
                return None
            try:
                packet = self._read()
            except items.ItemError as error:
                self.counts["refused"] += 1
                self.reason = str(error)
                self._discard(len(MAGIC))
                continue
            if packet is None:
                return None
            self.counts["packets"] += 1
            for kind in packet.skipped:
                name = f"item_{kind}"
                self.counts[name if name in self.counts or len(self.counts) < _KINDS else "item_others"] += 1
            self._accept(packet.length)
            return packet

    def _read(self) -> Packet | None:
        """Read the packet at the front; None: it is not complete yet."""
        second = self._held.find(MAGIC, len(MAGIC))
        heads = read_heads(self._held, second if second > 0 else len(self._held))
        if heads is None:
            return None
        problem: items.ItemError | None = None  # of the likeliest reading
        for head in heads:
            if 0 < second < head.length:
                problem = problem or items.ItemError(f"a packet of {head.length} bytes has the next one in it: bytes were lost on the line")
                continue
            if len(self._held) < head.length:
                return None
            try:
                return self._decode(head, bytes(self._held[: head.length]), self.received - len(self._held) + head.length)
            except items.ContentError:
                raise
            except items.ItemError as error:
                problem = problem or error
        raise problem or items.ItemError("no header")

    def _discard(self, count: int) -> None:
        """Let go of garbage at the front."""
        self.counts["garbage_bytes"] += max(count - (len(self._held) - self._fresh), 0)
        del self._held[:count]
        self._fresh = min(self._fresh, len(self._held))

    def _accept(self, length: int) -> None:
        """Let go of a packet, but for its last bytes: where it was none, the next magic word may begin in them."""
        self._fresh = len(self._held) - length
        del self._held[: length - len(MAGIC) + 1]

    def _decode(self, head: Head, data: bytes, end: int) -> Packet:
        """Read the items of a packet."""
        used: dict[str, Any] = {}
        skipped = []
        for kind, value in _items(head, data):
            name = items.ITEMS[head.family].get(kind)
            if name is None or name in used:
                skipped.append(kind)
            else:
                used[name] = value
        detected = used.get(items.ITEMS[head.family].get(1, ""))
        if detected is not None and len(detected) != 16 * head.n_points:
            raise items.ContentError(
                f"item 1 has {len(detected)} bytes for {head.n_points} points, expected 16 each: a demo of an SDK older than 3, "
                "or of another kind (medium range radar); flash the out-of-the-box demo of SDK 3"
            )
        points = self._points(head.family, used)
        if points is not None:
            points = points.with_side(used.get("side", b"")).sane()
        stats = used.get("stats", b"")
        processing = struct.unpack_from("<I", stats)[0] * 1e-6 if len(stats) >= 24 else float("nan")
        return Packet(**asdict(head), end=end, points=points, processing=processing, skipped=tuple(skipped), own=items.own_results(used))

    def _points(self, family: str, used: dict[str, bytes]) -> items.Points | None:
        if "packed" in used:
            return items.packed_points(used["packed"])
        if "compressed" in used:
            return items.compressed_points(used["compressed"])
        if "cartesian" in used:
            return items.float_points(used["cartesian"], "x y z doppler")
        if "spherical" in used:
            return items.float_points(used["spherical"], "range azimuth elevation doppler")
        if "cloud" not in used:
            return None
        return items.packed_points(used["cloud"]) if family == "people 3D" else self._old_points(used["cloud"])

    def _old_points(self, value: bytes) -> items.Points:
        """Read points of 16 bytes (flat) or 20 (with elevation): what the length allows, else as it was before."""
        possible = [columns for columns in (4, 5) if len(value) % (4 * columns) == 0]
        if len(possible) == 1:
            self._columns = possible[0]
        columns = self._columns or 4
        return items.float_points(value, "range azimuth doppler snr" if columns == 4 else "range azimuth elevation doppler snr")


def _items(head: Head, data: bytes) -> Iterator[tuple[int, bytes]]:
    """List type and value of the items; an `ItemError` says that one is longer than the packet."""
    at = head.size
    for _ in range(head.n_items):
        if at + 8 > len(data):
            raise items.ItemError(f"a packet of {len(data)} bytes has no room for its {head.n_items} items")
        kind, length = struct.unpack_from("<2I", data, at)
        if head.family.startswith("people"):
            if length == 0:  # an item without points, whose length the old demos set to 0
                at += 8
                continue
            length -= 8
        if not 0 <= length <= len(data) - at - 8:
            raise items.ItemError(f"item {kind} of a packet of {len(data)} bytes says it has {length}")
        yield kind, data[at + 8 : at + 8 + length]
        at += 8 + length
