"""What a running graph says, by real subscriptions in one thread of its own."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any, Final

import handwave.msg
from diagnostic_msgs.msg import DiagnosticArray
from rcl_interfaces.srv import GetParameters, SetParameters
from rclpy.clock import Clock, ClockType
from rclpy.context import Context
from rclpy.executors import ExternalShutdownException
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.serialization import deserialize_message
from rclpy.task import Future
from std_srvs.srv import Trigger

from radar_app.view.feed import Feed
from radar_app.view.messages import Taker
from radar_app.view.spectra import FrameTaker, wanted
from radar_core import HandwaveError, RadarFrame
from radar_ros import qos
from radar_ros.executor import make_executor
from radar_ros.messages.convert import frame_from_msg

Told = Callable[[bool, str], None]
"""Is told whether something was done, and in words."""

_LOOK: Final = 0.5  # s: how often the graph is asked which radars there are, and what somebody wants
_PULSE: Final = 0.2  # s: how long the end may have to wait
_ANSWER: Final = 5.0  # s: for a service
_EVERYWHERE: Final = {"handwave/msg/RadarInfo": "radar/info", "handwave/msg/StageStatus": "stage_status"}
"""Types of topics of which every radar has one of its own, and their names."""


class LiveSource:
    """Listens to a running graph.

    Parameters
    ----------
    namespace : str
        Of the graph.
    zones_file : Path or None
        Where zones are kept; None: in the file that the zones node reads, if it reads one.
    feed : Feed or None
        Where everything goes; None: a new one.

    Attributes
    ----------
    title, goes : str
        For people.
    feed : Feed
        What was heard.
    taker : Taker
        Counts messages that made no sense.
    """

    def __init__(self, namespace: str = "", zones_file: Path | None = None, feed: Feed | None = None) -> None:
        self.title = f"live graph{f' /{namespace}' if namespace else ''}"
        self.goes = "live"
        self.feed = feed if feed is not None else Feed()
        self.taker = Taker(self.feed)
        self._given_file, self._graph_file = zones_file, ""
        self._asked: Future[GetParameters.Response] | None = None
        self._asked_at = 0.0  # on the monotonic clock [s]
        self._context = Context()
        self._context.init(args=[])  # without signal handlers, which only rclpy.init installs
        self._node = Node("handwave_view", namespace=namespace, context=self._context, start_parameter_services=False)
        self._executor = make_executor(self._context)
        self._executor.add_node(self._node)
        self._space = self._node.get_namespace().rstrip("/")
        self._everywhere: set[str] = set()
        self._frames: dict[str, Any] = {}
        self._takers: dict[str, FrameTaker] = {}
        self._subscribe()
        self._ask = self._node.create_client(GetParameters, "zones/get_parameters")
        self._set = self._node.create_client(SetParameters, "zones/set_parameters")
        self._again = self._node.create_client(Trigger, "zones/reload")
        self._node.create_timer(_LOOK, self._look, clock=Clock(clock_type=ClockType.STEADY_TIME))
        self._closing = threading.Event()
        self._thread = threading.Thread(target=self._spin, name="handwave_view_ros")
        self._thread.start()

    def _subscribe(self) -> None:
        """Read what there is one of in a graph."""
        node = self._node
        streams = (("radar/points", handwave.msg.PointCloud), ("gestures/maps", handwave.msg.GestureMaps))
        results = (("tracks", handwave.msg.TrackArray), ("gestures", handwave.msg.Gesture), ("hand", handwave.msg.HandTrack))
        for topic, kind in (*streams, *results):
            node.create_subscription(kind, topic, partial(self.taker.take, topic), qos.for_topic(topic))
        qos.subscribe_latched(node, handwave.msg.ZoneArray, "zones", partial(self.taker.take, "zones"))
        node.create_subscription(DiagnosticArray, "/diagnostics", self._diagnostics, 50)

    def _diagnostics(self, msg: Any) -> None:
        inside = self._space.lstrip("/")
        msg.status = [status for status in msg.status if not inside or status.name.startswith(f"{inside}/")]
        self.taker.take("diagnostics", msg)

    def _look(self) -> None:
        """See which radars there are, and read their raw frames while somebody wants them."""
        for topic, (kind, *_) in self._node.get_topic_names_and_types():
            if not topic.startswith(f"{self._space}/"):
                continue
            place = _place(topic[len(self._space) + 1 :], _EVERYWHERE.get(kind, "radar/frame"))
            if place is None:
                continue
            if kind in _EVERYWHERE and topic not in self._everywhere:
                self._everywhere.add(topic)
                self._read(topic, _EVERYWHERE[kind], place)
            elif kind == "handwave/msg/RadarFrame" and topic not in self._frames and wanted(self.feed):
                self._takers[topic] = FrameTaker(self.feed)
                profile = qos.sensor(depth=1)
                self._frames[topic] = self._node.create_subscription(
                    handwave.msg.RadarFrame, topic, partial(self._frame, topic), profile, raw=True
                )
        if self._frames and not wanted(self.feed):
            for subscription in self._frames.values():
                self._node.destroy_subscription(subscription)
            self._frames.clear()
        self._find_zones_file()

    def _read(self, topic: str, name: str, place: str) -> None:
        take = partial(self.taker.take, name, place=place)
        if name == "radar/info":
            qos.subscribe_latched(self._node, handwave.msg.RadarInfo, topic, take)
        else:
            self._node.create_subscription(handwave.msg.StageStatus, topic, take, qos.for_topic(name))

    def _frame(self, topic: str, data: bytes) -> None:
        def made() -> RadarFrame:
            return frame_from_msg(deserialize_message(data, handwave.msg.RadarFrame))

        try:
            self._takers[topic].take(time.monotonic(), made)
        except HandwaveError as error:
            self.taker.refused += 1
            self.taker.reason = f"{topic}: {error}"

    def _find_zones_file(self) -> None:
        """Ask the zones node where its zones are; a node that hangs never answers, so that an old question is taken back."""
        now = time.monotonic()
        if self._asked is not None and not self._asked.done():
            if now < self._asked_at + _ANSWER:
                return
            self._ask.remove_pending_request(self._asked)
        self._asked = None
        if self._ask.service_is_ready():
            self._asked_at = now
            self._asked = self._ask.call_async(GetParameters.Request(names=["zones_file"]))
            self._asked.add_done_callback(self._found_zones_file)

    def _found_zones_file(self, future: Any) -> None:
        answer = future.result()
        self._graph_file = answer.values[0].string_value if answer is not None and answer.values else ""

    @property
    def note(self) -> str:
        """How many messages made no sense, and why the last one."""
        return self.taker.note

    @property
    def zones_file(self) -> Path | None:
        """Where zones are kept; None: nowhere yet."""
        if self._given_file is not None:
            return self._given_file
        file = Path(self._graph_file)
        return file if self._graph_file and file.is_absolute() else None

    def reload_zones(self, told: Told) -> None:
        """Let the graph read the zones file; ``told`` is called from another thread, with what the graph says to it."""
        self._executor.create_task(self._reload, told)

    def _reload(self, told: Told) -> None:
        file = self.zones_file
        if file is None or not (self._again.service_is_ready() and self._set.service_is_ready()):
            told(False, "saved; but no zones node runs in this graph that could read it (handwave up has one)")
            return
        told = _once(told)
        late = self._node.create_timer(_ANSWER, lambda: told(False, "saved; but the zones node does not answer: look at its log"))
        if Path(self._graph_file) == file.resolve():
            future = self._again.call_async(Trigger.Request())
            future.add_done_callback(lambda done: told(bool(done.result().success), str(done.result().message)))
        else:
            parameter = Parameter("zones_file", value=str(file.resolve())).to_parameter_msg()
            future = self._set.call_async(SetParameters.Request(parameters=[parameter]))
            future.add_done_callback(lambda done: told(bool(done.result().results[0].successful), str(done.result().results[0].reason)))
        future.add_done_callback(lambda _: self._node.destroy_timer(late))

    def _spin(self) -> None:
        try:
            while not self._closing.is_set():
                self._executor.spin_once(timeout_sec=_PULSE)
        except ExternalShutdownException:
            pass  # somebody else ended ROS in this process

    def close(self) -> None:
        """Leave the graph; when it returns, the thread has ended."""
        self._closing.set()
        self._thread.join()
        self._executor.shutdown()
        self._node.destroy_node()
        self._context.try_shutdown()


def _place(topic: str, name: str) -> str | None:
    """Namespace of a topic within the graph: of left/radar/info it is left; None: the topic has another name."""
    if topic == name:
        return ""
    return topic.removesuffix(f"/{name}") if topic.endswith(f"/{name}") else None


def _once(told: Told) -> Told:
    """Call it the first time only."""
    calls: list[bool] = []

    def tell(good: bool, text: str) -> None:
        if not calls:
            calls.append(good)
            told(good, text)

    return tell
