"""Feature maps of one person over any time that the feed still knows: micro-Doppler, azimuth, elevation and distance."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

import numpy as np

from radar_app.view.feed import Entry, History, Snapshot
from radar_app.view.records import EventMaps
from radar_core import CloudComposite, PointCloud
from radar_core.types import BoolArray
from radar_gestures.features import FeatureConfig
from radar_gestures.gesture import Gesture
from radar_gestures.maps import FeatureMaps, Share, feature_maps
from radar_gestures.stage import GestureConfig
from radar_tracking.tracks import Tracks

GATE: Final = FeatureConfig().gate
MAX_SPEED: Final = GestureConfig().maps.max_speed
_MARGIN_NS: Final = round(GestureConfig().margin * 1e9)


class PersonMaps:
    """The maps of one person up to a moment, again and again: what was made before is not made a second time.

    Parameters
    ----------
    seconds : float
        How far back they reach [s].
    max_speed : float
        They reach from minus to plus this [m/s].
    """

    def __init__(self, seconds: float = 2.0, max_speed: float = MAX_SPEED) -> None:
        self.seconds, self._max_speed = seconds, max_speed
        self._rows: dict[tuple[int, int], FeatureMaps] = {}

    def process(self, now: Snapshot, track_id: int) -> FeatureMaps | None:
        """Give the maps of one track; None where there are no clouds with tracks."""
        clouds = now.past("clouds", self.seconds)
        owners = {entry.value.sequence: entry.value for entry in now.past("tracks", self.seconds)}
        rows = {}
        for entry in clouds:
            tracks = owners.get(entry.value.sequence)
            if tracks is not None and len(tracks.point_track_id) == len(entry.value):
                key = entry.number, track_id
                known = self._rows.get(key)
                rows[key] = known if known is not None else self._row(entry.value, tracks, track_id)
        self._rows = rows
        return _together(list(rows.values())) if rows else None

    def _row(self, cloud: PointCloud, tracks: Tracks, track_id: int) -> FeatureMaps:
        return feature_maps([_share(cloud, tracks.point_track_id == track_id)], GATE, self._max_speed)


def event_maps(history: History, gesture: Gesture) -> EventMaps:
    """Make the maps of a gesture's event from the clouds that are kept, for recordings that hold none."""
    start, end = gesture.start_ns - _MARGIN_NS, gesture.end_ns + _MARGIN_NS
    made = [_share(cloud, tracks.point_track_id == gesture.track_id) for cloud, tracks in _tracked(history, start, end)]
    maps = feature_maps(made, GATE, MAX_SPEED)
    return EventMaps(gesture.stamp_ns, gesture.track_id, gesture.start_ns, gesture.end_ns, maps)


def _tracked(history: History, start_ns: int, end_ns: int) -> Iterator[tuple[PointCloud, Tracks]]:
    """Clouds of a stretch of time with their tracks."""
    window: list[Entry[PointCloud]] = [entry for entry in history.clouds if start_ns <= entry.stamp_ns <= end_ns]
    owners = {entry.value.sequence: entry.value for entry in history.tracks if start_ns <= entry.stamp_ns <= end_ns}
    for entry in window:
        tracks = owners.get(entry.value.sequence)
        if tracks is not None and len(tracks.point_track_id) == len(entry.value):
            yield entry.value, tracks


def _share(cloud: PointCloud, own: BoolArray) -> Share:
    """Take the points of one person, of the one sensor that saw most of them."""
    if isinstance(cloud, CloudComposite) and own.any():
        own = own & (cloud.sensor == np.bincount(cloud.sensor[own]).argmax())
    return Share(cloud.stamp_ns, cloud.radial_speed[own], cloud.snr[own], cloud.range[own], cloud.azimuth[own], cloud.elevation[own])


def _together(rows: list[FeatureMaps]) -> FeatureMaps:
    stamps = np.concatenate([row.stamp_ns for row in rows])
    names = ("micro_doppler", "azimuth", "elevation", "distance")
    return FeatureMaps(stamps, rows[0].speed, **{name: np.concatenate([getattr(row, name) for row in rows]) for name in names})
