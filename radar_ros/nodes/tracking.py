"""Tracking node: radar/points to tracks."""

from __future__ import annotations

import contextlib
import time
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from handwave.msg import PointCloud as PointCloudMsg
from handwave.msg import TrackArray as TrackArrayMsg
from numpy.typing import NDArray
from std_msgs.msg import UInt32

from radar_core import HandwaveError, PointCloud, RadarInfo
from radar_core.config import config, knob
from radar_core.linalg import SingularError, balanced
from radar_ros import qos
from radar_ros.budget import Budget
from radar_ros.messages.convert import cloud_from_msg, stride
from radar_ros.messages.tracks import tracks_to_msg
from radar_ros.params import declare_config
from radar_ros.stage import InfoKeeper, StageNode, run
from radar_tracking import PeopleTracker, TrackerConfig, Tracks, TrackStatus
from radar_tracking.metrics import Consistency, ConsistencyConfig, ConsistencyMonitor
from radar_tracking.people.zones import Zones, ZonesConfig
from radar_tracking.tracks import Reason

_WARM_UP = 50  # clouds at 50 Hz: enough for two people to be found, followed and confirmed, and to come so near that their points merge
_ALONE = 10  # of these show one person: arrays of one row are contiguous where others are not, which is another type for numba
_APART = 30  # before this one the two are 0.9 m apart


@config
class TrackConsistencyConfig(ConsistencyConfig):
    """When the filter of people counts as inconsistent.

    The errors of one body's echoes hang together for tenths of a second, so that a filter which is right about its position expects far
    more change from one cloud to the next than it sees: with the default settings the NIS per degree of freedom of simulated people lies
    between 0.03 and 0.35. Only what lies far below says that the noise is set too high.
    """

    low: float = knob(0.01, low=0.0, high=1.0, doc="means of NIS per degree of freedom down to this are accepted")


class Tally:
    """What the tracks say about the tracker, for the diagnostics.

    Parameters
    ----------
    zones : ZonesConfig
        Whose people are counted.
    consistency : ConsistencyConfig
        When the filter counts as inconsistent.
    """

    def __init__(self, zones: ZonesConfig, consistency: ConsistencyConfig) -> None:
        self._zones = Zones(zones)
        self._monitor = ConsistencyMonitor(consistency)
        self._status: Counter[TrackStatus] = Counter()
        self._deleted: Counter[Reason] = Counter()
        self._people: dict[str, int] = dict.fromkeys(zones.counted, 0)
        self._consistency: Consistency | None = None
        self._covariances: list[NDArray[np.float64]] = []

    def add(self, tracks: Tracks) -> None:
        """Take in the tracks after one cloud.

        Raises
        ------
        DataError
            When the NIS of a track is no number.
        """
        self._status = Counter(track.status for track in tracks.tracks)
        self._deleted.update(track.reason for track in tracks.deleted)
        self._people = self._zones.process(tracks)
        self._covariances = [track.covariance for track in tracks.tracks]
        updated = [track for track in tracks.tracks if track.status is TrackStatus.CONFIRMED and track.dof > 0]
        nis, dof = np.array([track.nis for track in updated]), np.array([track.dof for track in updated], np.int64)
        self._consistency = self._monitor.process(tracks.stamp_ns, nis, dof)

    def report(self) -> tuple[dict[str, Any], list[str]]:
        """Values for the diagnostics, and what to warn of: tracks and people of the last cloud, deletions since the start."""
        values: dict[str, Any] = {f"tracks_{status.name.lower()}": self._status[status] for status in TrackStatus}
        values |= {f"deleted_{reason.name.lower()}": self._deleted[reason] for reason in Reason}
        values |= {f"zone.{name}": count for name, count in self._people.items()}
        values["covariance_condition"] = _worst_condition(self._covariances)
        found = self._consistency
        if found is None or not found.samples:
            return {**values, "nis_ratio": "unknown", "nis_accepted": "unknown", "consistency": "unknown"}, []
        values |= {
            "nis_ratio": f"{found.ratio:.3g}",
            "nis_accepted": f"{found.low:.3g} to {found.high:.3g}",
            "consistency": found.state,
        }
        return values, [found.warning] if found.warning else []


def _worst_condition(covariances: Sequence[NDArray[np.float64]]) -> str:
    """Say how nearly one state of a track follows from its others; units are scaled away."""
    try:
        return f"{max(float(np.linalg.cond(balanced(P)[0])) for P in covariances):.3g}" if covariances else "unknown"
    except SingularError:
        return "singular"


class TrackingNode(StageNode):
    """Follows people through point clouds, within a time budget where there is one."""

    def __init__(self, **kwargs: Any) -> None:
        super().__init__("tracking", **kwargs)
        self._config = declare_config(self, TrackerConfig)
        self._budget = Budget(self, self._config, self._prepare_levels)
        self._tally = Tally(self._config.zones, declare_config(self, TrackConsistencyConfig, "consistency."))
        self._tracker: PeopleTracker | None = None
        self._dropped_points = 0  # before the tracker was reset
        for level in set(self._budget.configs):
            warm_up(level)
        self._tracks = self.create_publisher(TrackArrayMsg, "tracks", qos.RESULT)
        self._count = self.create_publisher(UInt32, "people_count", qos.RESULT)
        self._info = InfoKeeper(self, self._configure)
        self.create_subscription(PointCloudMsg, "radar/points", self._take, qos.sensor(reliable=self.reliable))

    def _configure(self, info: RadarInfo) -> None:
        self._tracker = PeopleTracker(self._budget.configs[self._budget.number], info)
        self.get_logger().info(f"clouds come from {info.frame_id}, mounted {info.mount.z:g} m above the floor")

    def _prepare_levels(self, configs: tuple[TrackerConfig, ...]) -> Callable[[], None]:
        """Compile what other levels of the budget need."""
        for level in set(configs):
            warm_up(level)
        return lambda: None  # the level is looked up with every cloud

    def _take(self, msg: Any) -> None:
        started, worked, every = time.monotonic_ns(), time.thread_time_ns(), stride(msg) * self._budget.every
        if not self.due(msg.sequence, every):  # left out to keep within the budget, and said so on stage_budget
            return
        self.count_gap(msg.sequence, every)
        info, tracker = self._info.info, self._tracker
        if not self._info.usable() or info is None or tracker is None:
            self.dropped += 1
            return
        try:
            cloud = cloud_from_msg(msg).to_room(info.mount)
            if self.went_back(cloud.stamp_ns):
                self._dropped_points += tracker.dropped_points
                tracker.reset()
            config = self._budget.configs[self._budget.number]
            if config is not tracker.config:
                tracker.change(config)
            tracks = replace(tracker.process(cloud), every=every)
        except HandwaveError as error:
            self.dropped += 1
            self.problem(str(error))
            return
        self._tracks.publish(tracks_to_msg(tracks))
        self._budget.slow_down(worked)
        self.finish(tracks.stamp_ns, tracks.sequence, started)
        self._budget.spent(tracks.stamp_ns, started)
        self._count.publish(UInt32(data=tracks.people_count))
        self._note(tracks)

    def _note(self, tracks: Tracks) -> None:
        """Remember what the diagnostics say; what is wrong with it costs no tracks."""
        try:
            self._tally.add(tracks)
        except HandwaveError as error:
            self.problem(f"the filter's consistency is unknown: {error}")

    def extra_diagnostics(self) -> tuple[dict[str, Any], list[str]]:
        """Tracks by status, deletions by reason, people by zone, points without a place, and whether the filter knows how wrong it is."""
        values, warnings = self._tally.report()
        values["dropped_points"] = self._dropped_points + (self._tracker.dropped_points if self._tracker is not None else 0)
        more, worse = self._budget.report()
        return {**values, **more}, warnings + worse


def warm_up(settings: TrackerConfig) -> None:
    """Compile what the settings need, by following two made-up people; a node that subscribes only then loses no cloud meanwhile.

    Parameters
    ----------
    settings : TrackerConfig
        Those of the tracker that is to be fast; zones and bounds make no difference.
    """
    everywhere = TrackerConfig(tracker=settings.tracker, association=settings.association, filter=settings.filter)
    tracker = PeopleTracker(everywhere)
    rng = np.random.default_rng(1)
    with contextlib.suppress(HandwaveError):  # what is wrong with the settings is said when they are used
        for k in range(_WARM_UP):
            tracker.process(_made_up(rng, k))


def _made_up(rng: np.random.Generator, sequence: int) -> PointCloud:
    """Make a cloud of a body that walks, and later of a second one that joins it."""
    aside = 0.45 - 0.0175 * max(sequence - _APART, 0)
    bodies = [[2.0, aside, 1.0], [2.0, -aside, 1.0]][: 1 if sequence < _ALONE else 2]
    centre = np.repeat(bodies, 30, axis=0)
    centre[:, 0] += 0.02 * sequence
    x, y, z = (centre + rng.normal(0.0, 0.05, centre.shape)).astype(np.float32).T
    speed = rng.normal(1.0, 0.2, len(centre)).astype(np.float32)
    cloud = PointCloud(20_000_000 * sequence, sequence, "room", x=x, y=y, z=z)
    return replace(cloud, radial_speed=speed, snr=np.full(len(centre), 20.0, np.float32))


def make_node(**kwargs: Any) -> TrackingNode:
    """Make the node; ``kwargs`` go to rclpy's Node."""
    return TrackingNode(**kwargs)


def main(argv: Sequence[str] | None = None) -> int:
    """Run the node until it is told to stop."""
    return run(make_node, argv)


if __name__ == "__main__":
    raise SystemExit(main())
