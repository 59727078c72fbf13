"""Hand evaluation node: hand tracks against a camera or the simulator's truth; residuals live, a report and a figure at the end."""

from __future__ import annotations

import json
import time
from collections import deque
from functools import partial
from pathlib import Path
from typing import Any, Literal, get_args

import handwave.msg
import numpy as np
from std_srvs.srv import Trigger

from radar_core import ConfigError, HandwaveError
from radar_core.files import write_whole
from radar_lab.camera.report import budget, collect
from radar_lab.camera.residual import HandResiduals, ReferenceSample, Residual, ResidualConfig, TrackSample
from radar_lab.camera.truth import reference_of
from radar_ros import qos
from radar_ros.messages.camera import joints_from_msg, residual_to_msg
from radar_ros.messages.tracks import hand_from_msg
from radar_ros.messages.truth import truth_from_msg
from radar_ros.params import declare, declare_config
from radar_ros.stage import StageNode, run

Reference = Literal["camera", "truth"]


class HandEvaluationNode(StageNode):
    """Publishes the residual of every hand track that the reference can be interpolated to, and writes what all of them say."""

    gives_way = 5

    def __init__(self, **kwargs: Any) -> None:
        super().__init__("hand_evaluation", **kwargs)
        self._declare()
        self._residuals = HandResiduals(self._config)
        self._found: deque[Residual] = deque(maxlen=self._keep)
        self._hand: np.ndarray | None = None
        self._out = self.create_publisher(handwave.msg.HandResidual, "hand/residual", qos.RESULT)
        for topic in self._hands:
            self.create_subscription(handwave.msg.HandTrack, topic, partial(self._take_hand, topic), qos.RESULT)
        if self._reference == "camera":
            self.create_subscription(handwave.msg.JointTruth, "camera/joints", self._take_joints, qos.RESULT)
        else:
            self.create_subscription(handwave.msg.Truth, "truth", self._take_truth, qos.RESULT)
        self.create_service(Trigger, "hand_evaluation/write", self._serve)
        if self._figure:
            import matplotlib.figure  # noqa: F401  (at the end there is no time for it)

    def _declare(self) -> None:
        self._config = declare_config(self, ResidualConfig)
        text = "what the hand is compared with: camera (camera/joints) or truth"
        self._reference: Reference = declare(self, "reference", "camera", text, choices=get_args(Reference))
        if self._reference not in get_args(Reference):
            raise ConfigError(f"parameter reference is {self._reference!r}; choose {' or '.join(get_args(Reference))}")
        self._joint = str(declare(self, "joint", "right_hand", "camera: the joint that is the hand"))
        self._person = int(declare(self, "person", -1, "truth: id of the person; -1: whose acting hand is nearest to the track", low=-1))
        self._hands = [str(topic) for topic in declare(self, "hands", ["hand"], "topics of the hand tracks that are compared")]
        if not self._hands or len(set(self._hands)) < len(self._hands):
            raise ConfigError(f"parameter hands is {self._hands}; name at least one topic, each once")
        self._report = str(declare(self, "report", "", "file to write the report to at the end (JSON); empty: none"))
        self._figure = str(declare(self, "figure", "", "file to draw the figure into at the end (PNG); empty: none"))
        self._keep = int(declare(self, "keep", 50_000, "residuals that the report is made of: the latest so many", low=1, high=10**7))

    def _take_hand(self, topic: str, msg: Any) -> None:
        started, hand = time.monotonic_ns(), hand_from_msg(msg)
        self._hand = hand.position
        if hand.active:
            self._add(TrackSample(topic, hand.stamp_ns, hand.position, hand.covariance[:3, :3]))
            self.finish(hand.stamp_ns, hand.sequence, started)

    def _take_joints(self, msg: Any) -> None:
        self._add(reference_of(joints_from_msg(msg), self._joint))

    def _take_truth(self, msg: Any) -> None:
        self._add(self._acting(truth_from_msg(msg)))

    def _acting(self, truth: Any) -> ReferenceSample | None:
        """Acting hand of the person that is meant; None: they are not there."""
        rows = np.arange(len(truth.person_id)) if self._person < 0 else np.flatnonzero(truth.person_id == self._person)
        if len(rows) == 0 or (len(rows) > 1 and self._hand is None):
            return None
        places = truth.hand_position[rows]
        nearest = 0 if self._hand is None else int(((places - self._hand) ** 2).sum(-1).argmin())
        return ReferenceSample(truth.stamp_ns, places[nearest])

    def _add(self, sample: ReferenceSample | TrackSample | None) -> None:
        if sample is None:
            return
        if self._back(sample):
            self._residuals.reset()
        for item in self._residuals.process(sample):
            self._found.append(item)
            self._out.publish(residual_to_msg(item, self._reference))

    def _back(self, sample: ReferenceSample | TrackSample) -> bool:
        """Whether a recording starts again: stamps go back by more than tracks may be behind the reference, or the other way round."""
        newest = max(getattr(self, "_newest_ns", 0), 0)
        back = newest - sample.stamp_ns > 1e9 * max(self._config.wait, 1.0)
        self._newest_ns = sample.stamp_ns if back else max(newest, sample.stamp_ns)
        if back:
            self.caution("stamps went back in time (a recording starts again?): what waits is forgotten")
        return back

    def _serve(self, request: Any, response: Any) -> Any:
        response.success, response.message = self._write()
        return response

    def report(self) -> dict[str, Any]:
        """Error budget of every track, see `radar_lab.camera.report.budget`, and of what there was too little to tell."""
        tracks = {name: budget(series, self._config) for name, series in collect(self._found).items()}
        return {"reference": self._reference, "joint": self._joint, "tracks": tracks, "unmatched": self._residuals.unmatched}

    def expects_data(self) -> bool:
        """Nobody has to be there: this stage is never stale."""
        return False

    def extra_diagnostics(self) -> tuple[dict[str, Any], list[str]]:
        """Length of the latest residual, and of the reference's own error."""
        values: dict[str, Any] = {"residuals": len(self._found), "unmatched": self._residuals.unmatched}
        if self._found:
            last = self._found[-1]
            values["residual_m"] = f"{float(np.sqrt((last.residual**2).sum())):.3f}"
            values["reference_std_m"] = f"{float(np.sqrt(max(np.trace(last.covariance), 0.0))):.3f}"
        return values, []

    def _write(self) -> tuple[bool, str]:
        """Write report and figure; whether that went well, and what happened."""
        if not self._found:
            return False, f"no residual yet: {self._residuals.unmatched} hand tracks had no {self._reference} near enough in time"
        written = []
        try:
            if self._report:
                path = Path(self._report)
                path.parent.mkdir(parents=True, exist_ok=True)
                write_whole(path, json.dumps(self.report(), indent=1))
                written.append(self._report)
            if self._figure:
                from radar_lab.camera.report import draw

                draw(collect(self._found), self._reference, Path(self._figure))
                written.append(self._figure)
        except (OSError, HandwaveError) as error:
            return False, f"cannot be written: {error}"
        return True, f"written: {', '.join(written) or 'nothing, because neither report nor figure is set'}"

    def close(self) -> None:
        """Write report and figure."""
        if self._report or self._figure:
            self._residuals.finish()
            good, text = self._write()
            (self.get_logger().info if good else self.get_logger().error)(text)


make_node = HandEvaluationNode
if __name__ == "__main__":
    raise SystemExit(run(make_node))
