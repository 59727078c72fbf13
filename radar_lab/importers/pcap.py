"""UDP datagrams out of network captures (classic .pcap), with the standard library only."""

from __future__ import annotations

import struct
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from radar_core import DataError

_MAGIC: Final = {0xA1B2C3D4: 1000, 0xA1B23C4D: 1}  # first word: nanoseconds per unit of the packets' fractional time
_PCAPNG: Final = 0x0A0D0D0A
_ETHERNET, _RAW_IP, _LINUX_SLL = 1, 101, 113
_LARGEST: Final = 1 << 18  # bytes: no capture has longer packets
_UDP: Final = 17


@dataclass(frozen=True)
class Datagram:
    """One UDP datagram."""

    stamp_ns: int  # when it was captured [ns since 1970]
    port: int  # where it went
    payload: bytes  # what it carried


def read_datagrams(path: Path, skipped: Counter[str]) -> Iterator[Datagram]:
    """Datagrams of a capture, in its order; packets that are no whole IPv4 UDP datagram are counted and passed over.

    Parameters
    ----------
    path : Path
        The .pcap file.
    skipped : Counter
        Gets the packets passed over, by reason.

    Raises
    ------
    DataError
        When the file is no pcap, is of a link type we do not know, or is cut off within a packet.
    """
    with path.open("rb") as stream:
        head = stream.read(24)
        order, unit, link = _header(path, head)
        number = 0
        while record := stream.read(16):
            number += 1
            if len(record) < 16:
                raise DataError(f"{path}: cut off within the header of packet {number}; capture again, or cut the file there")
            seconds, fraction, captured, original = struct.unpack(f"{order}4I", record)
            if captured > _LARGEST:
                raise DataError(f"{path}: packet {number} says it is {captured} bytes long: the file is garbled from there")
            packet = stream.read(captured)
            if len(packet) < captured:
                raise DataError(f"{path}: cut off within packet {number}; capture again, or cut the file there")
            found, reason = _udp(packet, link, whole=captured >= original)
            if found is None:
                skipped[reason] += 1
            else:
                yield Datagram(seconds * 1_000_000_000 + fraction * unit, *found)


def _header(path: Path, head: bytes) -> tuple[str, int, int]:
    """Byte order, nanoseconds per unit of fractional time, link type."""
    if len(head) == 24:
        for order in "<>":
            magic, _, _, _, _, _, link = struct.unpack(f"{order}IHHiIII", head)
            if magic in _MAGIC:
                if link & 0xFFFF not in (_ETHERNET, _RAW_IP, _LINUX_SLL):
                    raise DataError(f"{path}: link type {link} is not Ethernet, Linux cooked or raw IP; capture on the radar's interface")
                return order, _MAGIC[magic], link & 0xFFFF
    if len(head) >= 4 and struct.unpack("<I", head[:4])[0] == _PCAPNG:
        raise DataError(f"{path}: is a pcapng capture; turn it into a pcap first: editcap -F pcap {path.name} capture.pcap")
    raise DataError(f"{path}: is not a pcap capture")


def _udp(packet: bytes, link: int, *, whole: bool) -> tuple[tuple[int, bytes] | None, str]:
    """Port and payload of a UDP datagram, or why there is none."""
    start, kind = {_ETHERNET: (14, packet[12:14]), _LINUX_SLL: (16, packet[14:16]), _RAW_IP: (0, b"\x08\x00")}[link]
    if kind == b"\x81\x00":  # a VLAN tag
        start, kind = start + 4, packet[start + 2 : start + 4]
    ip = packet[start:]
    if kind != b"\x08\x00" or len(ip) < 20 or ip[0] >> 4 != 4 or ip[9] != _UDP:
        return None, "packets that are not UDP over IPv4"
    length = 4 * (ip[0] & 15)
    if struct.unpack(">H", ip[6:8])[0] & 0x3FFF:  # more fragments follow, or this is a later one
        return None, "fragments of UDP packets"
    if len(ip) < length + 8:
        return None, "truncated packets"
    port, size = struct.unpack(">HH", ip[length + 2 : length + 6])
    if not whole or size < 8 or len(ip) < length + size:
        return None, "truncated packets"
    return (port, ip[length + 8 : length + size]), ""
