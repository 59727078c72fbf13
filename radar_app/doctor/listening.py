"""What the doctor learns from a running graph: the same messages that a recording would hold, for some seconds."""

from __future__ import annotations

import time
from collections.abc import Callable
from functools import partial
from typing import Any, Final

import handwave.msg

from radar_app.doctor.reading import DATA, Intake, Parameters
from radar_core import DataError
from radar_lab.doctor.evidence import Evidence
from radar_lab.doctor.finding import Finding
from radar_ros import qos
from radar_ros.bags import TYPES, local
from radar_ros.interrupts import Visitor

_WAIT: Final = 15.0  # s: for a topic of a radar; the middleware takes up to 3.4 s to find a late joiner
_SETTLE: Final = 1.0  # s: from the first topic to the last
_CLOCK: Final = "/clock"


class Listener(Visitor):
    """Listens to all radars in ``namespace`` and below."""

    def __init__(self, namespace: str = "") -> None:
        super().__init__("handwave_doctor", namespace)
        self._prefix = f"/{namespace.strip('/')}/".replace("//", "/")
        self._parameters: Parameters = {}
        self._intake: Intake | None = None

    def _topics(self) -> dict[str, list[str]]:
        """Give the streams of every radar that somebody publishes, by namespace."""
        radars: dict[str, list[str]] = {}
        for topic, _ in self.node.get_topic_names_and_types():
            name = local(topic)
            if topic.startswith(self._prefix) and name in DATA and self.node.count_publishers(topic):
                radars.setdefault(topic.removesuffix(name).strip("/"), []).append(name)
        return {space: names for space, names in radars.items() if set(names) & set(DATA[:2])}

    def listen(
        self, seconds: float, parameters: Parameters | None = None, progress: Callable[[float], None] = lambda share: None
    ) -> tuple[list[Evidence], list[Finding]]:
        """Listen for so long [s] from when a radar is found; a `DataError` says that there is none.

        The result is that of `radar_app.doctor.reading.from_bag`.
        """
        end = time.monotonic() + _WAIT
        while not self._topics() and time.monotonic() < end:
            self.spin(0.1)
        self.spin(_SETTLE)
        radars = self._topics()
        if not radars:
            domain = "choose its --domain and --namespace, or start it: handwave up"
            raise DataError(f"no radar/frame and no radar/points within {_WAIT:g} s: is a graph running? {domain}")
        intake = Intake(radars, parameters)
        simulated = bool(self.node.count_publishers(_CLOCK))
        for space, names in radars.items():
            for name in (*names, "radar/info", "stage_status"):
                self._subscribe(f"/{space}/{name}".replace("//", "/"), name, intake)
        started = time.monotonic()
        while (passed := time.monotonic() - started) < seconds:
            progress(passed / seconds)
            self.spin(min(0.1, seconds))
        for evidence in intake.radars.values():
            evidence.simulated_time, evidence.live = simulated, True
        return intake.finish()

    def _subscribe(self, topic: str, name: str, intake: Intake) -> None:
        kind = qos.message_class(TYPES[name])
        take = partial(self._take, topic, intake)
        if kind is handwave.msg.RadarInfo:
            qos.subscribe_latched(self.node, kind, topic, take)
        else:
            self.node.create_subscription(kind, topic, take, qos.for_topic(name, reliable=True))

    def _take(self, topic: str, intake: Intake, msg: Any) -> None:
        intake.process(topic, self.node.get_clock().now().nanoseconds, msg)
