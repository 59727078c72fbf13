"""How the nodes of a graph are doing: what they say of themselves, and how long a frame takes to each of them."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass
from statistics import median
from typing import Any, Final

from diagnostic_msgs.msg import DiagnosticStatus

from radar_app.watching.latency import Latency, latencies
from radar_app.watching.listener import Ears
from radar_app.watching.reports import StageReport, reports_from_msg

_SILENT: Final = 3.0  # s: nodes say once a second how they are; who says nothing for so long hangs, or was killed
_KEPT: Final = 3000  # reports of stages that latencies are made of: some seconds
_SOME_LOST: Final = 0.05  # share of messages
_INPUTS: Final = {"radar/frame": "a driver", "radar/points": "baseband, or a driver,", "tracks": "tracking"}
_READERS: Final = frozenset(("baseband", "fusion", "tracking", "gestures", "hand", "presence", "zones"))
_WHAT: Final = ": processing"  # how the statuses of stages are named in diagnostics
_OK, _WARN, _STALE = DiagnosticStatus.OK, DiagnosticStatus.WARN, DiagnosticStatus.STALE
_LEVELS: Final = {_OK: "ok", _WARN: "warn", DiagnosticStatus.ERROR: "error", _STALE: "waiting"}


@dataclass(frozen=True)
class NodeState:
    """How one node is doing.

    Attributes
    ----------
    name : str
        Full name without the first slash: ``hall/left/driver``.
    state : str
        ``running``; ``warning``; ``error``; ``waiting``: no data yet; ``idle``: no data any more, as it should be; ``ended``: its source
        has; ``stale``: no data any more, which nobody ordered; ``silent``: it is there and says nothing.
    message : str
        What it says of itself.
    rate : float or None
        Messages finished in a second; None: not known.
    latency : float or None
        Median time from a frame's publication to this node's result [s].
    compute : float or None
        Mean time spent on a message [s].
    dropped : int or None
        Messages lost or refused since it started.
    wrong : str
        What is wrong, in words; empty: nothing.
    """

    name: str
    state: str
    message: str = ""
    rate: float | None = None
    latency: float | None = None
    compute: float | None = None
    dropped: int | None = None
    wrong: str = ""


@dataclass
class _Said:
    level: str
    message: str
    values: Mapping[str, str]
    time: float  # on CLOCK_MONOTONIC [s]


class Health:
    """Collects what nodes say, of the namespace of ``ears`` and those below; without ``latencies`` it hears them once a second only."""

    def __init__(self, ears: Ears, *, latencies: bool = True) -> None:
        self._ears = ears
        self._space = ears.node.get_namespace().strip("/")
        self._said: dict[str, _Said] = {}
        self._reports: deque[StageReport] = deque(maxlen=_KEPT)
        ears.hear("diagnostics", self._diagnostics)
        if latencies:
            ears.hear_each("stage_status", self._status)

    @property
    def heard(self) -> set[str]:
        """Full names of the nodes that have said how they are."""
        return set(self._said)

    def values(self, name: str) -> Mapping[str, str]:
        """Give what a node said last of itself in its diagnostics."""
        return self._said[name].values if name in self._said else {}

    def present(self) -> set[str]:
        """Full names of the nodes that are there, whether they say something or not."""
        return {name.strip("/") for name in self._ears.publishers("stage_status")}

    def unfed(self) -> list[str]:
        """Say which topics stages wait for that nobody publishes, one line each."""
        lines = []
        for topic, usual in _INPUTS.items():
            for name in self._ears.names(topic):
                readers = sorted({end.node_name for end in self._ears.node.get_subscriptions_info_by_topic(name)} & _READERS)
                if readers and not self._ears.node.count_publishers(name):
                    lines.append(f"{name}: nobody publishes it, and {', '.join(readers)} {_wait(readers)} for it; {usual} does, if it runs")
        return lines

    def states(self) -> list[NodeState]:
        """Say how all nodes are doing, in the order of their names."""
        late = latencies(self._reports)
        return [self._state(name, late.get(name, [])) for name in sorted(self.present() | self.heard)]

    def state(self, name: str) -> NodeState:
        """Say how one node is doing, by its full name."""
        return self._state(name, latencies(self._reports).get(name, []))

    def _state(self, name: str, late: list[Latency]) -> NodeState:
        said = self._said.get(name)
        if said is None or time.monotonic() - said.time > _SILENT:
            wrong = "it is there but says nothing: it hangs, or was killed a moment ago"
            return NodeState(name, "silent", wrong=wrong)
        rate, compute, dropped = (_number(said.values.get(key)) for key in ("rate_hz", "compute_ms", "dropped_total"))
        state, wrong = _judged(said, rate)
        known = late and name.rpartition("/")[2] != "driver"  # to itself it is none
        return NodeState(
            name,
            state,
            said.message,
            rate,
            median(each.late_ns for each in late) * 1e-9 if known else None,
            None if compute is None else compute * 1e-3,
            None if dropped is None else int(dropped),
            wrong,
        )

    def _diagnostics(self, msg: Any) -> None:
        for status in msg.status:
            name, what, rest = status.name.partition(_WHAT)
            if what and not rest and (not self._space or name.startswith(f"{self._space}/")):
                values = {pair.key: pair.value for pair in status.values}
                self._said[name] = _Said(_LEVELS.get(status.level, "error"), status.message, values, time.monotonic())

    def _status(self, space: str, msg: Any) -> None:
        self._reports.extend(report for report in reports_from_msg(msg, space.strip("/")) if not report.stale)


def _wait(readers: list[str]) -> str:
    return "waits" if len(readers) == 1 else "wait"


def _judged(said: _Said, rate: float | None) -> tuple[str, str]:
    """Say in what state a node is, and what is wrong with it."""
    if said.values.get("source") == "ended":
        return "ended", "the source has ended: nothing more comes; start it again, or set driver.at_end=loop"
    if said.level == "error":
        return "stale" if said.values.get("stale") == "True" else "error", said.message
    if said.level == "waiting":
        return "waiting", "no data has come yet"
    if said.level == "warn" and not _hardly(said):
        return "warning", said.message
    return ("idle" if said.message == "idle" and not rate else "running"), ""


def _hardly(said: _Said) -> bool:
    """Whether a node warns of nothing but some messages that were lost in its last second: a busy machine does that."""
    lost, rate = _number(said.values.get("dropped")) or 0.0, _number(said.values.get("rate_hz")) or 0.0
    return said.message == f"{lost:.0f} dropped" and lost <= _SOME_LOST * (rate + lost)


def _number(text: str | None) -> float | None:
    try:
        return None if text is None else float(text)
    except ValueError:
        return None
