"""Samples of gestures from a running graph, and a model for its gesture node while it runs."""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import handwave.msg
from rcl_interfaces.msg import Parameter, ParameterType, ParameterValue
from rcl_interfaces.srv import SetParametersAtomically

from radar_core import ConfigError, DataError, RadarInfo
from radar_gestures.stage import GestureConfig
from radar_lab.datasets.own import Take, TakeRecorder
from radar_ros import qos
from radar_ros.interrupts import Visitor
from radar_ros.messages.convert import cloud_from_msg, info_from_msg
from radar_ros.messages.tracks import tracks_from_msg
from radar_ros.sync import Subscriber, TimeSynchronizer
from radar_tracking import TrackedCloud

_WAIT = 10.0  # s: for radar/info, and for the node's answer


class TakeListener(Visitor):
    """Records takes of a gesture from the graph in ``namespace``; see `TakeRecorder` for the folder, the gesture and the person.

    ``config`` gives the knobs of events and features for the radar that is there.
    """

    def __init__(self, folder: Path, gesture: str, person: int, config: Callable[[RadarInfo], GestureConfig], namespace: str = "") -> None:
        super().__init__("handwave_gesture_record", namespace)
        self._folder, self._gesture, self._person, self._config = folder, gesture, person, config
        self._info: RadarInfo | None = None
        self.recorder: TakeRecorder | None = None
        self._takes: list[Take] = []
        self.node.create_subscription(handwave.msg.RadarInfo, "radar/info", self._take_info, qos.LATCHED)
        inputs = [
            Subscriber(self.node, handwave.msg.PointCloud, "radar/points", qos_profile=qos.sensor(depth=50)),
            Subscriber(self.node, handwave.msg.TrackArray, "tracks", qos_profile=qos.RESULT),
        ]
        self._sync = TimeSynchronizer(inputs, 50)
        self._sync.registerCallback(self._take)

    def _take_info(self, msg: Any) -> None:
        if self._info is None:
            info = info_from_msg(msg)
            self.recorder = TakeRecorder(self._folder, self._gesture, self._person, info, self._config(info))
            self._info = info

    def _take(self, cloud_msg: Any, tracks_msg: Any) -> None:
        if self._info is None or self.recorder is None:
            return
        tracked = TrackedCloud(cloud_from_msg(cloud_msg).to_room(self._info.mount), tracks_from_msg(tracks_msg))
        take = self.recorder.process(tracked)
        if take is not None:
            self._takes.append(take)

    def takes(self, n: int, silent: float, told: Callable[[Take | str], None]) -> int:
        """Record until the folder holds ``n`` samples of the gesture; returns how many were added.

        ``told`` gets every take, and after each ``silent`` seconds without one the reason.

        Raises
        ------
        DataError
            When no radar tells what it is.
        """
        end = time.monotonic() + _WAIT
        while self.recorder is None and time.monotonic() < end:
            self.executor.spin_once(timeout_sec=0.1)
        if self.recorder is None:
            raise DataError("no radar/info came; is a graph running (handwave up), in this namespace and domain?")
        before, last = self.recorder.count, time.monotonic()
        while self.recorder.count < n:
            self.executor.spin_once(timeout_sec=0.1)
            while self._takes:
                told(self._takes.pop(0))
                last = time.monotonic()
            if time.monotonic() - last > silent:
                told(self.recorder.silence())
                last = time.monotonic()
        while self._takes:
            told(self._takes.pop(0))
        return self.recorder.count - before


class ModelSetter(Visitor):
    """Sets the model of the gesture node of a running graph."""

    def __init__(self, namespace: str = "") -> None:
        super().__init__("handwave_gesture_use", namespace)
        self._client = self.node.create_client(SetParametersAtomically, "gestures/set_parameters_atomically")

    def use(self, model: str, person: str = "") -> None:
        """Let the node name gestures with a model from now on, of the person who is there; empty: anybody.

        Raises
        ------
        DataError
            When there is no gesture node, or it does not answer.
        ConfigError
            When the node refuses, with its reason.
        """
        end = time.monotonic() + _WAIT
        while not self._client.service_is_ready() and time.monotonic() < end:
            self.executor.spin_once(timeout_sec=0.1)
        if not self._client.service_is_ready():
            raise DataError("there is no gesture node; is a graph running (handwave up), in this namespace and domain?")
        values = (("model", model), ("person", person))
        text = [Parameter(name=name, value=ParameterValue(type=ParameterType.PARAMETER_STRING, string_value=v)) for name, v in values]
        future = self._client.call_async(SetParametersAtomically.Request(parameters=text))
        self.executor.spin_until_future_complete(future, timeout_sec=_WAIT)
        if not future.done():
            raise DataError("the gesture node did not answer; is it busy? Look at /diagnostics")
        result = future.result().result
        if not result.successful:
            raise ConfigError(f"the gesture node refused: {result.reason}")
