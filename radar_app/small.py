"""`handwave up --small`: a graph for small devices: one process, time budgets for baseband and tracking, no pictures."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Final

from radar_app.graph import NodeSpec, graph
from radar_core.paths import find_config

SHARES: Final[Mapping[str, float]] = {"baseband": 0.3, "tracking": 0.45}
"""Of the time from frame to frame; a quarter is left for gestures, hand, zones and messages."""
LEFT_OUT: Final = ("visualisation",)
LEVELS: Final = "small"
"""Levels in config/levels, by ``handwave lab tradeoff --tune --small``; on other machines only the ratios of their times count."""


def small_graph(
    variant: str,
    *,
    namespace: str = "",
    parameters: Mapping[str, Mapping[str, Any]] | None = None,
    beside: Sequence[str] = (),
) -> tuple[NodeSpec, ...]:
    """List the nodes of a variant for a small device, to be run in one process; arguments and errors are those of `graph`."""
    return graph(variant, namespace=namespace, parameters=budgeted(parameters or {}), without=LEFT_OUT, beside=beside)


def budgeted(given: Mapping[str, Mapping[str, Any]]) -> dict[str, dict[str, Any]]:
    """Give baseband and tracking time budgets; parameters that are ``given``, to a node or to all (``*``), win."""
    tuning, everywhere = str(find_config(LEVELS, "levels", ".json")), given.get("*", {})
    result = {node: dict(values) for node, values in given.items()}
    for label, values in result.items():  # of one of two radars: no share beside its own budget, nor beside none
        if "/" in label and "frame_budget_ms" in values:
            values.setdefault("frame_budget_share", 0.0)
    for node, share in SHARES.items():
        said = {**everywhere, **given.get(node, {})}
        own: dict[str, Any] = {} if "frame_budget_ms" in said else {"frame_budget_share": share}
        own |= {"budget.tuning": tuning}
        result[node] = {name: value for name, value in own.items() if name not in everywhere} | result.get(node, {})
    return result
