"""Heads of packets: which family of demos sent one, how long it is, and how many items follow."""

from __future__ import annotations

import struct
from dataclasses import dataclass
from typing import Final

from radar_driver.ti_demo.items import ItemError

MAGIC: Final = bytes((2, 1, 4, 3, 6, 5, 8, 7))
LONGEST: Final = 1 << 16
"""Bytes of the longest packet that is believed: 0.7 s of the line at 921600 baud; heat maps of a small frame fit."""
SHORTEST: Final = 40
_DEMOS: Final = (("demo", 40), ("area scanner", 44))


@dataclass(frozen=True)
class Head:
    """What a head says.

    Attributes
    ----------
    family : str
        ``demo``, ``area scanner``, ``people 3D`` or ``people 2D``, see `radar_driver.ti_demo.tlv`.
    size, length : int
        Bytes of the head, and of the whole packet.
    version : int
        Of the SDK: major, minor, bugfix and build in one byte each, the major one highest ("demo" only, else as it comes).
    platform : int
        Chip, in hexadecimal digits: 0xA6843 is an xWR6843.
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

    @property
    def old(self) -> bool:
        """Whether it is one of the older people-counting demos."""
        return self.family.startswith("people")


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
        raise ItemError("a header is cut off by the next packet: bytes were lost on the line")
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
        raise ItemError(
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
