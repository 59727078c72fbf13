"""Hand node: radar/points, tracks, gestures and hand/trigger to hand and hand/value."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import handwave.msg
import numpy as np
from handwave.srv import TrackHand
from std_msgs.msg import Bool, Float32

from radar_core import ConfigError, RadarInfo
from radar_ros import qos
from radar_ros.messages.convert import cloud_from_msg, from_time
from radar_ros.messages.tracks import hand_to_msg, tracks_from_msg
from radar_ros.params import declare_config, on_change
from radar_ros.stage import InfoKeeper, StageNode, run
from radar_ros.sync import Subscriber, TimeSynchronizer
from radar_tracking import HandConfig, HandTrack, HandTracker, TrackedCloud, TrackStatus
from radar_tracking.clustering.lloyd import kmeans

_AXES = ("velocity_none", "velocity_one_axis", "velocity_two_axes", "velocity_whole")  # by the number of axes told


class HandNode(StageNode):
    """Follows a hand as an analogue input."""

    def __init__(self, **kwargs: Any) -> None:
        super().__init__("hand", **kwargs)
        self._tracker = HandTracker(declare_config(self, HandConfig, changeable=True))
        kmeans(np.eye(2), np.eye(2))  # what compiled loops need is loaded with the first: half a second, which the first hand would miss
        self._people: dict[int, TrackStatus] = {}
        self._last: HandTrack | None = None  # that was published
        self._command = (-1, False)  # stamp at which the last command takes effect [ns], and whether it was to follow a hand
        self._told: Counter[int] = Counter()  # clouds since the last diagnostics, by the number of axes along which they told the velocity
        self._hand = self.create_publisher(handwave.msg.HandTrack, "hand", qos.RESULT)
        self._value = self.create_publisher(Float32, "hand/value", qos.RESULT)
        self._info = InfoKeeper(self, self._configure)
        on_change(self, self._tracker.config, self._prepare)
        inputs = [
            Subscriber(self, handwave.msg.PointCloud, "radar/points", qos_profile=qos.sensor(reliable=self.reliable)),
            Subscriber(self, handwave.msg.TrackArray, "tracks", qos_profile=qos.RESULT),
        ]
        self._sync = TimeSynchronizer(inputs, 10)
        self._sync.registerCallback(self._take)
        self.create_subscription(handwave.msg.Gesture, "gestures", self._gesture, qos.RESULT)
        self.commands.add(self.create_subscription(Bool, "hand/trigger", self._trigger, qos.COMMAND).topic_name)
        self.create_service(TrackHand, "hand/track", self._serve)

    def _configure(self, info: RadarInfo) -> None:
        self._tracker.seen_from(info)

    def _prepare(self, config: HandConfig) -> Callable[[], None]:
        """Make another tracker; refused (`ConfigError`) while a hand is followed, which it would lose."""
        if self._wanted():
            raise ConfigError("a hand is followed, which would be lost: end it first (hand/trigger false), then set the parameter")
        tracker = HandTracker(config)
        if self._info.info is not None:
            tracker.seen_from(self._info.info)

        def apply() -> None:
            self._tracker = tracker

        return apply

    def _gesture(self, msg: Any) -> None:
        self._tracker.gesture(msg.name, msg.track_id, from_time(msg.header.stamp))

    def _trigger(self, msg: Any) -> None:
        if not msg.data:
            self._stop()
        elif not self._wanted():
            if all(status is TrackStatus.TENTATIVE for status in self._people.values()):
                self.caution("hand/trigger: there is no person yet to follow; send it again once tracks has a confirmed track")
            self._start(None)

    def _wanted(self) -> bool:
        """Whether a hand is followed or looked for, or will be once the last command takes effect."""
        due_ns, follow = self._command
        return follow if self._stamp_ns < due_ns else self._tracker.active

    def _start(self, track_id: int | None) -> None:
        self._tracker.start(track_id, self._stamp_ns)
        self._command = (self._due_ns(), True)

    def _stop(self) -> None:
        # with its stamp: an end at once could overtake a start that has not taken effect yet; once: without clouds nothing takes effect
        if self._command != (self._due_ns(), False):
            self._tracker.stop(self._stamp_ns)
        self._command = (self._due_ns(), False)

    def _due_ns(self) -> int:
        return self._stamp_ns + round(self._tracker.config.trigger_delay * 1e9)

    def _serve(self, request: Any, response: Any) -> Any:
        if not request.enable:
            self._stop()
            response.success, response.message = True, f"the hand track ends {self._tracker.config.trigger_delay:g} s from now"
        elif request.track_id >= 0 and request.track_id not in self._people:
            known = ", ".join(map(str, sorted(self._people))) or "none"
            response.success, response.message = False, f"there is no track {request.track_id}; tracks now: {known}"
        else:
            self._start(None if request.track_id < 0 else request.track_id)
            response.success, response.message = True, "the hand is looked for"
        return response

    def _take(self, cloud_msg: Any, tracks_msg: Any) -> None:
        started = time.monotonic_ns()
        self.count_gap(cloud_msg.sequence, tracks_msg.every)
        info = self._info.usable()
        if info is None:
            return
        tracks = tracks_from_msg(tracks_msg)
        if self.went_back(tracks.stamp_ns):
            self._tracker.reset()
            self._command = (-1, False)
        hand = self._tracker.process(TrackedCloud(cloud_from_msg(cloud_msg).to_room(info.mount), tracks))
        self._people = {track.id: track.status for track in tracks.tracks}
        if hand is not None:
            self._told[hand.velocity_rank] += hand.active
            self._value.publish(Float32(data=hand.value))
            self._hand.publish(hand_to_msg(hand))
        self._last = hand
        self.finish(tracks.stamp_ns, tracks.sequence, started)

    def on_stale(self) -> None:
        """End the hand track: nobody knows where the hand is."""
        if self._last is not None and self._last.active:
            self._hand.publish(hand_to_msg(replace(self._last, active=False)))
        self._last, self._command = None, (-1, False)
        self._people.clear()
        self._tracker.reset()

    def extra_diagnostics(self) -> tuple[dict[str, Any], list[str]]:
        """Share of the clouds of the period that ends, while a hand was followed, that told its velocity along so many axes."""
        told, self._told = self._told, Counter()
        clouds = told.total()
        return {f"{name}_percent": f"{100 * told[rank] / clouds:.1f}" if clouds else "unknown" for rank, name in enumerate(_AXES)}, []


make_node = HandNode
if __name__ == "__main__":
    raise SystemExit(run(make_node))
