"""`handwave status`: one look at a graph."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import asdict, dataclass, field
from typing import Any, Final

from rich.console import Group, RenderableType
from rich.table import Table
from rich.text import Text

from radar_app.watching import facts
from radar_app.watching.health import Health, NodeState
from radar_app.watching.listener import Listener
from radar_app.watching.people import finite

HEALTHY, WRONG, NO_GRAPH = 0, 1, 2
"""Exit statuses."""
_FIND: Final = 5.0  # s: the middleware takes up to 3.4 s (measured) to find a node that is there
_LEAST: Final = 1.5  # s: of frames, for latencies
_STYLES: Final = {"running": "green", "idle": "dim", "warning": "yellow", "waiting": "yellow", "ended": "yellow"}


@dataclass(frozen=True)
class GraphStatus:
    """What one look at a graph found.

    Attributes
    ----------
    namespace : str
        Of the graph.
    nodes : tuple of NodeState
        By name; none: there is no graph.
    people : dict of str to int
        How many are there, by namespace of the tracks.
    wrong : tuple of str
        What is wrong, one line each.
    seen : dict of str to list of dict
        Radars, persons, zones, hands and gestures; see `radar_app.watching.facts`.
    """

    namespace: str
    nodes: tuple[NodeState, ...]
    people: dict[str, int]
    wrong: tuple[str, ...]
    seen: dict[str, list[dict[str, Any]]] = field(default_factory=dict)

    @property
    def code(self) -> int:
        """Exit status."""
        return NO_GRAPH if not self.nodes else WRONG if self.wrong else HEALTHY


def look(namespace: str = "", seconds: float = _FIND) -> GraphStatus:
    """Listen to a graph until every node that is there has said how it is, or for so long; an `interrupts.ros` context is open."""
    with Listener("status", namespace) as listener:
        health, heard = Health(listener), facts.Facts(listener)
        listener.until(lambda: bool(health.present()), seconds)
        begin = time.monotonic()

        def enough() -> bool:
            return time.monotonic() - begin > _LEAST and health.present() <= health.heard

        if health.present():
            listener.until(enough, seconds)
        nodes = tuple(health.states())
        unfed = health.unfed() if nodes else []
        seen = heard.records(health)
    return GraphStatus(f"/{namespace.strip('/')}", nodes, heard.counts, (*unfed, *_wrong(nodes)), seen)


def _wrong(nodes: Sequence[NodeState]) -> list[str]:
    """List what is wrong; that later stages lack data follows from an earlier one that sends none, and is said once."""
    ended = any(node.state == "ended" for node in nodes)
    return [f"{node.name}: {node.wrong}" for node in nodes if node.wrong and not (ended and node.state == "stale")]


def as_json(status: GraphStatus) -> dict[str, Any]:
    """Make what JSON holds; times in seconds, places in metres, angles in degrees."""
    about = {key: value for key, value in asdict(status).items() if key != "seen"}
    return {**finite({**about, **status.seen}), "healthy": status.code == HEALTHY}


def screen(status: GraphStatus) -> RenderableType:
    """Draw it for a terminal of 80 columns."""
    table = Table(box=None, pad_edge=False, padding=(0, 2, 0, 0))
    table.add_column("node")
    table.add_column("state")
    for name in ("rate [1/s]", "latency [ms]", "work [ms]", "lost"):
        table.add_column(Text(name), justify="right")  # as text: square brackets are markup
    for node in status.nodes:
        state = Text(node.state, style=_STYLES.get(node.state, "bold red"))
        figures = (_figure(node.rate, 1.0, ".1f"), _figure(node.latency, 1e3, ".1f"), _figure(node.compute, 1e3, ".2f"))
        table.add_row(node.name, state, *figures, "-" if node.dropped is None else str(node.dropped))
    parts: list[RenderableType] = [table, Text()]
    for space, count in sorted(status.people.items()):
        where = "" if len(status.people) == 1 else f" in {space}"
        parts.append(Text(f"{count} {'person is' if count == 1 else 'people are'} there{where}"))
    parts += facts.screen(status.seen) if status.seen else []
    if status.wrong:
        parts += [Text(f"wrong: {line}", style="bold red") for line in status.wrong]
    else:
        parts.append(Text(f"healthy: {len(status.nodes)} nodes", style="green"))
    return Group(*parts)


def _figure(value: float | None, factor: float, form: str) -> str:
    return "-" if value is None else f"{value * factor:{form}}"
