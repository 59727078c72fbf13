"""Launch files: arguments, namespaces, one process or many; and run by the rules of launch, a scene that loses no frame and ends."""

import importlib.util
import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import launch_standin
import pytest
import yaml

from radar_app.graph import VARIANTS
from radar_app.launching import COMMON
from radar_core import ConfigError
from radar_ros import bags

ROOT = Path(__file__).resolve().parents[2]
FILES = {path.name.removesuffix(".launch.py"): path for path in sorted((ROOT / "launch").glob("*.launch.py"))}


def module_of(variant):
    spec = importlib.util.spec_from_file_location(f"{variant}_launch", FILES[variant])
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.fixture
def build(monkeypatch):
    """Actions of a launch file, given arguments, as `ros2 launch handwave FILE name:=value` has them."""
    launch_standin.install(monkeypatch)

    def make(variant, **given):
        words = [f"{name}:={value}" for name, value in given.items()]
        monkeypatch.setattr(sys, "argv", ["ros2", "launch", "handwave", f"{variant}.launch.py", *words])
        return launch_standin.build(module_of(variant).generate_launch_description(), **given)

    return make


def nodes_of(actions):
    return [action for action in actions if isinstance(action, launch_standin.Node)]


def parameters_of(node):
    """What a node is told, the later the stronger."""
    merged = {}
    for each in node.parameters:
        merged.update(each if isinstance(each, dict) else {"FILE": each})
    return {name: launch_standin.plain(value) for name, value in merged.items()}


@pytest.mark.parametrize("variant", FILES)
def test_every_node_of_the_graph_once(build, variant):
    """One process each, with the namespace of its radar, and what follows when it ends."""
    actions = build(variant)
    labels = [f"{node.namespace}/{node.name}".lstrip("/") for node in nodes_of(actions)]
    assert labels == list(VARIANTS[variant].nodes)
    handlers = [a.event_handler.target_action for a in actions if isinstance(a, launch_standin.RegisterEventHandler)]
    assert handlers == nodes_of(actions)


@pytest.mark.parametrize("variant", FILES)
def test_arguments_are_typed_and_described(monkeypatch, variant):
    """What may be given stands with each, for `ros2 launch --show-args`; the common ones are everywhere."""
    launch_standin.install(monkeypatch)
    declared = {e.name: e for e in module_of(variant).generate_launch_description().entities if hasattr(e, "default_value")}
    assert set(COMMON) <= set(declared)
    assert all(a.description.endswith("]") and len(a.description) > 12 for a in declared.values())
    assert "[true or false]" in declared["use_sim_time"].description
    assert declared["log_level"].choices == ["debug", "info", "warn", "error", "fatal"]


def test_two_radars_in_a_room(build):
    """Namespaces, what the drivers wait for, and the radars of the fusion."""
    nodes = {f"{n.namespace}/{n.name}": n for n in nodes_of(build("two_radars", namespace="hall", slop="0.03"))}
    assert {"/hall/left/driver", "/hall/right/driver", "/hall/fusion", "/hall/tracking"} <= set(nodes)
    told = parameters_of(nodes["/hall/left/driver"])
    assert set(told["wait_for_nodes"]) == {name for name in nodes if not name.endswith("/driver")}
    assert told["scene"] == "two_radars"
    assert parameters_of(nodes["/hall/fusion"]) == {"radars": ["left", "right"], "slop": 0.03}


def test_a_group_around_the_launch_file(monkeypatch):
    """PushRosNamespace of an including file comes before the namespace of the graph; its arguments are nobody's mistake."""
    launch_standin.install(monkeypatch)
    monkeypatch.setattr(sys, "argv", ["ros2", "launch", "house", "house.launch.py", "floor:=2"])
    description = module_of("live").generate_launch_description()
    actions = launch_standin.build(description, ros_namespace="/house", namespace="hall", floor="2")
    assert {node.namespace for node in nodes_of(actions)} == {"/house/hall"}
    assert "/house/hall/tracking" in parameters_of(nodes_of(actions)[0])["wait_for_nodes"]


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"scnee": "demo"}, r"live\.launch\.py has no argument scnee; did you mean scene\? Arguments: namespace, .*scene"),
        ({"use_sim_time": "maybe"}, "argument use_sim_time:=maybe makes no sense; give true or false: take the time"),
        ({"xyz": "1"}, r"live\.launch\.py has no argument xyz; Arguments"),
    ],
)
def test_wrong_arguments_are_named(build, given, message):
    """What was wrong, and what there is instead."""
    with pytest.raises(ConfigError, match=message):
        build("live", **given)


def test_wrong_numbers_and_choices(build):
    """Numbers by us; choices are refused by launch itself."""
    with pytest.raises(ConfigError, match="argument slop:=wide makes no sense; give number"):
        build("two_radars", slop="wide")
    with pytest.raises(RuntimeError, match=r"at_end.*Valid options are"):
        build("live", at_end="never")


def test_settings_reach_the_nodes(build):
    """Text stays text, a parameter file lies between defaults and what was given, clock, log level and respawn go to all."""
    nodes = nodes_of(
        build("live", scene="8", params_file="mine.yaml", use_sim_time="True", log_level="debug", respawn="true", at_end="exit")
    )
    driver = nodes[0]
    assert [each if isinstance(each, str) else set(each) for each in driver.parameters] == [
        {"wait_for_nodes", "source"},
        "mine.yaml",
        {"scene", "at_end", "use_sim_time"},
    ]
    assert parameters_of(driver)["scene"] == "8"
    assert all(parameters_of(node)["use_sim_time"] is True for node in nodes)
    assert all(node.ros_arguments == ["--log-level", "debug"] for node in nodes)
    assert [node.respawn for node in nodes] == [False] + [True] * (len(nodes) - 1)  # a driver that should end is not started again
    assert all(node.respawn for node in nodes_of(build("live", respawn="true")))


def test_rviz_follows_the_namespace(build):
    """Every topic that the display shows is mapped into the namespace; without being asked for, rviz does not start."""
    assert "rviz2" not in {node.package for node in nodes_of(build("live", namespace="hall"))}
    (rviz,) = (node for node in nodes_of(build("live", namespace="hall", rviz="true")) if node.package == "rviz2")
    display = yaml.safe_load(Path(rviz.arguments[1]).read_text())["Visualization Manager"]["Displays"]
    shown = {entry["Topic"]["Value"] for entry in display if "Topic" in entry}
    assert rviz.namespace == "/hall"
    assert {old for old, _ in rviz.remappings} == shown
    assert all(new == old.lstrip("/") for old, new in rviz.remappings)


def test_what_follows_when_a_node_ends(build):
    """The source: everything, after a moment. Settings that make no sense: everything at once. Another node: nothing."""
    handlers = {a.event_handler.target_action.name: a.event_handler.on_exit for a in build("demo") if hasattr(a, "event_handler")}

    class Exit:
        def __init__(self, returncode):
            self.returncode = returncode

    (timer,) = handlers["driver"](Exit(0), None)
    assert timer.period > 1.0
    assert isinstance(timer.actions[0], launch_standin.Shutdown)
    (end,) = handlers["tracking"](Exit(2), None)
    assert "tracking refused its configuration" in end.reason
    assert handlers["tracking"](Exit(-11), None) == []


def run(actions, folder, timeout):
    """Run actions by the rules of launch: start every process, call handlers when one ends, SIGINT to all at a shutdown; status of each."""
    nodes = nodes_of(actions)
    handlers = {id(a.event_handler.target_action): a.event_handler.on_exit for a in actions if hasattr(a, "event_handler")}
    log = (folder / "log.txt").open("w")
    processes = {
        id(node): subprocess.Popen(launch_standin.command(node, folder), stdout=log, stderr=log, cwd=folder, env=os.environ)
        for node in nodes
    }
    end, stop, seen = time.monotonic() + timeout, None, set()
    try:
        while time.monotonic() < end and len(seen) < len(nodes):
            for key, process in processes.items():
                if key not in seen and process.poll() is not None:
                    seen.add(key)
                    for action in handlers[key](process, None) if stop is None else []:
                        stop = time.monotonic() + getattr(action, "period", 0.0)
            if stop is not None and time.monotonic() > stop:
                for process in processes.values():
                    if process.poll() is None:
                        process.send_signal(signal.SIGINT)
                stop = float("inf")
            time.sleep(0.05)
        return {node.name or node.executable: processes[id(node)].poll() for node in nodes}
    finally:
        for process in processes.values():
            if process.poll() is None:
                process.kill()
            process.wait()
        log.close()


@pytest.mark.parametrize("variant", FILES)
def test_the_real_launch_builds_the_same(monkeypatch, variant):
    """Where launch is installed: its own actions take our arguments, and give one node for each of the graph."""
    pytest.importorskip("launch_ros", reason="launch and launch_ros are not installed here; run this test on a ROS 2 installation")
    from launch.actions import DeclareLaunchArgument, OpaqueFunction
    from launch_ros.actions import Node

    from launch import LaunchContext

    monkeypatch.setattr(sys, "argv", ["ros2", "launch", "handwave", f"{variant}.launch.py"])
    context, actions = LaunchContext(), []
    for entity in module_of(variant).generate_launch_description().entities:
        assert isinstance(entity, (DeclareLaunchArgument, OpaqueFunction))
        actions += entity.execute(context) or []
    assert len([a for a in actions if isinstance(a, Node)]) == len(VARIANTS[variant].nodes)


SCENE = """
duration: 2.0
seed: 5
radars: [{waveform: {frame_interval: 0.1}}]
points: [{position: [2.0, 0.5, 1.4], velocity: [0.5, 0, 0], rcs: 0.1}]
effects: {noise: {}}
"""


@pytest.mark.long
@pytest.mark.parametrize("composed", ["false", "true"])
def test_the_demo_loses_no_frame_and_ends(build, tmp_path, composed):
    """Every frame of the scene is in the recording, from the first to the last, and goes through the graph; all end with status 0."""
    (tmp_path / "scene.yaml").write_text(SCENE)
    places = {"scene": tmp_path / "scene.yaml", "bag": tmp_path / "bag", "report": tmp_path / "report.json"}
    actions = build("demo", namespace="hall", composed=composed, **{name: str(path) for name, path in places.items()})
    ended = run(actions, tmp_path, 220.0)
    log = (tmp_path / "log.txt").read_text()
    assert set(ended.values()) == {0}, (ended, log[-3000:])
    counts = bags.contents(places["bag"])
    assert counts["/hall/radar/frame"] == 20, log[-3000:]
    assert min(counts["/hall/radar/points"], counts["/hall/tracks"]) >= 15  # on a busy machine the newest frame wins
    assert json.loads(places["report"].read_text())["gestures"]["total"] == 0
