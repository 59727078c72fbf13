"""The driver and its neighbours as processes of their own: life and end, what a wrong set-up gets, recordings as a source."""

import os
import signal
import subprocess
import sys
import time

import pytest
import rclpy
from handwave.msg import PointCloud as PointCloudMsg
from handwave.msg import RadarFrame as RadarFrameMsg
from handwave.msg import RadarInfo as RadarInfoMsg
from handwave.msg import Truth as TruthMsg
from rclpy.parameter import Parameter
from tf2_msgs.msg import TFMessage

import radar_ros.nodes.driver
from radar_app.graph import arguments, graph
from radar_core import DataError
from radar_driver.sources import meant
from radar_ros import bags, qos
from radar_ros.bag_frames import BagFrames
from radar_ros.messages.convert import from_time
from radar_ros.offline import simulate, simulators
from radar_sim import Simulator, load_scene

SCENE = "duration: 1.0\nseed: 3\npoints: [{position: [2.0, 0.5, 1.4], velocity: [0.5, 0, 0], rcs: 0.1}]\neffects: {noise: {}}\n"
N_FRAMES = 50


@pytest.fixture
def start():
    """Start a node as a process; whatever the test leaves is killed."""
    processes = []

    def go(module, *settings, name=None):
        line = [sys.executable, "-m", module, "--ros-args", *(word for s in settings for word in ("-p", s))]
        line += ["-r", f"__node:={name}"] if name else []
        processes.append(subprocess.Popen(line, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, env=os.environ))
        return processes[-1]

    yield go
    for process in processes:
        if process.poll() is None:
            process.kill()
        process.communicate()


@pytest.fixture(scope="module")
def scene(tmp_path_factory):
    """A scene of 50 frames."""
    path = tmp_path_factory.mktemp("scenes") / "brief.yaml"
    path.write_text(SCENE)
    return path


def seen(ros, name):
    """Wait until a node of that name is there, so that signals find it past its imports; a name of its own is no dead node's."""
    return ros.spin_until(lambda: name in ros.node.get_node_names(), 30.0)


@pytest.mark.long
def test_processes_make_clouds_of_a_scene(ros, start, scene):
    """Driver and baseband apart: clouds, truth and tf arrive, and their stamps agree with the frames'."""
    clouds = ros.collect(PointCloudMsg, "radar/points", qos.sensor(reliable=True))
    frames = ros.collect(RadarFrameMsg, "radar/frame", qos.sensor(reliable=True))
    truths = ros.collect(TruthMsg, "truth", qos.RESULT)
    transforms = ros.collect(TFMessage, "/tf_static", qos.LATCHED)
    start("radar_ros.nodes.baseband", "reliable:=true")
    start("radar_ros.nodes.driver", f"scene:={scene}", "at_end:=loop")
    # The middleware may take seconds to connect the processes, and each topic in its own time: hence a loop, and what all have seen.
    assert ros.spin_until(lambda: min(map(len, (clouds, frames, truths))) >= N_FRAMES and transforms, 60.0)
    info = Simulator(load_scene(scene)).info
    assert transforms[0].transforms[0].child_frame_id == "radar"
    assert transforms[0].transforms[0].transform.translation.z == info.mount.z
    middles = {f.sequence: from_time(f.header.stamp) + info.waveform.acquisition_ns // 2 for f in frames}
    for others in (clouds, truths):
        both = [m for m in others if m.sequence in middles]
        assert len(both) > N_FRAMES // 3
        assert all(from_time(m.header.stamp) == middles[m.sequence] for m in both)


@pytest.mark.long
def test_the_driver_ends_with_its_scene(start, scene):
    """at_end exit: the process ends by itself, with status 0."""
    driver = start("radar_ros.nodes.driver", f"scene:={scene}", "at_end:=exit")
    output, _ = driver.communicate(timeout=60)
    assert driver.returncode == 0, output
    assert "the source ends after 50 frames" in output


@pytest.mark.long
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_node_stops_though_simulated_time_stands_still(ros, start, number):
    """No clock, no timer, no message: a signal ends the node all the same, with status 0 and without a traceback."""
    process = start("radar_ros.nodes.baseband", "use_sim_time:=true", name=f"asleep{number}")
    assert seen(ros, f"asleep{number}")
    time.sleep(0.5)  # until it sleeps in the middleware
    process.send_signal(number)
    output, _ = process.communicate(timeout=10)
    assert process.returncode == 0, output
    assert "Traceback" not in output


@pytest.mark.long
def test_many_signals_are_one(ros, start, scene):
    """`ros2 launch` and an impatient user send SIGINT more than once; the driver at work still ends with status 0."""
    process = start("radar_ros.nodes.driver", f"scene:={scene}", "at_end:=loop", name="pestered")
    assert seen(ros, "pestered")
    time.sleep(0.3)  # until it is at work
    for _ in range(20):
        if process.poll() is None:
            process.send_signal(signal.SIGINT)
        time.sleep(0.01)
    output, _ = process.communicate(timeout=10)
    assert process.returncode == 0, output
    assert "Traceback" not in output


@pytest.mark.long
@pytest.mark.parametrize(
    ("settings", "message"),
    [
        (["scnee:=short"], "no parameter 'scnee' (did you mean 'scene'?); it knows:"),
        (["at_end:=explode"], "at_end of node driver is 'explode'; choose one of stop, loop, exit"),
        (["source:=usb"], "there is no source 'usb'; choose one of"),
        (["rate:=0.0"], "parameter rate of node driver"),
        (["source:=bag", "bag:=/nowhere"], "/nowhere"),
    ],
)
def test_a_wrong_set_up_is_one_line_and_status_2(start, settings, message):
    """No traceback, nothing half started."""
    process = start("radar_ros.nodes.driver", *settings)
    output, _ = process.communicate(timeout=60)
    assert process.returncode == 2, output
    assert message in output
    assert "Traceback" not in output


@pytest.fixture(scope="module")
def two_radars(scene, tmp_path_factory):
    """One bag with the same radar as left (all frames) and as right (the first five)."""
    folder = tmp_path_factory.mktemp("two")
    list(simulate(simulators(scene), folder / "one"))
    with bags.BagWriter(folder / "both") as writer:
        counts = {"left": N_FRAMES, "right": 5}
        for item in bags.read(folder / "one", ("radar/info", "radar/frame")):
            for side in counts:
                if item.topic.endswith("radar/info") or counts[side] > 0:
                    counts[side] -= item.topic.endswith("radar/frame")
                    writer.write(f"/{side}/{item.topic.strip('/')}", item.msgtype, item.stamp_ns, item.data)
    return folder / "both"


def test_radars_of_one_bag_are_not_mixed(two_radars):
    """The namespace says which radar; without one the choice is the user's."""
    for side, n_frames in (("left", N_FRAMES), ("/right", 5)):
        source = BagFrames(two_radars, side)
        assert source.n_frames == n_frames
        assert [source.frame(i)[0].sequence for i in range(5)] == [0, 1, 2, 3, 4]
        source.close()
    with pytest.raises(DataError, match="holds the radars /left/, /right/; give the driver the namespace"):
        BagFrames(two_radars)


def test_frames_wait_for_nodes_that_are_awaited(ros, scene, monkeypatch):
    """A node that is there but has not subscribed yet, because it compiles, is waited for; the log says for whom; then frame 0 comes."""
    monkeypatch.setattr(radar_ros.nodes.driver, "_PATIENCE_NS", 0)
    frames = ros.collect(RadarFrameMsg, "/hall/radar/frame", qos.sensor(reliable=True))
    late = ros.add(rclpy.create_node("late", namespace="/hall"))
    settings = {"scene": str(scene), "wait_for_nodes": ["late", "/hall/later"]}
    overrides = [Parameter(name, value=value) for name, value in settings.items()]
    driver = ros.add(radar_ros.nodes.driver.make_node(namespace="hall", parameter_overrides=overrides))
    said = []
    driver.caution = said.append
    assert ros.spin_until(lambda: said)
    assert said[0].startswith("no frames yet: waiting for late, /hall/later; ")
    assert said[0].endswith("handwave compile")
    ros.add(rclpy.create_node("later", namespace="/hall")).create_subscription(RadarInfoMsg, "radar/info", lambda msg: None, qos.LATCHED)
    assert ros.spin_until(lambda: said[-1].startswith("no frames yet: waiting for late; "))
    assert not frames
    late.create_subscription(RadarInfoMsg, "radar/info", lambda msg: None, qos.LATCHED)
    assert ros.spin_until(lambda: frames)
    assert frames[0].sequence == 0


def test_a_namespace_around_the_graph_changes_no_radar(two_radars):
    """In the house of which the bag is one room the radars are the same; a part of a name is none."""
    source = BagFrames(two_radars, "/house/hall/right")
    assert source.n_frames == 5
    source.close()
    for other in ("hall", "bright", "left/hall"):
        with pytest.raises(DataError, match="holds the radars /left/, /right/"):
            BagFrames(two_radars, other)


@pytest.mark.parametrize(
    ("namespace", "places", "expected"),
    [
        ("left", ["left", "right"], "left"),
        ("/hall/left", ["left", "right"], "left"),
        ("left", ["hall/left", "hall/right"], "hall/left"),
        ("left", ["hall/left", "den/left"], None),
        ("hall/left", ["left", "hall/left"], "hall/left"),
        ("den/hall/left", ["left", "hall/left"], "hall/left"),
        ("", ["", "left"], ""),
        ("", ["left", "right"], None),
        ("cleft", ["left", "right"], None),
    ],
)
def test_which_radar_a_namespace_means(namespace, places, expected):
    """Whole names only, the longest that fits, and none where two fit alike."""
    assert meant(namespace, places) == expected


@pytest.mark.parametrize("side", ["left", "right"])
def test_two_radars_of_a_scene_in_a_room(ros, side):
    """`two_radars.launch.py namespace:=hall`: each driver finds its radar, and names its frame with the namespace once."""
    (spec,) = (s for s in graph("two_radars", namespace="hall") if s.label == f"{side}/driver")
    infos = ros.collect(RadarInfoMsg, f"/hall/{side}/radar/info", qos.LATCHED)
    node = ros.add(radar_ros.nodes.driver.make_node(cli_args=arguments(spec), use_global_arguments=False))
    assert node.get_namespace() == f"/hall/{side}"
    assert ros.spin_until(lambda: infos)
    assert infos[0].header.frame_id == f"hall/{side}/radar"
    assert infos[0].mount_y_m == {"left": 0.8, "right": -0.8}[side]


def test_a_bag_drives_in_its_namespace(ros, two_radars):
    """Frames of the bag with fresh stamps; the frame's name carries the driver's namespace once."""
    infos = ros.collect(RadarInfoMsg, "/right/radar/info", qos.LATCHED)
    frames = ros.collect(RadarFrameMsg, "/right/radar/frame", qos.sensor(depth=50))
    settings = {"source": "bag", "bag": str(two_radars), "at_end": "loop"}
    ros.add(radar_ros.nodes.driver.make_node(namespace="right", parameter_overrides=[Parameter(k, value=v) for k, v in settings.items()]))
    assert ros.spin_until(lambda: len(frames) > 12 and infos)  # more than the bag has: it loops
    assert infos[0].header.frame_id == frames[0].header.frame_id == "right/radar"
    stamps = [from_time(f.header.stamp) for f in frames]
    sequences = [f.sequence for f in frames]
    assert all((b - a) == 20_000_000 * (n - m) for a, b, m, n in zip(stamps, stamps[1:], sequences, sequences[1:], strict=False))
