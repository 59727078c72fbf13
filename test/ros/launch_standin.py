"""A stand-in for launch and launch_ros where they are not installed: what our descriptions use of them, by their documentation.

Actions only keep what they were given. `Context` has the configurations that arguments fill, `build` visits a description as launch does,
and `command` makes of a node's action the command line that launch_ros runs.
"""

import sys
import types
from dataclasses import dataclass, field
from pathlib import Path

import yaml

ROOT = Path(__file__).resolve().parents[2]


@dataclass
class Context:
    launch_configurations: dict = field(default_factory=dict)


@dataclass
class LaunchDescription:
    entities: list


class DeclareLaunchArgument:
    def __init__(self, name, *, default_value=None, description=None, choices=None):
        assert default_value is None or isinstance(default_value, str)
        self.name, self.default_value, self.description, self.choices = name, default_value, description, choices

    def execute(self, context):
        value = context.launch_configurations.setdefault(self.name, self.default_value)
        if self.choices is not None and value not in self.choices:
            raise RuntimeError(f'Argument "{self.name}" provided value "{value}" is not valid. Valid options are: {self.choices}')


class OpaqueFunction:
    def __init__(self, *, function, args=None, kwargs=None):
        self.function, self.args, self.kwargs = function, args or [], kwargs or {}

    def execute(self, context):
        return self.function(context, *self.args, **self.kwargs)


@dataclass
class Shutdown:
    reason: str = "reason not given"


@dataclass
class TimerAction:
    period: float
    actions: list


@dataclass
class RegisterEventHandler:
    event_handler: object


@dataclass
class OnProcessExit:
    target_action: object = None
    on_exit: object = None


@dataclass
class ParameterValue:
    value: object
    value_type: object = None


@dataclass(eq=False)
class Node:
    executable: str
    package: str
    name: str | None = None
    namespace: str | None = None
    parameters: list = field(default_factory=list)
    remappings: list = field(default_factory=list)
    ros_arguments: list = field(default_factory=list)
    arguments: list = field(default_factory=list)
    output: str = "log"
    respawn: bool = False
    respawn_delay: float = 0.0


def install(monkeypatch):
    """Put the stand-ins where imports find them; gone with the test."""
    ours = sys.modules[__name__]
    parts = {
        "launch": ("LaunchDescription",),
        "launch.actions": ("DeclareLaunchArgument", "OpaqueFunction", "RegisterEventHandler", "Shutdown", "TimerAction"),
        "launch.event_handlers": ("OnProcessExit",),
        "launch_ros": (),
        "launch_ros.actions": ("Node",),
        "launch_ros.parameter_descriptions": ("ParameterValue",),
    }
    for name, content in parts.items():
        module = types.ModuleType(name)
        for each in content:
            setattr(module, each, getattr(ours, each))
        monkeypatch.setitem(sys.modules, name, module)


def build(description, **given):
    """What a description consists of when these arguments are given; entities are visited in order, as launch does."""
    context, actions = Context(dict(given)), []
    for entity in description.entities:
        actions += entity.execute(context) or []
    return actions


def plain(value):
    """Value of a parameter as it arrives; a text without a type is read as YAML, as launch_ros does."""
    if isinstance(value, ParameterValue):
        assert isinstance(value.value, value.value_type)
        return value.value
    if isinstance(value, (list, tuple)):
        return [plain(each) for each in value]
    return yaml.safe_load(value) if isinstance(value, str) else value


def command(node, folder):
    """Command line of a node of this package; ``folder`` gets its parameter files, and links to the executables as they are installed."""
    script = "composed" if node.executable == "composed_node" else "node"
    executable = folder / node.executable
    if not executable.exists():
        executable.symlink_to(ROOT / "scripts" / script)
    words = [sys.executable, str(executable), *node.arguments, "--ros-args", *node.ros_arguments]
    words += ["-r", f"__node:={node.name}"] if node.name else []
    words += ["-r", f"__ns:={node.namespace}"] if node.namespace else []
    for number, each in enumerate(node.parameters):
        path = each
        if isinstance(each, dict):
            path = folder / f"{id(node)}_{number}.yaml"
            path.write_text(yaml.safe_dump({"/**": {"ros__parameters": {name: plain(value) for name, value in each.items()}}}))
        words += ["--params-file", str(path)]
    for old, new in node.remappings:
        words += ["-r", f"{old}:={new}"]
    return words
