"""Vital node: radar/frame and tracks to breath and pulse of everybody who stays where they are."""

from __future__ import annotations

import math
import time
from typing import Any, Final

import handwave.msg
import numpy as np
from sensor_msgs.msg import PointCloud2

from radar_core import RadarFrame, RadarInfo
from radar_dsp.vital import VitalConfig, VitalMonitor, VitalSigns
from radar_ros import qos
from radar_ros.messages.convert import frame_from_msg, points_to_cloud2
from radar_ros.messages.tracks import tracks_from_msg
from radar_ros.params import declare_config
from radar_ros.stage import InfoKeeper, StageNode, run
from radar_tracking.tracks import Track, Tracks, TrackStatus

_ROW: Final = np.dtype([("track_id", "<i4"), *((name, "<f4") for name in ("x", "y", "z", "breath", "heart", "motion"))])
"""A person of topic ``vital``: place in the room [m], rates [1/min], and how much the chest moves [m]; NaN: not known."""
_OLD_NS: Final = 1_000_000_000  # tracks that are older say nothing of where somebody is


class VitalNode(StageNode):
    """Looks at every tracked person once a second; who walks has no rates."""

    def __init__(self, **kwargs: Any) -> None:
        super().__init__("vital", **kwargs)
        self._config = declare_config(self, VitalConfig)
        self._vital = self.create_publisher(PointCloud2, "vital", qos.RESULT)
        self._people: dict[int, VitalMonitor] = {}
        self._tracks: Tracks | None = None
        self._told: dict[int, VitalSigns] = {}
        self._info = InfoKeeper(self, self._configure)
        self.create_subscription(handwave.msg.TrackArray, "tracks", self._follow, qos.RESULT)
        self.create_subscription(handwave.msg.RadarFrame, "radar/frame", self._take, qos.sensor(reliable=self.reliable))

    def _configure(self, info: RadarInfo) -> None:
        VitalMonitor(self._config, info)  # refuses a radar that is not able to
        self._people, self._told, self._tracks = {}, {}, None

    def _follow(self, msg: Any) -> None:
        self._tracks = tracks_from_msg(msg)
        there = {track.id for track in self._tracks.tracks}
        for known in (self._people, self._told):
            for gone in known.keys() - there:
                del known[gone]

    def _take(self, msg: Any) -> None:
        started = time.monotonic_ns()
        self.count_gap(msg.sequence)
        info = self._info.usable()
        if info is None:
            return
        frame = frame_from_msg(msg)
        if self.went_back(frame.stamp_ns):
            self._configure(info)
        people = self._tracks
        if people is not None and abs(frame.stamp_ns - people.stamp_ns) <= _OLD_NS:
            known = [track for track in people.tracks if track.status != TrackStatus.TENTATIVE]
            looked = [self._look(info, frame, track) for track in known]
            if any(looked):
                self._say(frame.stamp_ns, known)
        self.finish(frame.stamp_ns, frame.sequence, started)

    def _look(self, info: RadarInfo, frame: RadarFrame, track: Track) -> bool:
        """Show one person's monitor the frame; whether it said something."""
        if track.id not in self._people:
            self._people[track.id] = VitalMonitor(self._config, info)
        found = self._people[track.id].process(frame, track.position)
        if found is not None:
            self._told[track.id] = found
        return found is not None

    def _say(self, stamp_ns: int, known: list[Track]) -> None:
        rows = [(track, self._told[track.id]) for track in known if track.id in self._told]
        people = np.array([(t.id, *t.position, 60 * v.breath, 60 * v.heart, v.motion) for t, v in rows], _ROW)
        self._vital.publish(points_to_cloud2(stamp_ns, "room", people))

    def extra_diagnostics(self) -> tuple[dict[str, Any], list[str]]:
        """Rates of everybody, per minute."""
        rates = {f"person.{person}": (60 * found.breath, 60 * found.heart) for person, found in self._told.items()}
        return {name: ", ".join("unknown" if math.isnan(x) else f"{x:.1f}" for x in both) for name, both in rates.items()}, []


make_node = VitalNode
if __name__ == "__main__":
    raise SystemExit(run(make_node))
