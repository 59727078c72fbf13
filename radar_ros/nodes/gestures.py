"""Gesture node: radar/points and tracks to gestures."""

from __future__ import annotations

import time
from typing import Any

import handwave.msg
import numpy as np

from radar_core import RadarInfo
from radar_gestures.classifiers.model import load_model
from radar_gestures.recognizer import GestureRecognizer
from radar_gestures.stage import GestureConfig
from radar_ros import qos
from radar_ros.messages.convert import cloud_from_msg
from radar_ros.messages.gestures import gesture_to_msg, maps_to_msg
from radar_ros.messages.tracks import tracks_from_msg
from radar_ros.params import declare, declare_config
from radar_ros.stage import InfoKeeper, StageNode, refusing, run
from radar_ros.sync import Subscriber, TimeSynchronizer
from radar_tracking import TrackedCloud


class GesturesNode(StageNode):
    """Recognises the arm gestures of every tracked person."""

    def __init__(self, **kwargs: Any) -> None:
        super().__init__("gestures", **kwargs)
        self._config = declare_config(self, GestureConfig)
        self._model = load_model(declare(self, "model", "gestures", "gesture model: a file, or one of ours by name"))
        self._model.probabilities(np.zeros(len(self._model.names)))  # compiled now, not at the end of the first gesture
        self._gestures = self.create_publisher(handwave.msg.Gesture, "gestures", qos.RESULT)
        self._maps = self.create_publisher(handwave.msg.GestureMaps, "gestures/maps", qos.stream_out())
        self._info = InfoKeeper(self, self._configure)
        # Only the newest cloud and tracks wait while this node is busy (thesis, section 4.5.4); `count_gap` counts what was left out.
        inputs = [
            Subscriber(self, handwave.msg.PointCloud, "radar/points", qos_profile=qos.sensor(reliable=self.reliable, depth=1)),
            Subscriber(self, handwave.msg.TrackArray, "tracks", qos_profile=qos.RESULT if self.reliable else qos.NEWEST),
        ]
        self._sync = TimeSynchronizer(inputs, 10)
        self._sync.registerCallback(self._take)

    def _configure(self, info: RadarInfo) -> None:
        self._recognizer = GestureRecognizer(self._config, self._model, info.mount)

    @refusing
    def _take(self, cloud_msg: Any, tracks_msg: Any) -> None:
        started = time.monotonic_ns()
        self.count_gap(cloud_msg.sequence, tracks_msg.every)
        info = self._info.usable()
        if info is None:
            return
        tracked = TrackedCloud(cloud_from_msg(cloud_msg).to_room(info.mount), tracks_from_msg(tracks_msg))
        if self.went_back(tracked.cloud.stamp_ns):
            self._configure(info)
        events = self._recognizer.find(tracked)
        gestures = [self._recognizer.name(event, tracked.tracks.stamp_ns) for event in events]
        for gesture in filter(self._recognizer.wanted, gestures):
            self._gestures.publish(gesture_to_msg(gesture))
        self.finish(tracked.cloud.stamp_ns, tracked.cloud.sequence, started)
        if events and self._maps.get_subscription_count():
            for event in events:
                if event.maps is not None:
                    self._maps.publish(maps_to_msg(event, event.maps, tracked.tracks.stamp_ns))


make_node = GesturesNode
if __name__ == "__main__":
    raise SystemExit(run(make_node))
