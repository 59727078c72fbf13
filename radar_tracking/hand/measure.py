"""One measurement from the hand's points: position, velocity, range rate."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from radar_core.linalg import symmetrise
from radar_core.types import Float64Array
from radar_tracking.estimators.base import VelocityMeasurement
from radar_tracking.hand.candidates import Candidates, outward
from radar_tracking.hand.config import HandConfig

if TYPE_CHECKING:
    from radar_tracking.estimators.snapshot import Snapshot, SnapshotVelocity


_LEAST_AGREEMENT = 0.5  # length of a mean of directions
_ASSUMED_Z_STD = 0.3  # m: where no point measures the height, the hand is assumed as high as the body


@dataclass(frozen=True, eq=False)
class HandMeasurement:
    """What one cloud says about the hand: place, range rate and velocity of one track in 3-D, and how well the velocity is told."""

    state: VelocityMeasurement
    snapshot: SnapshotVelocity


class HandMeter:
    """Makes one measurement of the points of a hand; holds no state."""

    def __init__(self, config: HandConfig) -> None:
        self._config = config
        self._snapshot: Snapshot | None = None

    def process(self, points: Candidates, body: Float64Array, near: Float64Array, speed: float | None = None) -> HandMeasurement:
        """Measure the weighted centroid of the hand's points, at least one, and its velocity.

        ``body``, shape (3,) [m], is where the person is, ``near``, shape (3,) [m], about where the hand is: points farther out that way
        from the shoulder count more, for the hand is the arm's end. ``speed`` is about how fast the hand is [m/s]; None: not known.
        """
        along = outward(points.position, body, near)
        share = points.amplitude * np.exp((along - along.max()) / self._config.hand_length)
        place, covariance = self._place(points, share, float(body[2]))
        offset = points.position - place
        offset[np.isnan(offset)] = 0.0
        if self._snapshot is None:  # loaded with the first hand
            from radar_tracking.estimators.snapshot import Snapshot

            self._snapshot = Snapshot(self._config.snapshot)
        found = self._snapshot.process(
            points.direction, points.rate, points.rate_std, offset=offset, sensor=points.sensor, amplitude=points.amplitude, speed=speed
        )
        rate, variance, origin = self._rate(points, share, place, self._config.snapshot.factor(speed))
        state = VelocityMeasurement(
            place[None], covariance[None], rate, variance, origin[None],
            found.along[None], np.diag(np.where(np.isnan(found.along), np.nan, found.std**2))[None], found.axes[None],
        )  # fmt: skip
        return HandMeasurement(state, found)

    def _place(self, points: Candidates, share: Float64Array, height: float) -> tuple[Float64Array, Float64Array]:
        """Weighted centroid (3,) [m] and its covariance (3, 3): errors of points, extent of the hand, offset of a centroid from a hand."""
        place, covariance = np.empty(3), self._config.position_std**2 * np.eye(3)
        extent = self._config.extent**2
        errors = _errors(points)
        known = np.isfinite(points.position[:, 2])
        for rows, axes in ((np.ones(len(points), np.bool_), slice(0, 2)), (known, slice(2, 3))):
            total = float(share[rows].sum())
            if total <= 0:
                place[axes] = height
                covariance[axes, axes] += _ASSUMED_Z_STD**2
                continue
            part = share[rows] / total
            value = points.position[rows, axes]
            place[axes] = part @ value
            alone = (part**2).sum()  # one over the effective number of points
            covariance[axes, axes] += (part**2 * errors[rows, axes, axes].T).sum(-1) + alone * extent * np.eye(value.shape[1])
        return place, symmetrise(covariance)

    def _rate(
        self, points: Candidates, share: Float64Array, place: Float64Array, faster: float
    ) -> tuple[Float64Array, Float64Array, Float64Array]:
        """Range rate (1,) from the sensor that sees most of the hand, its variance (1,), and a place 1 m back that way, shape (3,) [m].

        ``faster``: by how much its errors are larger than those of a hand at 1 m/s.
        """
        known = ~np.isnan(points.rate)
        if not known.any():
            return np.full(1, np.nan), np.ones(1), place - np.array([1.0, 0.0, 0.0])
        sensor = np.bincount(points.sensor[known], share[known]).argmax()
        own = known & (points.sensor == sensor)
        part = share[own] / share[own].sum()
        config = self._config.snapshot
        variance = (faster * config.common) ** 2 + float((part**2) @ (points.rate_std[own] ** 2 + (faster * config.spread) ** 2))
        direction = part @ points.direction[own]
        length = float(np.linalg.norm(direction))
        if length < _LEAST_AGREEMENT:  # points all around their sensor: the mean of their rates is nobody's rate
            return np.full(1, np.nan), np.ones(1), place - np.array([1.0, 0.0, 0.0])
        return np.array([part @ points.rate[own]]), np.array([variance]), place - direction / length


def _errors(points: Candidates) -> Float64Array:
    """Covariance of each point's own error in ``room``, shape (n, 3, 3) [m^2]."""
    u = points.direction
    across = np.stack([-u[:, 1], u[:, 0], np.zeros(len(u))], axis=1)
    across /= np.maximum(np.linalg.norm(across, axis=1), 1e-9)[:, None]
    frame = np.stack([u, across, np.cross(u, across)], axis=2)  # columns: along, across, up
    return np.asarray((frame * points.error[:, None, :] ** 2) @ np.swapaxes(frame, 1, 2))
