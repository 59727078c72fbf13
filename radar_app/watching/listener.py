"""Hearing a running graph: real subscriptions, in whatever namespace there is something to hear."""

from __future__ import annotations

import os
import time
from collections.abc import Callable
from functools import partial
from types import TracebackType
from typing import Any, Final, Self

from radar_ros import qos
from radar_ros.bags import TYPES
from radar_ros.interrupts import Visitor

_LOOK: Final = 0.3  # s: how often it is looked for topics that are new; ROS tells nobody of them
_PULSE: Final = 0.1  # s: how often a condition is looked at while messages come

Take = Callable[[Any], None]
TakeOf = Callable[[str, Any], None]
"""Takes a message, and the namespace that it came from, e.g. ``/hall/left``."""


class Ears:
    """Subscriptions of a node to a graph, by the names of topics in `radar_ros.bags.TYPES`."""

    def __init__(self, node: Any) -> None:
        self.node = node
        self._wanted: list[tuple[str, TakeOf, bool]] = []
        self._heard: set[tuple[str, int]] = set()
        self._timer: Any = None

    def hear(self, topic: str, take: Take, *, reliable: bool = False) -> None:
        """Take every message of a topic in the node's own namespace; ``reliable`` where none may be lost."""
        self._subscribe(qos.place(topic), topic, take, reliable)

    def hear_each(self, topic: str, take: TakeOf, *, reliable: bool = False) -> None:
        """Take every message of a topic in the node's namespace and in all below it, also of graphs that come later."""
        self._wanted.append((topic, take, reliable))
        self._hear_there(len(self._wanted) - 1, f"{self.node.get_namespace().rstrip('/')}/{topic}")
        if self._timer is None:
            self._timer = self.node.create_timer(_LOOK, self.look)
        self.look()

    def publishers(self, topic: str) -> set[str]:
        """Full names of the nodes that publish a topic in the node's namespace or below it, e.g. ``/left/driver``."""
        return {
            f"{end.node_namespace.rstrip('/')}/{end.node_name}"
            for name in self.names(topic)
            for end in self.node.get_publishers_info_by_topic(name)
        }

    def look(self) -> None:
        """Subscribe to what is new in the graph."""
        for number, (topic, _, _) in enumerate(self._wanted):
            for name in self.names(topic):
                self._hear_there(number, name)

    def _hear_there(self, number: int, name: str) -> None:
        if (name, number) not in self._heard:
            self._heard.add((name, number))
            topic, take, reliable = self._wanted[number]
            self._subscribe(name, topic, partial(take, name.removesuffix(f"/{topic}") or "/"), reliable)

    def names(self, topic: str) -> list[str]:
        """Full names of a topic in the node's namespace and in all below it."""
        space = self.node.get_namespace().rstrip("/")
        there = self.node.get_topic_names_and_types()
        return [name for name, kinds in there if name.startswith(f"{space}/") and name.endswith(f"/{topic}") and TYPES[topic] in kinds]

    def _subscribe(self, name: str, topic: str, take: Take, reliable: bool) -> None:
        kind, profile = qos.message_class(TYPES[topic]), qos.for_topic(topic, reliable=reliable)
        if profile is qos.LATCHED:
            qos.subscribe_latched(self.node, kind, name, take)
        else:
            self.node.create_subscription(kind, name, take, profile)


class Listener(Visitor, Ears):
    """A node of a command that hears a graph; leaves it at the end of a ``with`` block."""

    def __init__(self, what: str, namespace: str = "") -> None:
        Visitor.__init__(self, f"handwave_{what}_{os.getpid()}", namespace)
        Ears.__init__(self, self.node)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
        self.close()

    def until(self, done: Callable[[], bool], seconds: float) -> bool:
        """Take in what comes until something is the case, at most for so long; returns whether it is."""
        end = time.monotonic() + seconds
        while not done():
            if time.monotonic() > end:
                return False
            self.spin(_PULSE)
        return True
