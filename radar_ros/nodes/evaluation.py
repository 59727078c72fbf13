"""Evaluation node: aligns tracks with truth and says how good the graph is."""

from __future__ import annotations

import json
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from handwave.msg import Gesture as GestureMsg
from handwave.msg import Gospa as GospaMsg
from handwave.msg import HandTrack as HandTrackMsg
from handwave.msg import TrackArray as TrackArrayMsg
from handwave.msg import Truth as TruthMsg

from radar_core import DataError, RadarInfo
from radar_lab.evaluation.run import EvaluationConfig, Evaluator
from radar_ros import qos
from radar_ros.messages.convert import header
from radar_ros.messages.gestures import gesture_from_msg
from radar_ros.messages.tracks import hand_from_msg, tracks_from_msg
from radar_ros.messages.truth import truth_from_msg
from radar_ros.params import declare, declare_config
from radar_ros.stage import InfoKeeper, StageNode, run
from radar_ros.sync import Subscriber
from radar_ros.sync_near import ApproximateTimeSynchronizer
from radar_tracking import Tracks
from radar_tracking.metrics import Gospa

_SLOP = 0.005  # s: stamps of tracks and truth are equal by construction; another clock's rounding may differ


class EvaluationNode(StageNode):
    """Publishes GOSPA of every moment, figures as diagnostics once a second, and writes the full report at the end."""

    def __init__(self, **kwargs: Any) -> None:
        super().__init__("evaluation", **kwargs)
        self._report = str(declare(self, "report", "", "file to write the report to at the end (JSON); empty: none"))
        self._config = declare_config(self, EvaluationConfig)
        self._evaluator: Evaluator | None = None
        self._info = InfoKeeper(self, self._configure)
        profile = qos.RESULT
        truths = Subscriber(self, TruthMsg, "truth", qos_profile=profile)
        self._pairs = ApproximateTimeSynchronizer([Subscriber(self, TrackArrayMsg, "tracks", qos_profile=profile), truths], 50, _SLOP)
        self._pairs.registerCallback(self._take)
        self._hands = ApproximateTimeSynchronizer([Subscriber(self, HandTrackMsg, "hand", qos_profile=profile), truths], 50, _SLOP)
        self._hands.registerCallback(self._take_hand)
        self.create_subscription(GestureMsg, "gestures", self._gesture, profile)
        self._gospa = self.create_publisher(GospaMsg, "gospa", profile)
        self._figures = self.create_publisher(DiagnosticArray, "diagnostics", 10)
        self.create_timer(1.0, self._publish)

    def _configure(self, info: RadarInfo) -> None:
        self._evaluator = Evaluator(info, self._config)

    def _take(self, tracks_msg: Any, truth_msg: Any) -> None:
        started = time.monotonic_ns()
        self.count_gap(tracks_msg.sequence, tracks_msg.every)
        if self._evaluator is None:
            return
        tracks = tracks_from_msg(tracks_msg)
        try:
            gospa = self._evaluator.add(tracks, truth_from_msg(truth_msg))
        except DataError as error:
            self.dropped += 1
            self.problem(str(error))
            return
        self._gospa.publish(_gospa_to_msg(gospa, tracks))
        self.finish(tracks.stamp_ns, tracks.sequence, started)

    def _take_hand(self, hand_msg: Any, truth_msg: Any) -> None:
        if self._evaluator is not None:
            self._evaluator.add_hand(hand_from_msg(hand_msg), truth_from_msg(truth_msg))

    def _gesture(self, msg: Any) -> None:
        if self._evaluator is not None:
            self._evaluator.add_gesture(gesture_from_msg(msg))

    def _publish(self) -> None:
        if self._evaluator is None:
            return
        report = self._evaluator.report()
        gestures = report["gestures"]
        values = {f"person_{k}_{name}": v for k, person in report["people"].items() for name, v in person.items()}
        values |= {"gestures_right": gestures["hits"], "gestures_total": gestures["total"], "hand_rms_m": report["hand"]["rms_m"]}
        values |= {name: report[name] for name in ("ghost_track_frames", "ghost_track_frames_per_minute", "gate_m")}
        values |= {name: gestures[name] for name in ("false_gestures", "false_gestures_per_minute")}
        values |= {"mota": report["mota"], "gospa_mean_m": report["gospa"]["mean_m"], "nees_mean": report["nees"]["mean"]}
        status = DiagnosticStatus(
            level=DiagnosticStatus.OK, name="accuracy", message="against the simulator's truth", hardware_id="evaluation"
        )
        status.values = [KeyValue(key=k, value=str(v)) for k, v in values.items()]
        array = DiagnosticArray(status=[status])
        array.header.stamp = self.get_clock().now().to_msg()
        self._figures.publish(array)

    def close(self) -> None:
        """Write the report."""
        if self._report and self._evaluator is not None:
            path = Path(self._report)
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(json.dumps(self._evaluator.report(), indent=1), encoding="utf-8")


def _gospa_to_msg(gospa: Gospa, tracks: Tracks) -> GospaMsg:
    return GospaMsg(
        header=header(tracks.stamp_ns, tracks.frame_id),
        distance=gospa.distance,
        localisation=gospa.localisation,
        missed=gospa.missed,
        false_tracks=gospa.false_tracks,
        n_truth=gospa.n_truth,
        n_tracks=gospa.n_estimates,
    )


def make_node(**kwargs: Any) -> EvaluationNode:
    """Make the node; ``kwargs`` go to rclpy's Node."""
    return EvaluationNode(**kwargs)


def main(argv: Sequence[str] | None = None) -> int:
    """Run the node until it is told to stop."""
    return run(make_node, argv)


if __name__ == "__main__":
    raise SystemExit(main())
