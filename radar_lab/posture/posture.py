"""Both hands of every person from sparse clouds of one radar: learned, where points are too few to follow a hand (no thesis section).

`HandTracker` follows the points of one hand and needs a cloud that has some. A radar with ten to thirty points a cloud and an azimuth good
to tens of centimetres often has none there, but a raised arm shows in all of the person's points and in what they did lately.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from radar_core import RadarInfo
from radar_core.config import config, knob
from radar_core.types import Float64Array
from radar_lab.posture.features import PostureFeatures, Seen, mirror
from radar_lab.posture.model import PostureModel
from radar_tracking.tracks import TrackedCloud

_FLIP = np.array([1.0, -1.0, 1.0])  # (away, left, up) in a mirror


@config
class PostureConfig:
    """What `PostureTracker` can be told beside its model."""

    hold: float = knob(1.0, unit="s", low=0.01, high=60.0, doc="unseen for as long, 63 % of what is known of the hands is lost")
    lost_after: float = knob(5.0, unit="s", low=0.0, high=600.0, doc="a person without any point for longer has no posture")


@dataclass(frozen=True, eq=False)
class Posture:
    """Both hands of one person."""

    track_id: int  # whose
    position: Float64Array  # the person's left and right hand in ``room``, shape (2, 3) = (hand, axis) [m]
    # Standard deviations along the axes of ``room`` [m]; for people and movements like those of the training; shape (2, 3) = (hand, axis)
    std: Float64Array
    n_points: int  # points of the cloud that are the person's
    unseen: float  # since the person had a point [s]


@dataclass(frozen=True, eq=False)
class Postures:
    """The hands of all people after one cloud."""

    # stamp_ns, sequence: of the cloud
    stamp_ns: int
    sequence: int
    frame_id: str  # always ``room``
    people: tuple[Posture, ...]  # in the order of their tracks

    def find(self, track_id: int) -> Posture | None:
        """Return the posture of the track with this id, or None."""
        return next((posture for posture in self.people if posture.track_id == track_id), None)


class PostureTracker:
    """Give both hands of every confirmed person, cloud by cloud, from this cloud and the ones before.

    Left and right are the person's own, who faces the radar. Where the radar stands ``info`` says; None: at the room's origin. The model is
    one of `radar_lab.posture.training.train_postures` or `radar_lab.posture.model.load_postures`.
    """

    def __init__(self, model: PostureModel, config: PostureConfig | None = None, info: RadarInfo | None = None) -> None:
        self.config = config if config is not None else PostureConfig()
        self.model = model
        self._features = PostureFeatures(model.features)
        self._origin = np.zeros(3)
        if info is not None:
            self.seen_from(info)
        self.reset()

    def reset(self) -> None:
        """Forget everything. For a new recording."""
        self._features.reset()
        self._last: dict[int, tuple[int, Float64Array, Float64Array]] = {}  # stamp, places and variances when there were points

    def seen_from(self, info: RadarInfo) -> None:
        """Learn where the sensor stands."""
        self._origin = np.asarray(info.mount.origin, np.float64)

    def process(self, tracked: TrackedCloud) -> Postures:
        """Take in one cloud with its tracks, in ``room``, not older than the one before.

        Points without height are left out; a range rate that is NaN counts as 0. People without a point keep their hands where they were,
        less and less sure. Raises `DataError` when the cloud is not in ``room``, older than the one before, or a position, a range rate or
        a track is infinite.
        """
        cloud = tracked.cloud
        people = []
        last: dict[int, tuple[int, Float64Array, Float64Array]] = {}
        for seen in self._features.process(tracked, self._origin):
            known = self._estimate(seen, cloud.stamp_ns) if seen.n_points else self._last.get(seen.track.id)
            if known is None:
                continue
            last[seen.track.id] = known
            unseen = (cloud.stamp_ns - known[0]) * 1e-9
            if unseen <= self.config.lost_after:
                people.append(self._posture(seen, known[1], known[2], unseen))
        self._last = last
        return Postures(cloud.stamp_ns, cloud.sequence, cloud.frame_id, tuple(people))

    def _estimate(self, seen: Seen, stamp_ns: int) -> tuple[int, Float64Array, Float64Array]:
        """Say where the hands are: the left one, and the mirror image of the mirrored person's left one; both in the person's axes."""
        left, right = self.model.predict(np.stack([seen.features, mirror(seen.features, self.model.features)]))
        return stamp_ns, np.stack([left, right * _FLIP]), self.model.std.astype(np.float64) ** 2

    def _posture(self, seen: Seen, own: Float64Array, variance: Float64Array, unseen: float) -> Posture:
        """Make the result. A place ``unseen`` seconds old and the present one are like two samples of an Ornstein-Uhlenbeck process."""
        grown = variance - 2.0 * self.model.spread.astype(np.float64) ** 2 * np.expm1(-unseen / self.config.hold)
        std = seen.frame.std_in_room(np.sqrt(grown))
        return Posture(seen.track.id, seen.frame.to_room(own), np.tile(std, (2, 1)), seen.n_points, unseen)
