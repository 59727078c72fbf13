"""Evaluation node: aligns tracks with truth and says how good the graph is."""

from __future__ import annotations

import json
import time
from pathlib import Path
from typing import Any

import handwave.msg

from radar_core import RadarInfo
from radar_core.files import write_whole
from radar_lab.evaluation.run import EvaluationConfig, Evaluator
from radar_ros import qos
from radar_ros.messages.convert import header
from radar_ros.messages.gestures import gesture_from_msg
from radar_ros.messages.tracks import hand_from_msg, tracks_from_msg
from radar_ros.messages.truth import truth_from_msg
from radar_ros.params import declare, declare_config
from radar_ros.stage import InfoKeeper, StageNode, run
from radar_ros.sync import ApproximateTimeSynchronizer, Subscriber

_SLOP = 0.005  # s: stamps of tracks and truth are equal by construction; another clock's rounding may differ


class EvaluationNode(StageNode):
    """Publishes GOSPA of every moment, figures as diagnostics once a second, and writes the full report at the end."""

    gives_way = 5

    def __init__(self, **kwargs: Any) -> None:
        super().__init__("evaluation", **kwargs)
        self._report = str(declare(self, "report", "", "file to write the report to at the end (JSON); empty: none"))
        self._config = declare_config(self, EvaluationConfig)
        self._evaluator: Evaluator | None = None
        self._info = InfoKeeper(self, self._configure)
        truths = Subscriber(self, handwave.msg.Truth, "truth", qos_profile=qos.RESULT)
        for kind, topic, take in ((handwave.msg.TrackArray, "tracks", self._take), (handwave.msg.HandTrack, "hand", self._take_hand)):
            found = Subscriber(self, kind, topic, qos_profile=qos.RESULT)
            ApproximateTimeSynchronizer([found, truths], 50, _SLOP).registerCallback(take)
        self.create_subscription(handwave.msg.Gesture, "gestures", self._gesture, qos.RESULT)
        self._gospa = self.create_publisher(handwave.msg.Gospa, "gospa", qos.RESULT)
        self.create_timer(1.0, self._publish)

    def _configure(self, info: RadarInfo) -> None:
        self._evaluator = Evaluator(info, self._config)

    def _take(self, tracks_msg: Any, truth_msg: Any) -> None:
        started = time.monotonic_ns()
        self.count_gap(tracks_msg.sequence, tracks_msg.every)
        if self._evaluator is None:
            return
        tracks = tracks_from_msg(tracks_msg)
        gospa = self._evaluator.add(tracks, truth_from_msg(truth_msg))
        names = ("distance", "localisation", "missed", "false_tracks", "n_truth")
        parts = {name: getattr(gospa, name) for name in names}
        self._gospa.publish(handwave.msg.Gospa(header=header(tracks.stamp_ns, tracks.frame_id), n_tracks=gospa.n_estimates, **parts))
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
        self.publish_diagnostics("accuracy", "against the simulator's truth", values)

    def close(self) -> None:
        """Write the report."""
        if self._report and self._evaluator is not None:
            path = Path(self._report)
            try:
                path.parent.mkdir(parents=True, exist_ok=True)
                write_whole(path, json.dumps(self._evaluator.report(), indent=1))
            except OSError as error:
                self.get_logger().error(f"{path}: the report cannot be written ({error.strerror}); make room or rights there")


make_node = EvaluationNode
if __name__ == "__main__":
    raise SystemExit(run(make_node))
