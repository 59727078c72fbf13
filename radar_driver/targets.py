"""What boards that follow people themselves make of it: targets instead of points, gestures, presence."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from radar_core.checks import require_shape
from radar_core.geometry import spherical_to_cartesian

Float64Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Targets:
    """What a board itself follows at one moment, in the sensor's frame: x forward, y left, z up.

    Attributes
    ----------
    stamp_ns, sequence : int
        As of a cloud.
    frame_id : str
        Of the sensor.
    slot : ndarray of int64, shape (n,)
        The board's own number of each target. Boards use it again for somebody else.
    position, covariance : ndarray of float64, shape (n, 3), (n, 3, 3)
        [m], [m^2].
    velocity : ndarray of float64, shape (n, 3)
        [m/s]; NaN: the board does not follow it, so that a filter of ours does.
    radial_speed : ndarray of float64, shape (n,)
        Receding positive [m/s]; NaN: not measured.
    gesture, gestures : str, dict of str to float
        What the board has just recognised, empty: nothing; probability of every gesture, where it gives them.
    present, has_targets : bool or None, bool
        Whether somebody is there, None: it does not say; whether it follows targets at all, so that none means nobody.

    Raises
    ------
    DataError
        When the arrays do not belong together.
    """

    stamp_ns: int
    sequence: int
    frame_id: str
    slot: NDArray[np.int64] = field(default_factory=lambda: np.zeros(0, np.int64))
    position: Float64Array = field(default_factory=lambda: np.zeros((0, 3)))
    covariance: Float64Array = field(default_factory=lambda: np.zeros((0, 3, 3)))
    velocity: Float64Array = field(default_factory=lambda: np.zeros((0, 3)))
    radial_speed: Float64Array = field(default_factory=lambda: np.zeros(0))
    gesture: str = ""
    gestures: dict[str, float] = field(default_factory=dict)
    present: bool | None = None
    has_targets: bool = True

    def __post_init__(self) -> None:
        n = len(self.slot)
        for name, shape in (("position", (n, 3)), ("covariance", (n, 3, 3)), ("velocity", (n, 3)), ("radial_speed", (n,))):
            require_shape(f"Targets.{name}", getattr(self, name), shape)

    def __len__(self) -> int:
        return len(self.slot)


def place_covariance(place: Float64Array, range_std: Any, azimuth_std: Any, height_std: Any) -> Float64Array:
    """Covariances [m^2], shape (n, 3, 3), of places [m], shape (n, 3), by how well range [m], direction [rad] and height [m] are known."""
    distance, azimuth = np.hypot(place[:, 0], place[:, 1]), np.arctan2(place[:, 1], place[:, 0])
    along, across = (spherical_to_cartesian(1.0, azimuth + more, 0.0) for more in (0.0, np.pi / 2))
    parts = ((along, range_std), (across, distance * azimuth_std), (np.broadcast_to([0.0, 0.0, 1.0], place.shape), height_std))
    each = (np.square(np.broadcast_to(std, len(place)))[:, None, None] * axis[:, :, None] * axis[:, None, :] for axis, std in parts)
    return np.asarray(sum(each))
