"""The second radar's mount from one person who walks through both fields of view."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from radar_core import PointCloud, Pose, RadarInfo
from radar_core.config import config, knob, plain
from radar_core.errors import DataError
from radar_core.mounting import MountCalibration
from radar_core.types import Float64Array
from radar_lab.alignment.trajectory import Trajectory, TrajectoryAlignment, TrajectoryConfig
from radar_lab.alignment.trajectory_fit import align_trajectories
from radar_lab.figures import new_figure, save_figure
from radar_tracking.people.config import TrackerConfig
from radar_tracking.people.make import make_tracker

GOOD_POSITION, GOOD_YAW = 0.02, math.radians(0.5)
"""What a calibration is expected to be as sure as (standard deviations) [m, rad]."""
_LONG = 30.0  # s: what is shorter is warned of
_WALK = TrajectoryConfig(depth_std=0.015, depth_difference_std=0.003)


@config
class PairConfig:
    """How two radars are calibrated to each other."""

    tracker: TrackerConfig = TrackerConfig()
    alignment: TrajectoryConfig = _WALK
    surface: float = knob(
        0.072, unit="m", low=0.0, high=1.0, doc="the centre of a body that walks lies this far behind the mean of its points"
    )
    range_std: float = knob(0.04, unit="m", low=1e-4, high=10.0, doc="how far that centre is off along the line of sight")
    cross_std: float = knob(0.047, unit="m", low=1e-4, high=10.0, doc="and across it: echoes wander over the body")
    azimuth_std: float = knob(0.006, unit="rad", low=0.0, high=1.0, doc="and what a direction is off in addition")
    min_points: int = knob(2, low=1, high=1000, doc="clouds in which the person has fewer points are left out")
    most_company: float = knob(0.5, low=0.0, high=1.0, doc="a walk of which more than this share shows several people is refused")


class Walker:
    """Collects where a radar saw the only person, in its own levelled frame, cloud by cloud.

    The tracker says which points are the person's. Where the person is comes from these points alone: what the tracker makes of them is
    smooth, but late and wrong for a third of a second at a time; the mean of the points is wrong anew in almost every cloud.

    Parameters
    ----------
    config : PairConfig
        Knobs.
    info : RadarInfo
        The radar. Of its mount only height and tilt are used.

    Attributes
    ----------
    clouds, company : int
        Clouds taken in so far; of these, those with more than one person, which are left out.
    """

    def __init__(self, config: PairConfig, info: RadarInfo) -> None:
        self.info, self._config = info, config
        self._level = Pose(z=info.mount.z, tilt=info.mount.tilt)
        self._tracker = make_tracker(config.tracker, replace(info, mount=self._level))
        self.clouds = self.company = 0
        self._stamps: list[int] = []
        self._places: list[Float64Array] = []

    def process(self, cloud: PointCloud) -> None:
        """Take in the radar's next cloud, in the sensor's frame.

        Raises `DataError` when it is from another frame, or older than the one before.
        """
        if cloud.frame_id != self.info.frame_id:
            raise DataError(
                f"a cloud is in {cloud.frame_id!r}, the radar's info says {self.info.frame_id!r}; each radar needs its own topics"
            )
        self.clouds += 1
        level = cloud.to_room(self._level)
        tracks = self._tracker.process(level)
        people = list(tracks.people)
        self.company += len(people) > 1
        if len(people) != 1 or (self._stamps and cloud.stamp_ns <= self._stamps[-1]):
            return
        own = np.flatnonzero(tracks.point_track_id == people[0].id)
        if len(own) >= self._config.min_points:
            self._stamps.append(cloud.stamp_ns)
            points = level.position[own].astype(np.float64)
            # All points count alike: strong ones belong to whatever part of the body happens to face the radar.
            distance, azimuth = np.hypot(points[:, 0], points[:, 1]), np.arctan2(points[:, 1], points[:, 0])
            self._places.append(np.array([distance.mean(), azimuth.mean(), points[:, 2].mean()]))

    @property
    def height(self) -> float:
        """Median height of the person's points [m]; NaN: nobody was seen."""
        return float(np.median([place[2] for place in self._places])) if self._places else math.nan

    def trajectory(self, config: PairConfig | None = None) -> Trajectory:
        """Give the places of the body's centre, on the floor plane, with other knobs of depth and sureness than those of the walk, if any.

        Raises `DataError` when nobody was seen, or mostly more than one person.
        """
        name, config = self.info.frame_id, config or self._config
        if self.company > config.most_company * max(self.clouds, 1):
            raise DataError(f"{name} sees more than one person in {self.company} of {self.clouds} clouds; let one person walk alone")
        if not self._stamps:
            raise DataError(f"{name} sees nobody in {self.clouds} clouds; walk where both radars can see you, 1 to 5 m in front of them")
        distance, azimuth, _ = np.array(self._places).T
        distance = distance + config.surface
        along = np.stack([np.cos(azimuth), np.sin(azimuth)], axis=1)
        across = np.stack([-along[:, 1], along[:, 0]], axis=1)
        variance = config.cross_std**2 + (config.azimuth_std * distance) ** 2
        covariance = (
            config.range_std**2 * along[:, :, None] * along[:, None] + variance[:, None, None] * across[:, :, None] * across[:, None]
        )
        return Trajectory(np.array(self._stamps, np.int64), distance[:, None] * along, covariance)


@dataclass(frozen=True, eq=False)
class PairCalibration:
    """The mount of the second radar, as measured."""

    mount: MountCalibration  # what is written to a file
    alignment: TrajectoryAlignment  # how it was found, in the first radar's levelled frame
    # first, second: what it was found from, each in its radar's levelled frame
    first: Trajectory
    second: Trajectory
    seconds: float  # from the first pair of positions to the last [s]
    # Median height of the second radar's points less that of the first one's [m]: a check of heights and tilts, which are taken as given
    height_difference: float

    @property
    def std(self) -> tuple[float, float, float]:
        """Standard deviations of x, y [m] and yaw [rad]."""
        x, y, yaw = np.sqrt(np.diagonal(np.array(self.mount.covariance))).tolist()
        return x, y, yaw

    def notes(self) -> list[str]:
        """Say what a user should look at; empty: all is well."""
        found, (x, y, yaw) = self.alignment, self.std
        notes = []
        if math.hypot(x, y) > GOOD_POSITION or yaw > GOOD_YAW:
            notes.append(f"less sure than {GOOD_POSITION * 1e3:g} mm and {math.degrees(GOOD_YAW):g} degrees: walk for longer, near and far")
        if self.seconds < _LONG:
            notes.append(f"both radars saw the person for {self.seconds:.0f} s only; a minute is recommended")
        if found.inlier_share < 0.7:
            notes.append(f"only {found.inlier_share:.0%} of the pairs agree; did one person walk alone, without furniture between?")
        if found.scale > 2.0:
            notes.append(f"positions scatter {found.scale:.1f} times as much as those of a person should")
        if abs(self.height_difference) > 0.15:
            notes.append(
                f"points are {self.height_difference:+.2f} m higher for the second radar: check heights and tilts, which are taken as given"
            )
        if found.std.get("offset", math.inf) * 4 < abs(found.offset) and abs(found.offset) > 0.005:
            notes.append(f"the clocks are {found.offset * 1e3:.1f} ms apart: synchronise them (PTP), fusion does not correct it")
        return notes


def calibrate_pair(first: Walker, second: Walker, config: PairConfig | None = None) -> PairCalibration:
    """Find where the second radar stands, by what both saw of one person who walked.

    The first radar's mount is taken as it is, the second one's height and tilt too: heights of a person's points scatter by decimetres.

    Parameters
    ----------
    first, second : Walker
        That have taken in all clouds.
    config : PairConfig or None
        Knobs; those of the tracker were used already.

    Raises
    ------
    DataError
        When a radar saw nobody, or several people, or the two did not see the same.
    NotObservableError
        When the walk does not tell the pose.
    """
    config = config or PairConfig()
    a, b = first.trajectory(config), second.trajectory(config)
    found = align_trajectories(a, b, config.alignment)
    base, given = first.info.mount, second.info.mount
    c, s = math.cos(base.yaw), math.sin(base.yaw)
    turn = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    x, y = (turn[:2, :2] @ found.translation + [base.x, base.y]).tolist()
    mount = Pose(x=x, y=y, z=given.z, yaw=math.remainder(base.yaw + found.yaw, 2 * math.pi), tilt=given.tilt)
    rows = (turn @ found.part(("x", "y", "yaw")) @ turn.T).tolist()
    stamp = b.stamp_ns[found.used]
    return PairCalibration(
        MountCalibration(
            radar=second.info.frame_id,
            reference=first.info.frame_id,
            mount=mount,
            covariance=(tuple(rows[0]), tuple(rows[1]), tuple(rows[2])),
            clock_offset=found.offset,
            clock_offset_std=found.std.get("offset", 0.0),
        ),
        found,
        a,
        b,
        float(stamp[-1] - stamp[0]) * 1e-9,
        second.height - first.height,
    )


def rows(result: PairCalibration) -> Iterator[tuple[str, str, str]]:
    """Name, value and standard deviation of everything worth telling."""
    mount, found = result.mount.mount, result.alignment
    x, y, yaw = result.std
    yield "x", f"{mount.x:.4f} m", f"{x * 1e3:.1f} mm"
    yield "y", f"{mount.y:.4f} m", f"{y * 1e3:.1f} mm"
    yield "yaw", f"{np.degrees(mount.yaw):.3f} degrees", f"{np.degrees(yaw):.3f} degrees"
    yield "height", f"{mount.z:.3f} m", "as given"
    yield "tilt", f"{np.degrees(mount.tilt):.2f} degrees", "as given"
    if "offset" in found.names:
        yield "clock offset", f"{found.offset * 1e3:.1f} ms", f"{found.std['offset'] * 1e3:.1f} ms"
    yield "pairs", f"{found.pairs} in {result.seconds:.1f} s", f"worth {found.n_effective:.0f} independent ones"
    yield "agreeing", f"{found.inlier_share:.0%}", f"rms {found.rms * 1e3:.0f} mm"
    yield "condition", f"{found.condition:.1f}", f"rank {found.rank} of {len(found.names)}"


def draw(result: PairCalibration, path: Path) -> None:
    """Draw both trajectories before and after, in the first radar's levelled frame. Raises `DataError` when it cannot be written."""
    figure = new_figure(12, 7, 120)
    first, second, found = result.first.position, result.second.position, result.alignment
    good = found.weight >= 0.5
    pictures = (("before: each radar at the origin", second), (f"after: rms {found.rms * 1e3:.0f} mm", found.apply(second)))
    for axes, (title, moved) in zip(figure.subplots(1, 2), pictures, strict=True):
        axes.plot(first[:, 1], first[:, 0], ".", markersize=3, label=result.mount.reference)
        axes.plot(moved[:, 1], moved[:, 0], ".", markersize=3, label=result.mount.radar)
        axes.set(title=title, xlabel="y [m]", ylabel="x [m]")
        axes.set_aspect("equal", adjustable="datalim")
        axes.invert_xaxis()  # as seen from above, the radar's left on the left
    wrong = found.apply(second[found.used[~good]])
    axes.plot(wrong[:, 1], wrong[:, 0], "x", color="0.5", markersize=3, label="not used")
    axes.legend(loc="lower right")
    save_figure(figure, path)


def as_json(result: PairCalibration) -> dict[str, Any]:
    """Give the same as one JSON object."""
    found = result.alignment
    names = ("pairs", "n_effective", "correlation_time", "inlier_share", "rms", "condition")
    return {
        **plain(result.mount),
        "std": dict(zip(("x", "y", "yaw"), result.std, strict=True)),
        **{name: getattr(found, name) for name in names},
        "seconds": result.seconds,
        "height_difference": result.height_difference,
        "notes": result.notes(),
    }
