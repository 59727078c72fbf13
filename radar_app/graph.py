"""The graph of nodes, described once: launch files, `handwave up`, the demo and `ros2 run` are all made from it."""

from __future__ import annotations

import importlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

from radar_core import ConfigError
from radar_core.config import nearest


@dataclass(frozen=True)
class NodeSpec:
    """One node of the graph."""

    name: str  # of the node, and of its executable <name>_node
    module: str  # Python module with make_node
    parameters: Mapping[str, Any] = field(default_factory=dict)  # that differ from the defaults
    namespace: str = ""  # of ROS
    place: str = ""  # namespace within the graph, for a node of which it has several: left and right; it ends `namespace`
    words: tuple[str, ...] = ()  # arguments of what is no node but several (`radar_app.composed`)

    @property
    def label(self) -> str:
        """What tells it from all other nodes of its graph: ``left/driver``, or its name where there is only one."""
        return f"{self.place}/{self.name}" if self.place else self.name

    @property
    def path(self) -> str:
        """Namespace and name, as ROS has them, without the first slash: ``hall/left/driver``."""
        return f"{self.namespace}/{self.name}" if self.namespace else self.name


_REST = ("camera", "visualisation", "evaluation", "hand_evaluation", "recorder", "mqtt", "osc", "bridge", "vital")
NODES: Mapping[str, NodeSpec] = {
    name: NodeSpec(name, f"radar_ros.nodes.{name}")
    for name in ("driver", "cloud2", "baseband", "fusion", "tracking", "gestures", "hand", "presence", "zones", *_REST)
}
"""Every node there is."""

STAGES = ("baseband", "tracking", "gestures", "hand")
"""The stages between raw frames and results, in the order data flows."""


@dataclass(frozen=True)
class Variant:
    """Which nodes run together, and why."""

    doc: str  # one sentence for users
    nodes: tuple[str, ...]  # names; left/driver is a driver in the namespace left below that of the graph
    parameters: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)  # of each node, that this graph sets unless the user does


_RADARS = ("left", "right")
_EACH = tuple(f"{radar}/{node}" for radar in _RADARS for node in ("driver", "baseband"))

VARIANTS: Mapping[str, Variant] = {
    "demo": Variant("a simulated room, evaluated and recorded", ("driver", *STAGES, "zones", "visualisation", "evaluation", "recorder")),
    "live": Variant("a radar (or simulated radar) to people, gestures and a hand", ("driver", *STAGES, "zones", "visualisation")),
    "clouds": Variant(
        "a board that gives point clouds (handwave devices --boards) to people, gestures and a hand",
        ("driver", *STAGES[1:], "zones", "visualisation"),
        {"driver": {"source": "ti_demo"}},
    ),
    "targets": Variant(
        "a board that follows people itself (handwave devices --boards): its targets as tracks; gestures and hand need points",
        ("driver", "zones", "visualisation"),
        {"driver": {"source": "ld2450"}},
    ),
    "one_channel": Variant(
        "a radar without angles (an A121): whether somebody is there, how far away, breath, push, pull and wave",
        ("driver", "presence"),
        {"driver": {"source": "a121"}},
    ),
    "cloud2": Variant(
        "clouds of somebody else's driver (sensor_msgs/PointCloud2) to the same", ("cloud2", *STAGES[1:], "zones", "visualisation")
    ),
    "replay": Variant("everything but the driver, for recordings", (*STAGES, "zones", "visualisation")),
    "camera": Variant("a camera as the reference of the hand, beside a graph that runs", ("camera", "hand_evaluation")),
    "stages": Variant("the bare stages, for lockstep and measurements", STAGES),
    "two_radars": Variant(
        "two radars (or simulated radars) in left/ and right/, fused to people, gestures and a hand",
        (*_EACH, "fusion", *STAGES[1:], "zones", "visualisation"),
        {**{f"{radar}/driver": {"scene": "two_radars"} for radar in _RADARS}, "fusion": {"radars": list(_RADARS)}},
    ),
}
"""The graphs that launch files and `handwave up` offer."""


def graph(
    variant: str,
    *,
    namespace: str = "",
    parameters: Mapping[str, Mapping[str, Any]] | None = None,
    without: Sequence[str] = (),
    beside: Sequence[str] = (),
) -> tuple[NodeSpec, ...]:
    """List the nodes of a variant with their parameters.

    Parameters
    ----------
    variant : str
        Key of `VARIANTS`.
    namespace : str
        Namespace of all nodes, one per radar.
    parameters : mapping
        Per node name, parameters to set: ``driver`` is every driver, ``left/driver`` that one, ``"*"`` all nodes. The narrower one wins.
    without : sequence of str
        Nodes to leave out.
    beside : sequence of str
        Nodes that run too: ``mqtt``, ``osc``, ``vital``.

    Raises
    ------
    ConfigError
        When there is no such variant or node.
    """
    if variant not in VARIANTS:
        raise ConfigError(f"there is no graph {variant!r}{nearest(variant, VARIANTS)}; choose one of {', '.join(VARIANTS)}")
    chosen = VARIANTS[variant]
    given = dict(parameters or {})
    common = given.pop("*", {})
    known = (*NODES, *(name for name in chosen.nodes if name not in NODES))
    for name in (*given, *without, *beside):
        if name not in known:
            raise ConfigError(f"there is no node {name!r}{nearest(name, known)}; nodes: {', '.join(known)}")
    specs = []
    for label in (*chosen.nodes, *beside):
        place, _, name = label.rpartition("/")
        if name in without or label in without:
            continue
        own = {**chosen.parameters.get(label, {}), **common, **given.get(name, {}), **given.get(label, {})}
        space = "/".join(part for part in (namespace.strip("/"), place) if part)
        specs.append(replace(NODES[name], namespace=space, place=place, parameters=own))
    return tuple(specs)


def arguments(spec: NodeSpec) -> list[str]:
    """Command-line arguments after ``python -m module`` that start a node as described."""
    if spec.words:
        return list(spec.words)
    result = ["--ros-args", "-r", f"__node:={spec.name}"]
    if spec.namespace:
        result += ["-r", f"__ns:=/{spec.namespace.strip('/')}"]
    for name, value in spec.parameters.items():
        result += ["-p", f"{name}:={_yaml(value)}"]
    return result


def _yaml(value: Any) -> str:
    """Write a parameter value as YAML on one line; a string that looks like a number stays a string."""
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, str):
        return "'" + value.replace("'", "''") + "'"
    if isinstance(value, (list, tuple)):
        if {type(entry) for entry in value} == {int, float}:  # one ROS parameter has numbers of one kind only
            value = [float(entry) for entry in value]
        return "[" + ", ".join(map(_yaml, value)) + "]"
    return repr(value)


def run_node(name: str) -> int:
    """Run the node of that name in this process; for the executables of a ROS installation."""
    if name not in NODES:
        raise ConfigError(f"there is no node {name!r}; nodes: {', '.join(NODES)}")
    from radar_ros.stage import run

    return run(importlib.import_module(NODES[name].module).make_node)


def run_nodes(words: Sequence[str]) -> int:
    """Run several nodes in this process: name and ROS arguments of each, ``--`` between them; for the executable of a ROS installation."""
    groups: list[list[str]] = [[]]
    for word in words:
        if word == "--":
            groups.append([])
        else:
            groups[-1].append(word)
    for name, *_ in groups:
        if name not in NODES:
            raise ConfigError(f"there is no node {name!r}; nodes: {', '.join(NODES)}")
    from radar_ros.stage import run

    def maker(name: str, own: list[str]) -> Callable[[], Any]:
        return lambda: importlib.import_module(NODES[name].module).make_node(cli_args=own, use_global_arguments=False)

    return run(*(maker(name, own) for name, *own in groups))
