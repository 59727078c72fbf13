"""Gesture node: radar/points and tracks to gestures."""

from __future__ import annotations

import dataclasses
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, Final

import handwave.msg
import numpy as np
from rcl_interfaces.msg import SetParametersResult
from rclpy.parameter import Parameter

from radar_core import ConfigError, HandwaveError, RadarInfo, vocabulary
from radar_core.config import flat
from radar_gestures.activation import Activation, ActivationConfig
from radar_gestures.classifiers.classifier import Classifier
from radar_gestures.classifiers.model import AUTO, model_of
from radar_gestures.gesture import Gesture
from radar_gestures.make import Recognizer, make_recognizer
from radar_gestures.needs import lacks, needs, warning
from radar_gestures.stage import GestureConfig, TrackEvent, config_for
from radar_ros import qos
from radar_ros.messages.convert import cloud_from_msg
from radar_ros.messages.gestures import gesture_to_msg, maps_to_msg
from radar_ros.messages.tracks import tracks_from_msg
from radar_ros.messages.zones import areas_from_msg
from radar_ros.params import declare, declare_config, on_change
from radar_ros.stage import InfoKeeper, StageNode, run
from radar_ros.sync import Subscriber, TimeSynchronizer
from radar_tracking import TrackedCloud
from radar_tracking.zones.area import Area

_MODELS_OWN: Final = ("features", "events", "maps", "margin")  # knobs of `GestureConfig` that a model says itself


@dataclasses.dataclass(frozen=True, eq=False)
class _Pending:
    """What the node works with once nobody refuses it: what was chosen, and what became of it."""

    chosen: dict[str, str]
    model: Classifier
    config: GestureConfig
    recognizer: Recognizer


class GesturesNode(StageNode):
    """Recognises the arm gestures of every tracked person."""

    def __init__(self, **kwargs: Any) -> None:
        super().__init__("gestures", **kwargs)
        model = declare(
            self, "model", AUTO,
            "gesture model: a file, one of ours by name, or auto: both of ours together; brings its own features",
            changeable=True,
        )  # fmt: skip
        person = declare(self, "person", "", "who is there, of those enrolled in the model; empty: anybody", changeable=True)
        self._model = _ready(model, person)
        base = config_for(self._model.settings, GestureConfig())
        self._config = declare_config(self, GestureConfig, changeable=_changeable, base=base)
        Activation(self._config.activation, vocabulary(self._model.labels))  # refuse it now, not with the first cloud
        self._chosen = {"model": model, "person": person}
        self._pending: _Pending | None = None
        self._adopting = False
        self._lacks = ""  # what the radar does not give of what the model needs
        self.add_on_set_parameters_callback(self._check)
        self.add_post_set_parameters_callback(self._put_in_place)
        on_change(self, self._config.activation, self._activate, "activation.")
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
        self._zones: list[tuple[str, Area]] = []
        self._last: Gesture | None = None  # that was one
        self.commands.add(self.create_subscription(handwave.msg.ZoneArray, "zones", self._take_zones, qos.LATCHED).topic_name)

    def _configure(self, info: RadarInfo) -> None:
        self._recognizer = make_recognizer(self._config, self._model, info)
        self._compare(info)

    def _compare(self, info: RadarInfo) -> None:
        """Say once what the radar does not give of what the model needs."""
        said, self._lacks = self._lacks, warning(lacks(needs(self._model), info), self._chosen["model"])
        if self._lacks and self._lacks != said:
            self.get_logger().warning(self._lacks)

    def _check(self, parameters: Sequence[Any]) -> SetParametersResult:
        """Refuse a model that cannot be used, and prepare to work with one that can; its features come with it and cannot be set."""
        self._pending = None
        if self._adopting:
            return SetParametersResult(successful=True)
        given = {p.name: p.value for p in parameters if p.name in self._chosen}
        foreign = [p.name for p in parameters if _comes_with_model(p.name)]
        try:
            if foreign:
                raise ConfigError(f"{', '.join(foreign)}: the model says how its features are made; set model instead")
            if wrong := [name for name, value in given.items() if not isinstance(value, str)]:
                raise ConfigError(f"{', '.join(wrong)}: give a name")
            if given:
                self._pending = self._prepared(self._chosen | given, self._info.info)
        except HandwaveError as error:
            self.get_logger().error(f"refused {given or foreign}: {error}")
            return SetParametersResult(successful=False, reason=str(error))
        return SetParametersResult(successful=True)

    def _prepared(self, chosen: dict[str, str], info: RadarInfo | None) -> _Pending:
        usual, model = GestureConfig(), _ready(chosen["model"], chosen["person"])
        bare = dataclasses.replace(self._config, **{name: getattr(usual, name) for name in _MODELS_OWN})
        config = config_for(model.settings, bare)
        return _Pending(chosen, model, config, make_recognizer(config, model, info))

    def _activate(self, wanted: ActivationConfig) -> Callable[[], None]:
        """Check that a gesture wakes which the model knows; see `on_change`."""
        model = self._model if self._pending is None else self._pending.model
        activation = Activation(wanted, vocabulary(model.labels))

        def place() -> None:
            self._config = dataclasses.replace(self._config, activation=wanted)
            if self._info.info is not None:
                self._recognizer.activation = activation

        return place

    def _put_in_place(self, _: Sequence[Any]) -> None:
        """Work with the model that was prepared, and show its features among the parameters."""
        if self._pending is not None and not self._adopting:
            pending, self._pending = self._pending, None
            self._adopt(pending, self._info.info)

    def _adopt(self, pending: _Pending, info: RadarInfo | None) -> None:
        self._chosen, self._model, self._config = pending.chosen, pending.model, pending.config
        if info is not None:
            self._recognizer = pending.recognizer
            self._compare(info)
        values = {name: value for name, value in flat(self._config).items() if _comes_with_model(name)}
        self._adopting = True
        try:
            self.set_parameters([Parameter(name, value=value) for name, value in values.items() if self.has_parameter(name)])
        finally:
            self._adopting = False
        self.get_logger().info(f"names {', '.join(self._model.labels)} with {self._chosen['model']} from now on")

    def _take_zones(self, msg: Any) -> None:
        self._zones = areas_from_msg(msg)

    def _take(self, cloud_msg: Any, tracks_msg: Any) -> None:
        started = time.monotonic_ns()
        self.count_gap(cloud_msg.sequence, tracks_msg.every)
        info = self._info.usable()
        if info is None:
            return
        tracked = TrackedCloud(cloud_from_msg(cloud_msg).to_room(info.mount), tracks_from_msg(tracks_msg))
        if self.went_back(tracked.cloud.stamp_ns):
            self._configure(info)
        decided = self._recognizer.decide(tracked)
        for gesture in filter(self._recognizer.wanted, (gesture for _, gesture in decided)):
            self._last = gesture if gesture.label else self._last
            zones = tuple(name for name, area in self._zones if area.inside(gesture.position))
            self._gestures.publish(gesture_to_msg(dataclasses.replace(gesture, zones=zones)))
        self.finish(tracked.cloud.stamp_ns, tracked.cloud.sequence, started)
        if decided and self._maps.get_subscription_count():
            for event, _ in decided:
                if isinstance(event, TrackEvent) and event.maps is not None:
                    self._maps.publish(maps_to_msg(event, event.maps, tracked.tracks.stamp_ns))

    def extra_diagnostics(self) -> tuple[dict[str, Any], list[str]]:
        """Say which gesture was the last and who is awake, for whoever looks at the graph now and then."""
        last, now = self._last, self.get_clock().now().nanoseconds
        told = {"radar_lacks": self._lacks} if self._lacks else {}
        if self._config.activation.mode == "wake" and self._info.info is not None:
            told["awake"] = ", ".join(map(str, self._recognizer.activation.awake(now))) or "nobody"
        if last is None:
            return told, []
        ago = (now - last.stamp_ns) * 1e-9
        about = {"": last.name, "_person": last.track_id, "_confidence": f"{last.confidence:.3f}", "_ago_s": f"{ago:.1f}"}
        return {f"last_gesture{key}": value for key, value in about.items()} | told, []


def _ready(model: str | Path, person: str) -> Classifier:
    """Read a model, and compile it now, not at the end of the first gesture."""
    chosen = model_of(model, person)
    chosen.probabilities(np.zeros(len(chosen.names)))
    return chosen


def _changeable(name: str) -> bool:
    """Whether a parameter may be set while the node runs; those that come with the model are, by the node itself."""
    return _comes_with_model(name) or name.startswith("activation.")


def _comes_with_model(name: str) -> bool:
    """Whether a parameter is one of those that a model names itself."""
    return name.partition(".")[0] in _MODELS_OWN


make_node = GesturesNode
if __name__ == "__main__":
    raise SystemExit(run(make_node))
