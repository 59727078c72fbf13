"""Launch descriptions of the graphs, for `ros2 launch`: the same nodes as `handwave up`, made from the same description."""

from __future__ import annotations

import difflib
import re
import sys
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

from radar_app.graph import NodeSpec, arguments, graph
from radar_core import ConfigError
from radar_core.paths import share_dir

_DRAIN = 2.0  # s: after the source has ended, for results to arrive and be written
_RESPAWN_AFTER = 2.0  # s
_CONFIGURATION = 2  # exit status of a node whose configuration makes no sense, now and the next time
_LEVELS = ("debug", "info", "warn", "error", "fatal")
COMMON: Mapping[str, tuple[Any, ...]] = {
    "namespace": ("", "namespace of the graph, e.g. hall; several graphs need one each"),
    "params_file": ("", "parameter file of ROS: stronger than the defaults here, weaker than arguments that differ from them"),
    "use_sim_time": (False, "take the time from /clock"),
    "respawn": (False, "start a node again that died"),
    "composed": (False, "all nodes in one process"),
    "log_level": ("info", "least level that is logged", _LEVELS),
    "rviz": (False, "show people and points in rviz2"),
}
"""Arguments of every launch file: default, what it is, and choices where there are some."""
_DISPLAYS = ("radar/points2", "tracks/points2", "tracks/markers")
"""Topics that rviz/handwave.rviz shows."""


@dataclass(frozen=True)
class _Argument:
    """One launch argument; ``target`` is the node (``*``: all) whose parameter it sets, empty for those of `COMMON`."""

    name: str
    default: Any
    doc: str
    choices: tuple[str, ...]
    target: str

    @property
    def text(self) -> str:
        """The default as launch wants it."""
        return str(self.default).lower() if isinstance(self.default, bool) else str(self.default)

    @property
    def kind(self) -> str:
        """What may be given, for people."""
        if self.choices:
            return ", ".join(self.choices)
        return {bool: "true or false", int: "whole number", float: "number"}.get(type(self.default), "text")

    def parse(self, text: str) -> Any:
        """Make a value of the default's type; a `ConfigError` says what may be given."""
        try:
            if isinstance(self.default, bool):
                return {"true": True, "1": True, "false": False, "0": False}[text.lower()]
            value = type(self.default)(text)
        except (KeyError, ValueError):
            raise ConfigError(f"argument {self.name}:={text} makes no sense; give {self.kind}: {self.doc}") from None
        if self.choices and value not in self.choices:
            raise ConfigError(f"argument {self.name}:={text} makes no sense; choose {self.kind}: {self.doc}")
        return value


def launch_description(variant: str, settings: Mapping[str, tuple[Any, ...]]) -> Any:
    """Build the launch description of a graph.

    Parameters
    ----------
    variant : str
        Key of `radar_app.graph.VARIANTS`; the launch file is called after it.
    settings : mapping
        ``node.parameter`` (a ``*`` node: all) to default and description, and choices where there are some. The launch argument is called
        as the parameter; the default's type is the argument's. The arguments of `COMMON` come with them.

    Returns
    -------
    launch.LaunchDescription
        It waits for readers before frames come, ends with the source, and stops everything when a node refuses its settings.
    """
    from launch.actions import DeclareLaunchArgument, OpaqueFunction

    from launch import LaunchDescription

    known = _arguments(settings)
    declared = [
        DeclareLaunchArgument(a.name, default_value=a.text, description=f"{a.doc} [{a.kind}]", choices=list(a.choices) or None)
        for a in known.values()
    ]
    return LaunchDescription([*declared, OpaqueFunction(function=_actions, kwargs={"variant": variant, "known": known})])


def _arguments(settings: Mapping[str, tuple[Any, ...]]) -> dict[str, _Argument]:
    """All arguments by name; those of the launch file replace common ones."""
    result = {name: _Argument(name, row[0], row[1], tuple(row[2]) if len(row) > 2 else (), "") for name, row in COMMON.items()}
    for path, row in settings.items():
        target, _, name = path.partition(".")
        result[name] = _Argument(name, row[0], row[1], tuple(row[2]) if len(row) > 2 else (), target)
    return result


def _refuse_unknown(variant: str, known: Mapping[str, _Argument]) -> None:
    """Raise `ConfigError` for an argument on the command line that this launch file does not have; launch would ignore it.

    Where another launch file includes this one, arguments may be that one's, and nothing is refused.
    """
    file = f"{variant}.launch.py"
    if not any(Path(word).name == file for word in sys.argv):
        return
    for name in (found[1] for word in sys.argv if (found := re.match(r"(\w+):=", word))):
        if name not in known:
            near = difflib.get_close_matches(name, known, 1)
            hint = f"did you mean {near[0]}? " if near else ""
            raise ConfigError(f"{file} has no argument {name}; {hint}Arguments: {', '.join(known)}")


def _actions(context: Any, *, variant: str, known: Mapping[str, _Argument]) -> list[Any]:
    """Make the actions, once launch knows what was given."""
    _refuse_unknown(variant, known)
    given = {name: argument.parse(context.launch_configurations[name]) for name, argument in known.items()}
    outer = context.launch_configurations.get("ros_namespace", "")  # of a group around this launch file
    space = "/".join(part.strip("/") for part in (outer, given["namespace"]) if part.strip("/"))
    parameters: list[dict[str, dict[str, Any]]] = [{}, {}]  # the defaults', and those that the user wants otherwise
    for name, argument in known.items():
        if argument.target:
            parameters[given[name] != argument.default].setdefault(argument.target, {})[name] = given[name]
    if given["use_sim_time"]:
        parameters[1].setdefault("*", {})["use_sim_time"] = True
    specs = graph(variant, namespace=space, parameters=parameters[0])
    wanted = [_own(spec, parameters[1]) for spec in specs]
    readers = [f"/{spec.namespace}/{spec.name}".replace("//", "/") for spec in specs if spec.name != "driver"]
    specs = tuple(_waiting(spec, readers) if spec.name == "driver" else spec for spec in specs)
    make = _composed if given["composed"] else _processes
    return [*make(specs, wanted, given), *([_rviz(space, given["use_sim_time"])] if given["rviz"] else [])]


def _own(spec: NodeSpec, given: Mapping[str, Mapping[str, Any]]) -> dict[str, Any]:
    """Parameters that were given for one node, the narrower ones winning."""
    return {**given.get("*", {}), **given.get(spec.name, {}), **given.get(spec.label, {})}


def _waiting(spec: NodeSpec, readers: list[str]) -> NodeSpec:
    """Let a driver wait for the other nodes."""
    return replace(spec, parameters={"wait_for_nodes": readers, **spec.parameters}) if readers else spec


def _processes(specs: tuple[NodeSpec, ...], wanted: list[dict[str, Any]], given: Mapping[str, Any]) -> list[Any]:
    """One process per node, and what follows when it ends."""
    from launch_ros.actions import Node

    actions: list[Any] = []
    for spec, own in zip(specs, wanted, strict=True):
        ends = _ends(spec, own) or (spec.name == "driver" and not given["respawn"])
        files = [given["params_file"]] if given["params_file"] else []
        node = Node(
            package="handwave",
            executable=f"{spec.name}_node",
            name=spec.name,
            namespace=f"/{spec.namespace}" if spec.namespace else "",
            parameters=[p for p in (_typed(spec.parameters), *files, _typed(own)) if p],
            ros_arguments=["--log-level", given["log_level"]],
            output="screen",
            respawn=given["respawn"] and not ends,
            respawn_delay=_RESPAWN_AFTER,
        )
        actions += [node, _follow(node, spec.label, ends)]
    return actions


def _composed(specs: tuple[NodeSpec, ...], wanted: list[dict[str, Any]], given: Mapping[str, Any]) -> list[Any]:
    """All nodes in one process, which ends when the source does."""
    from launch_ros.actions import Node

    words: list[str] = []
    for spec, own in zip(specs, wanted, strict=True):
        files = ["--params-file", given["params_file"]] if given["params_file"] else []
        settings = arguments(NodeSpec(spec.name, spec.module, own))[3:]  # without the name, which comes first
        words += ["--", spec.name, *arguments(spec), *files, *settings, "--log-level", given["log_level"]]
    ends = not given["respawn"] or any(_ends(spec, own) for spec, own in zip(specs, wanted, strict=True))
    node = Node(
        package="handwave",
        executable="composed_node",
        arguments=words[1:],
        output="screen",
        respawn=not ends,
        respawn_delay=_RESPAWN_AFTER,
    )
    return [node, _follow(node, "composed_node", ends)]


def _ends(spec: NodeSpec, own: Mapping[str, Any]) -> bool:
    """Whether a node ends by itself and should: a driver whose source has an end."""
    return spec.name == "driver" and {**spec.parameters, **own}.get("at_end") == "exit"


def _typed(parameters: Mapping[str, Any]) -> dict[str, Any]:
    """Keep texts texts: launch would read 8 as a number."""
    from launch_ros.parameter_descriptions import ParameterValue

    return {name: ParameterValue(value, value_type=str) if isinstance(value, str) else value for name, value in parameters.items()}


def _follow(node: Any, label: str, ends: bool) -> Any:
    """Stop everything when the source has ended (``ends``), and when a node refuses its settings."""
    from launch.actions import RegisterEventHandler
    from launch.event_handlers import OnProcessExit

    return RegisterEventHandler(OnProcessExit(target_action=node, on_exit=partial(_ended, label, ends)))


def _ended(label: str, ends: bool, event: Any, context: Any) -> list[Any]:
    from launch.actions import Shutdown, TimerAction

    if event.returncode == _CONFIGURATION:
        return [Shutdown(reason=f"{label} refused its configuration, see above")]
    return [TimerAction(period=_DRAIN, actions=[Shutdown(reason=f"{label} has ended")])] if ends else []


def _rviz(space: str, use_sim_time: bool) -> Any:
    """Start rviz2, whose displays follow the namespace."""
    from launch_ros.actions import Node

    return Node(
        package="rviz2",
        executable="rviz2",
        namespace=f"/{space}" if space else "",
        arguments=["-d", str(share_dir() / "rviz" / "handwave.rviz")],
        remappings=[(f"/{topic}", topic) for topic in _DISPLAYS],
        parameters=[{"use_sim_time": use_sim_time}],
        output="screen",
    )
