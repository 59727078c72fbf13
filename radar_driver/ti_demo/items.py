"""Values of the items that hold points."""

from __future__ import annotations

import struct
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

Float64Array = NDArray[np.float64]

_DEMO: Final = {1: "cartesian", 6: "stats", 7: "side", 1000: "spherical", 1020: "packed"}
ITEMS: Final[Mapping[str, Mapping[int, str]]] = {
    "demo": _DEMO,
    "area scanner": {**_DEMO, 1: "spherical"},
    "people 3D": {6: "cloud"},
    "people 2D": {6: "cloud"},
}
"""What is used of each family, by type."""
_PACKED: Final = np.dtype([("elevation", "<i1"), ("azimuth", "<i1"), ("doppler", "<i2"), ("range", "<u2"), ("snr", "<u2")])
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


def decibel(ratio: Float64Array) -> Float64Array:
    """Express ratios of powers, shape (n,), in dB; what is not positive and finite is unknown (NaN)."""
    good = (ratio > 0) & np.isfinite(ratio)
    result = np.full(len(ratio), np.nan)
    np.log10(ratio, out=result, where=good)
    return 10 * result


NOTHING: Final = Points(None, np.empty((0, 3)), np.empty(0), np.empty(0), np.empty(0))  # no points
