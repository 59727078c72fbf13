"""Values of the items that hold points."""

from __future__ import annotations

import struct
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

Float64Array = NDArray[np.float64]

_DEMO: Final = {1: "cartesian", 6: "stats", 7: "side", 1000: "spherical", 1020: "packed"} | {
    301: "compressed", 308: "tracks", 351: "gesture", 352: "present", 354: "shares",
}  # fmt: skip
ITEMS: Final[Mapping[str, Mapping[int, str]]] = {
    "demo": _DEMO,
    "area scanner": {**_DEMO, 1: "spherical"},
    "people 3D": {6: "cloud"},
    "people 2D": {6: "cloud"},
}
"""What is used of each family, by type. Of the xWRL6432's, 350 (features) and 353 (a threshold) say nothing that could be passed on."""
_PACKED: Final = np.dtype([("elevation", "<i1"), ("azimuth", "<i1"), ("doppler", "<i2"), ("range", "<u2"), ("snr", "<u2")])
_COMPRESSED: Final = np.dtype([("xyz", "<i2", 3), ("doppler", "<i2"), ("snr", "u1"), ("noise", "u1")])
_TRACK: Final = np.dtype(
    [("slot", "<u4"), ("xyz", "<f4", 3), ("velocity", "<f4", 3), ("acceleration", "<f4", 3), ("error", "<f4", (4, 4)), ("rest", "<f4", 2)]
)
GESTURES: Final = ("", "swipe_right", "swipe_left", "swipe_down", "swipe_up", "push", "pull")
"""What the gesture demo of the xWRL6432 numbers from 0 (none), by our names; left and right are the user's, as its pictures show them."""
_FAR: Final = 1e4  # m and m/s; whatever is beyond is no point but bytes that went wrong


class ItemError(Exception):
    """A packet that contradicts itself; never leaves the parser."""


class ContentError(ItemError):
    """Items that fit into their packet, so that it was read in the right way, but whose values make no sense."""


@dataclass(frozen=True, eq=False)
class Points:
    """The points of a packet, as the board gives them: azimuth and x to the right, y forward, z up.

    Attributes
    ----------
    cartesian : ndarray, shape (n, 3) = (x, y, z), or None
        [m]; None: the board gave ranges and angles.
    spherical : ndarray, shape (n, 3) = (range, azimuth, elevation), or None
        [m, rad, rad]; elevations are NaN where the board measures none; None: the board gave positions.
    radial_speed, snr, noise : ndarray, shape (n,)
        Positive = receding [m/s]; [dB], NaN: not given.
    refused : int
        Points left out because they are no numbers, or absurdly far away.
    """

    cartesian: Float64Array | None
    spherical: Float64Array | None
    radial_speed: Float64Array
    snr: Float64Array
    noise: Float64Array
    refused: int = 0

    def __len__(self) -> int:
        return len(self.radial_speed)

    def with_side(self, value: bytes) -> Points:
        """Add what item 7 says: for every point SNR and noise in 0.1 dB; ignored where it is about another number of points."""
        if len(value) != 4 * len(self):
            return self
        side = np.frombuffer(value, "<i2").reshape(-1, 2) * 0.1
        return replace(self, snr=side[:, 0], noise=side[:, 1])

    def sane(self) -> Points:
        """Leave out points that cannot be."""
        place = self.cartesian if self.cartesian is not None else self.spherical
        assert place is not None
        known = np.nan_to_num(place, nan=0.0) if self.cartesian is None else place  # a flat radar's elevations are NaN by right
        good = (np.abs(known) < _FAR).all(axis=1) & (np.abs(self.radial_speed) < _FAR)
        if self.cartesian is None:
            good &= (place[:, 0] >= 0) & np.isfinite(place[:, 1])
        if good.all():
            return self
        cartesian, spherical = (None if place is None else place[good] for place in (self.cartesian, self.spherical))
        refused = int(len(good) - good.sum())
        return Points(cartesian, spherical, self.radial_speed[good], self.snr[good], self.noise[good], refused)


def packed_points(value: bytes) -> Points:
    """Read points of 8 bytes behind the five units that scale them (people counting 3D: item 1020, in old packets item 6).

    The SNR is the tracker's: a ratio of powers, 0 where there is none. A `ContentError` says that the units make no sense.
    """
    if len(value) < 20:
        return NOTHING
    units = struct.unpack_from("<5f", value)
    if not all(np.isfinite(unit) and 0 < unit < _FAR for unit in units):
        raise ContentError(f"points are in units of {units}, which make no sense")
    raw = np.frombuffer(value, _PACKED, count=(len(value) - 20) // _PACKED.itemsize, offset=20)
    elevation, azimuth, doppler, distance, snr = (raw[name] * float(unit) for name, unit in zip(_PACKED.names or (), units, strict=True))
    return Points(None, np.stack([distance, azimuth, elevation], axis=-1), doppler, decibel(snr), np.full(len(raw), np.nan))


def float_points(value: bytes, names: str) -> Points:
    """Read points of single-precision numbers; bytes that fill no whole point at the end are ignored.

    ``names`` are the numbers' in order: ``x y z`` or ``range azimuth`` with or without ``elevation``, ``doppler``, ``snr`` (a ratio).
    """
    columns = names.split()
    n = len(value) // (4 * len(columns))
    with np.errstate(invalid="ignore"):  # bytes that went wrong may be signalling NaNs
        numbers = np.frombuffer(value, "<f4", count=n * len(columns)).reshape(n, len(columns)).T.astype(np.float64)
    table = dict(zip(columns, numbers, strict=True))
    unknown = np.full(n, np.nan)
    snr = decibel(table["snr"]) if "snr" in table else unknown
    if "x" in table:
        return Points(np.stack([table["x"], table["y"], table["z"]], axis=-1), None, table["doppler"], snr, unknown)
    spherical = np.stack([table["range"], table["azimuth"], table.get("elevation", unknown)], axis=-1)
    return Points(None, spherical, table["doppler"], snr, unknown)


def compressed_points(value: bytes) -> Points:
    """Read points of 10 bytes behind the units of places, Doppler, SNR and noise (item 301); units that make no sense are refused."""
    if len(value) < 20:
        return NOTHING
    place, speed, snr, noise = units = struct.unpack_from("<4f", value)
    if not all(0 < unit < _FAR for unit in units):
        raise ContentError(f"item 301 has the units {units}, which no demo sends")
    raw = np.frombuffer(value, _COMPRESSED, offset=20, count=(len(value) - 20) // _COMPRESSED.itemsize)
    return Points(raw["xyz"] * float(place), None, raw["doppler"] * float(speed), raw["snr"] * float(snr), raw["noise"] * float(noise))


class Own(NamedTuple):
    """What the demo itself found: tracks of n people, a gesture, presence.

    Places and velocities are right, forward, up [m], [m/s], shape (n, 3); deviations those of range [m], azimuth and elevation [rad]. No
    `slot` (its numbers of tracks) means that it follows nobody at all, no `present` that it does not say.
    """

    slot: NDArray[np.int64] | None
    place: Float64Array
    velocity: Float64Array
    std: Float64Array
    gesture: str  # by our names; empty: none
    shares: dict[str, float]  # probabilities
    present: bool | None


def own_results(used: Mapping[str, bytes]) -> Own | None:
    """Read the demo's own tracks (308), gesture (351), presence (352) and probabilities (354); tracks that are no numbers are left out."""
    if not {"tracks", "gesture", "present", "shares"} & used.keys():
        return None
    value = used.get("tracks", b"")
    raw = np.frombuffer(value, _TRACK, count=len(value) // _TRACK.itemsize)
    with np.errstate(invalid="ignore"):
        place, velocity, error = (raw[name].astype(np.float64) for name in ("xyz", "velocity", "error"))
        variance = np.diagonal(error, axis1=1, axis2=2)[:, :3]
    good = (np.abs(place) < _FAR).all(1) & (np.abs(velocity) < _FAR).all(1) & ((variance >= 0) & (variance < _FAR)).all(1)
    good = good & np.isin(np.arange(len(raw)), np.unique(raw["slot"], return_index=True)[1])  # one number, one track
    number = used.get("gesture", b"\0")[:1]
    gesture = GESTURES[number[0]] if number and number[0] < len(GESTURES) else ""
    shares = np.frombuffer(used.get("shares", b""), "<f4", count=len(used.get("shares", b"")) // 4)
    named = {name: float(share) for name, share in zip(GESTURES, shares, strict=False) if name and 0 <= share <= 1}
    slot = raw["slot"][good].astype(np.int64) if "tracks" in used else None
    present = bool(used["present"][0]) if used.get("present") else None
    return Own(slot, place[good], velocity[good], np.sqrt(variance[good]), gesture, named, present)


def decibel(ratio: Float64Array) -> Float64Array:
    """Express ratios of powers, shape (n,), in dB; what is not positive and finite is unknown (NaN)."""
    good = (ratio > 0) & np.isfinite(ratio)
    result = np.full(len(ratio), np.nan)
    np.log10(ratio, out=result, where=good)
    return 10 * result


NOTHING: Final = Points(None, np.empty((0, 3)), np.empty(0), np.empty(0), np.empty(0))  # no points
