"""One description of the graph: every node can be started from it, and launch files are made from nothing else."""

import importlib
import importlib.util
import re
from pathlib import Path

import pytest

from radar_app.graph import NODES, VARIANTS, NodeSpec, arguments, graph, run_node
from radar_core import ConfigError

ROOT = Path(__file__).resolve().parents[2]
LAUNCH_FILES = sorted((ROOT / "launch").glob("*.launch.py"))


def load(path):
    spec = importlib.util.spec_from_file_location(path.name.replace(".", "_"), path)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.mark.parametrize("name", NODES)
def test_every_node_has_its_entry_points(name):
    """``make_node`` for composition, and a process of its own that runs it."""
    module = importlib.import_module(NODES[name].module)
    assert callable(module.make_node)
    assert "run(make_node)" in Path(module.__file__).read_text()


def test_executables_of_the_build_are_the_nodes():
    """CMake installs one executable per node of the description."""
    text = (ROOT / "CMakeLists.txt").read_text()
    listed = re.search(r"foreach\(_node ([^)]*)\)", text)[1].split()
    assert set(listed) == set(NODES)


def test_settings_reach_the_command_line():
    """Parameters, namespace and common settings; strings stay strings."""
    specs = graph("live", namespace="left", parameters={"*": {"reliable": True}, "driver": {"scene": "8", "duration": 3.0}})
    line = arguments(next(s for s in specs if s.name == "driver"))
    assert line[:4] == ["--ros-args", "-r", "__node:=driver", "-r"]
    assert "__ns:=/left" in line
    assert "scene:='8'" in line
    assert "duration:=3.0" in line
    assert all("reliable:=true" in arguments(s) for s in specs)


def test_lists_of_numbers_are_of_one_kind():
    """ROS refuses [1, 2.5]; a list of names stays one, whole numbers stay whole."""
    spec = NodeSpec("x", "y", {"boxes": [0, 2.5, -1, 1], "counts": [1, 2], "names": ("left", "2")})
    assert {"boxes:=[0.0, 2.5, -1.0, 1.0]", "counts:=[1, 2]", "names:=['left', '2']"} <= set(arguments(spec))


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: graph("party"), "no graph 'party'; choose one of demo, live"),
        (lambda: graph("live", parameters={"drvier": {}}), "no node 'drvier' \\(did you mean 'driver'\\?\\); nodes: driver"),
        (lambda: run_node("x"), "no node 'x'"),
    ],
)
def test_typing_mistakes_are_named(call, message):
    """Names that do not exist get the list of those that do."""
    with pytest.raises(ConfigError, match=message):
        call()


@pytest.mark.parametrize("path", LAUNCH_FILES, ids=lambda p: p.name)
def test_launch_files_fit_the_description(path):
    """A launch file names a variant of ours and only nodes and parameters that exist there."""
    module = load(path)
    names = {name.rpartition("/")[2] for name in VARIANTS[module.VARIANT].nodes}
    for argument in module.ARGUMENTS:
        node, _, parameter = argument.partition(".")
        assert node == "*" or node in names
        assert parameter
    assert callable(module.generate_launch_description)


def test_launch_parameters_exist_in_their_nodes(ros):
    """Every parameter that a launch file sets is one that its node declares (or rclpy's own)."""
    declared = {}
    for path in LAUNCH_FILES:
        arguments = load(path).ARGUMENTS
        source = arguments.get("driver.source", ("sim",))[0]
        for argument in arguments:
            node, _, parameter = argument.partition(".")
            if node == "*" or node in ("recorder",):
                continue
            kind = node, source if node == "driver" else ""
            if kind not in declared:
                from rclpy.parameter import Parameter

                extra = [Parameter("autostart", value=False), Parameter("source", value=source)] if node == "driver" else []
                declared[kind] = ros.add(importlib.import_module(NODES[node].module).make_node(parameter_overrides=extra))
            assert declared[kind].has_parameter(parameter), argument
