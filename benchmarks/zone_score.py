"""How right zones are: counts and presence against the truth in rooms with people, and false presence in empty ones."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray
from scipy.stats import chi2

from benchmarks.report import timed
from benchmarks.room_score import KeptRoom
from radar_core import PointCloud, RadarInfo
from radar_sim import Truth
from radar_tracking import Track, TrackerConfig, Tracks, TrackStatus, make_tracker
from radar_tracking.people.zones import ZonesConfig
from radar_tracking.zones import LayoutConfig, Presence, ZoneMonitor

SLACK: Final = 0.3  # m: whoever is so near to a side may be counted or not
_DRAWS: Final = 1000  # of rooms, for an interval


@dataclass(frozen=True, eq=False)
class ZoneScore:
    """Sums over the moments and the counting zones of rooms; two scores add up to that of both."""

    moments: int = 0  # a zone at the time of a cloud
    right: int = 0  # the count is right, but for who is within `SLACK` of a side
    exact: int = 0  # the count is right, the side being a line
    # the same of the moments in which somebody who counts is in the zone
    occupied: int = 0
    occupied_right: int = 0
    presence: int = 0  # presence is as the same delays make it of the truth
    times: NDArray[np.float64] = field(default_factory=lambda: np.empty(0))  # of `ZoneMonitor.process` [ms]

    def __add__(self, other: ZoneScore) -> ZoneScore:
        names = ("moments", "right", "exact", "occupied", "occupied_right", "presence")
        sums = {name: getattr(self, name) + getattr(other, name) for name in names}
        return ZoneScore(**sums, times=np.concatenate([self.times, other.times]))

    def figures(self) -> dict[str, float | None]:
        """Ratios; None without anything to divide by."""
        return {
            "zone_count_accuracy": self.right / self.moments if self.moments else None,
            "zone_count_accuracy_exact": self.exact / self.moments if self.moments else None,
            "zone_count_accuracy_occupied": self.occupied_right / self.occupied if self.occupied else None,
            "zone_presence_accuracy": self.presence / self.moments if self.moments else None,
        }


def tracker_config(name: str, layout: LayoutConfig) -> TrackerConfig:
    """Configure a tracker by name, with the zones that act in it."""
    return TrackerConfig(tracker=name, zones=ZonesConfig(areas=layout.areas))  # type: ignore[arg-type]


def true_tracks(truth: Truth, visible: NDArray[np.bool_]) -> Tracks:
    """Give the people who count as tracks without any error."""
    none = np.zeros(3), np.full(3, np.nan), np.zeros((6, 6))
    place = truth.position + np.array([0.0, 0.0, 1.0])  # the truth is where feet are
    people = [(int(number), where) for number, where, seen in zip(truth.person_id, place, visible, strict=True) if seen]
    tracks = tuple(Track(number, TrackStatus.CONFIRMED, 1.0, 0.0, 1, where, *none) for number, where in people)
    return Tracks(truth.stamp_ns, truth.sequence, "room", tracks, np.empty(0, np.int32))


def judge_zones(room: KeptRoom, layout: LayoutConfig, config: TrackerConfig) -> ZoneScore:
    """Run a tracker and its zones through a room; ``layout`` holds the zones, ``config`` those that act in the tracker."""
    tracker, monitor = make_tracker(config, room.info), ZoneMonitor(layout)
    true = ZoneMonitor(replace(layout, border=0.0, border_sigmas=0.0))
    counting = [number for number, zone in enumerate(layout.zones) if zone.kind == "counting"]
    sums, times = np.zeros(6, np.int64), []
    for cloud, truth, visible in zip(room.clouds, room.truths, room.visible, strict=True):
        states, spent = timed(monitor.process, tracker.process(cloud))
        times.append(spent)
        wanted = true.process(true_tracks(truth, visible))
        for number in counting:
            area, count = layout.zones[number].area, states.zones[number].count
            floor = truth.position[:, :2]
            inside, away = area.inside(floor), area.distance(floor)
            least, most = int((inside & visible & (away > SLACK)).sum()), int((inside | (away <= SLACK)).sum())
            right, somebody = least <= count <= most, bool((inside & visible).any())
            exact = int((inside & visible).sum()) <= count <= int(inside.sum())
            same = states.zones[number].presence is wanted.zones[number].presence
            sums += [1, right, exact, somebody, somebody and right, same]
    return ZoneScore(*sums.tolist(), np.array(times))


def intervals(scores: Sequence[ZoneScore], seed: int = 0) -> dict[str, list[float] | None]:
    """Intervals (95 %) of the figures, by drawing as many rooms anew."""
    rng = np.random.default_rng(seed)
    bare = [replace(score, times=np.empty(0)) for score in scores]
    drawn = [sum((bare[k] for k in rng.integers(0, len(bare), len(bare))), ZoneScore()).figures() for _ in range(_DRAWS)]
    found: dict[str, list[float] | None] = {}
    for name in ZoneScore().figures():
        values = [value for one in drawn if (value := one[name]) is not None]
        found[f"{name}_interval"] = [float(v) for v in np.quantile(values, (0.025, 0.975))] if values else None
    return found


@dataclass(frozen=True)
class Night:
    """An empty room over hours."""

    hours: float = 0.0
    alarms: int = 0  # how often presence began
    occupied_s: float = 0.0  # how long there was presence [s]
    tracks: int = 0  # confirmed tracks, by their ids

    def __add__(self, other: Night) -> Night:
        sums = (getattr(self, name) + getattr(other, name) for name in ("hours", "alarms", "occupied_s", "tracks"))
        return Night(*sums)

    def figures(self, hours: float) -> dict[str, Any]:
        """Alarms in so many hours, and their interval (95 %) if they come independently of each other."""
        scale = hours / self.hours if self.hours else 0.0
        low = float(chi2.ppf(0.025, 2 * self.alarms)) / 2 if self.alarms else 0.0
        high = float(chi2.ppf(0.975, 2 * self.alarms + 2)) / 2
        return {
            "false_presence_per_night": scale * self.alarms,
            "false_presence_per_night_interval": [scale * low, scale * high],
            "false_presence_minutes_per_night": scale * self.occupied_s / 60.0,
            "false_tracks_per_night": scale * self.tracks,
        }


def watch_night(clouds: Iterable[PointCloud], info: RadarInfo, layout: LayoutConfig, config: TrackerConfig) -> Night:
    """Run a tracker and its zones through an empty room; presence is that of the room, after its delays."""
    tracker, monitor = make_tracker(config, info), ZoneMonitor(layout)
    alarms, occupied, ids = 0, 0.0, set()
    first, last, before = 0, 0, Presence.UNKNOWN
    for number, cloud in enumerate(clouds):
        tracks = tracker.process(cloud)
        presence = monitor.process(tracks).room.presence
        first = cloud.stamp_ns if number == 0 else first
        occupied += (cloud.stamp_ns - last) * 1e-9 if before is Presence.OCCUPIED else 0.0
        alarms += presence is Presence.OCCUPIED and before is not Presence.OCCUPIED
        ids |= {track.id for track in tracks.people}
        last, before = cloud.stamp_ns, presence
    return Night((last - first) / 3.6e12, alarms, occupied, len(ids))
