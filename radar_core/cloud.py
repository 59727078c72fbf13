"""Point clouds: the detections of one frame."""

from __future__ import annotations

from dataclasses import KW_ONLY, dataclass, field, fields, replace
from enum import IntFlag

import numpy as np
from numpy.typing import NDArray

from radar_core.checks import require_every, require_shape
from radar_core.errors import DataError
from radar_core.geometry import Pose

Float32Array = NDArray[np.float32]
_FLOAT32 = np.dtype(np.float32)


class Quality(IntFlag):
    """What may be wrong with the frame behind a cloud; the constants of ``msg/PointCloud.msg``."""

    GOOD = 0
    SATURATED = 1
    MISSING_CHIRPS = 2
    NO_SIGNAL = 4
    CAPPED = 8
    STATIC_REMOVED = 16
    INCOMPLETE = 32


def _nan() -> Float32Array:
    return np.empty(0, np.float32)


@dataclass(frozen=True, eq=False)
class PointCloud:
    """The detections of one frame; every array has shape (n_points,), float32; NaN where the sensor does not measure.

    Attributes
    ----------
    stamp_ns : int
        Middle of the acquisition [ns].
    sequence : int
        Of the frame it was made from.
    frame_id : str
        Frame of x, y, z: the sensor's, or ``room`` after `to_room`.
    x, y, z : ndarray of float32
        Position in ``frame_id`` [m].
    range, azimuth, elevation : ndarray of float32
        As measured, in the sensor frame [m, rad, rad].
    radial_speed : ndarray of float32
        Range rate, positive = receding [m/s].
    snr, noise : ndarray of float32
        Signal over noise floor [dB] and the floor itself [dB]. An array left out is all NaN.
    range_std, azimuth_std, elevation_std, radial_speed_std : ndarray of float32
        Standard deviations of the estimates.
    quality : Quality
        What is wrong with the frame behind the points.
    every : int
        Clouds are made of one frame in so many: the first that comes of every so many sequences.

    Raises
    ------
    DataError
        When arrays differ in length or are not float32, or `every` is no whole number of at least 1.
    """

    stamp_ns: int
    sequence: int
    frame_id: str
    x: Float32Array
    y: Float32Array
    z: Float32Array
    _: KW_ONLY
    range: Float32Array = field(default_factory=_nan)
    azimuth: Float32Array = field(default_factory=_nan)
    elevation: Float32Array = field(default_factory=_nan)
    radial_speed: Float32Array = field(default_factory=_nan)
    snr: Float32Array = field(default_factory=_nan)
    noise: Float32Array = field(default_factory=_nan)
    range_std: Float32Array = field(default_factory=_nan)
    azimuth_std: Float32Array = field(default_factory=_nan)
    elevation_std: Float32Array = field(default_factory=_nan)
    radial_speed_std: Float32Array = field(default_factory=_nan)
    quality: Quality = Quality.GOOD
    every: int = 1

    def __post_init__(self) -> None:
        require_every("PointCloud.every", self.every)
        n = len(self.x)
        for name in ARRAY_FIELDS:
            array = getattr(self, name)
            if array.shape == (n,) and array.dtype is _FLOAT32:  # a cloud is made for every frame: the usual case comes first
                continue
            if array.dtype != np.float32:
                raise DataError(f"PointCloud.{name} is {array.dtype}, expected float32")
            if len(array) == 0 and n > 0 and name not in ("x", "y", "z"):
                object.__setattr__(self, name, np.full(n, np.nan, np.float32))
            else:
                require_shape(f"PointCloud.{name}", array, (n,))

    def __len__(self) -> int:
        return len(self.x)

    @property
    def position(self) -> Float32Array:
        """Positions, shape (n_points, 3) = (x, y, z) [m], a copy."""
        return np.stack([self.x, self.y, self.z], axis=-1)

    def select(self, index: NDArray[np.generic]) -> PointCloud:
        """Keep the points that a mask or an index array picks, in its order."""
        return replace(self, **{name: getattr(self, name)[index] for name in ARRAY_FIELDS})

    def to_room(self, mount: Pose) -> PointCloud:
        """Return the same points with x, y, z levelled into ``room``; what the sensor measured stays as measured.

        A `DataError` says that a place is infinite.
        """
        if self.frame_id == "room":
            return self
        position = self.position
        if np.isinf(position).any():
            raise DataError(f"cloud {self.sequence} of {self.frame_id!r} has infinite places; its sender is broken (NaN: not measured)")
        room = mount.to_room(position).astype(np.float32)
        return replace(self, frame_id="room", x=room[:, 0].copy(), y=room[:, 1].copy(), z=room[:, 2].copy())


ARRAY_FIELDS: tuple[str, ...] = tuple(f.name for f in fields(PointCloud) if f.type == "Float32Array")
"""Names of the per-point arrays. Their order means nothing: pair arrays with names where they are made."""
