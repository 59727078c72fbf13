"""A whole graph behind a TI board: a simulated walker's clouds, sent as the demo does over a pseudo terminal, become a track."""

import importlib
import sys
import threading
import time
from pathlib import Path

import numpy as np
import pytest
from handwave.msg import PointCloud as PointCloudMsg
from handwave.msg import RadarInfo as RadarInfoMsg
from handwave.msg import Track as TrackMsg
from handwave.msg import TrackArray as TrackArrayMsg
from rclpy.parameter import Parameter

from radar_app.graph import NODES, graph
from radar_dsp import Baseband, BasebandConfig
from radar_ros import qos
from radar_ros.messages.convert import cloud_from_msg
from radar_sim import Simulator, load_scene

sys.path.insert(0, str(Path(__file__).parents[1] / "driver"))
import ti_demo_emulator as ti

SCENE = """
duration: 4.0
seed: 5
radars:
  - waveform: {frame_interval: 0.05}
    mount: {z: 1.2}
effects: {noise: {noise_figure: 15}, losses: {level: 20}}
people:
  - {id: 1, position: [4.5, -0.6], script: [{walk: {to: [1.8, 0.6], speed: 0.9}}]}
"""
INTERVAL = 0.05


@pytest.fixture(scope="module")
def walk(tmp_path_factory):
    """Packets of 80 frames, and where the person is in each."""
    path = tmp_path_factory.mktemp("walk") / "walk.yaml"
    path.write_text(SCENE)
    simulator = Simulator(load_scene(path))
    baseband = Baseband(BasebandConfig(), simulator.info)
    packets, truth = [], []
    for number in range(80):
        simulated = simulator.process(number)
        packets.append(ti.cloud_packet(number, baseband.process(simulated.frame)))
        truth.append(simulated.truth.position[0])
    return packets, np.array(truth)


@pytest.fixture
def board(tmp_path):
    emulated = ti.Board(tmp_path / "ttyACM1")
    yield emulated
    emulated.unplug()


def start(ros, port):
    """Every node of the graph, in this process, with the settings that the command would give."""
    settings = {"driver": {"ti_demo.port": str(port), "ti_demo.frame_interval": INTERVAL, "ti_demo.mount.z": 1.2}}
    nodes = {}
    for spec in sorted(graph("clouds", parameters=settings), key=lambda spec: spec.name == "driver"):  # readers first
        overrides = [Parameter(name, value=value) for name, value in spec.parameters.items()]
        nodes[spec.name] = ros.add(importlib.import_module(NODES[spec.name].module).make_node(parameter_overrides=overrides))
    return nodes


@pytest.mark.long
def test_a_walker_is_tracked_through_the_line(ros, board, walk):
    """One confirmed person, where the simulated one is, from packets on a serial line."""
    packets, truth = walk
    tracks = ros.collect(TrackArrayMsg, "tracks", qos.RESULT)
    clouds = ros.collect(PointCloudMsg, "radar/points", qos.sensor(depth=100))
    infos = ros.collect(RadarInfoMsg, "radar/info", qos.LATCHED)
    nodes = start(ros, board.link)
    assert set(nodes) == {"driver", "tracking", "gestures", "hand", "zones", "visualisation"}
    assert ros.connect("radar/points", "radar/info", "tracks")
    assert ros.spin_until(lambda: infos)

    def send():
        for packet in packets:
            board.send(packet)
            time.sleep(INTERVAL)

    sender = threading.Thread(target=send)
    sender.start()
    ros.spin_until(lambda: tracks and tracks[-1].sequence >= len(packets) - 1, 20.0)
    sender.join()
    assert len(clouds) > 40  # a busy machine may lose some: the newest wins
    heard = cloud_from_msg(clouds[-1])
    assert heard.frame_id == "radar"
    assert np.isfinite(heard.snr).all()
    confirmed = [(m.sequence, t) for m in tracks for t in m.tracks if t.status == TrackMsg.CONFIRMED]
    assert len({t.id for _, t in confirmed}) == 1
    late = [(s, t) for s, t in confirmed if s > 30]
    assert len(late) > 20
    error = np.array([np.hypot(*(np.array(t.position[:2]) - truth[s, :2])) for s, t in late])
    assert np.median(error) < 0.35  # a body is 0.3 m deep, and its front is what is seen


def test_the_driver_goes_on_after_unplugging(ros, board, walk):
    """The node stays, says what is wrong, and clouds come again with the board, without a restart of the graph."""
    packets, _ = walk
    clouds = ros.collect(PointCloudMsg, "radar/points", qos.sensor(depth=100))
    overrides = [Parameter(name, value=value) for name, value in {"source": "ti_demo", "ti_demo.port": str(board.link)}.items()]
    node = ros.add(importlib.import_module(NODES["driver"].module).make_node(parameter_overrides=overrides))
    problems = []
    node.problem = problems.append
    assert ros.connect("radar/points")

    def send_until(wanted, timeout):
        end, k = time.monotonic() + timeout, 0
        while not wanted() and time.monotonic() < end:
            board.send(packets[k % len(packets)])
            k += 1
            ros.spin_until(lambda: False, 0.05)
        return wanted()

    assert send_until(lambda: len(clouds) > 3, 10.0)
    board.unplug()
    assert ros.spin_until(lambda: problems)
    assert "plug the board in" in problems[0]
    assert node.extra_diagnostics()[1]
    assert ros.spin_until(lambda: node.extra_diagnostics()[0]["data port.state"] == "off")
    before = len(clouds)
    board.plug()
    assert send_until(lambda: len(clouds) > before, 3.0)  # the accepted limit
    assert node.extra_diagnostics()[0]["reopened"] == 1


def test_the_boards_own_results_are_topics_beside_ours(ros, board):
    """Tracks in the room, a gesture once however often it is said, presence; while the points go to ours."""
    from handwave.msg import Gesture as GestureMsg
    from std_msgs.msg import Bool
    from test_ti_demo_packets import compressed, track

    tracks = ros.collect(TrackArrayMsg, "board/tracks", qos.RESULT)
    gestures = ros.collect(GestureMsg, "board/gestures", qos.RESULT)
    present = ros.collect(Bool, "board/presence", qos.RESULT)
    clouds = ros.collect(PointCloudMsg, "radar/points", qos.sensor(depth=100))
    settings = {"source": "ti_demo", "ti_demo.port": str(board.link), "ti_demo.mount.z": 1.2}
    overrides = [Parameter(name, value=value) for name, value in settings.items()]
    ros.add(importlib.import_module(NODES["driver"].module).make_node(parameter_overrides=overrides))
    assert ros.connect("board/tracks", "board/gestures", "board/presence", "radar/points")
    shares = np.array([0.1, 0.8, 0.0, 0.0, 0.1, 0.0, 0.0], "<f4").tobytes()
    points = compressed([(0.5, 2.0, -0.1)], [0.3], [15.0], [40.0])
    for number in range(6):
        own = {301: points, 308: track(7, (0.5, 2.0, 0.1), (0.0, -0.5, 0.0)), 351: bytes([number in (2, 3)]), 352: b"\1", 354: shares}
        board.send_all(ti.demo_packet(number, [ti.item(kind, value) for kind, value in own.items()], 1))
        ros.spin_until(lambda n=number: min(len(tracks), len(clouds)) > n, 5.0)
    (last,) = tracks[-1].tracks
    np.testing.assert_allclose(last.position, [2.0, -0.5, 1.3], atol=1e-6)
    np.testing.assert_allclose(last.velocity, [-0.5, 0.0, 0.0], atol=1e-6)
    assert (last.id, last.status) == (1, TrackMsg.CONFIRMED)
    assert 0.09 < np.sqrt(np.array(last.covariance).reshape(6, 6)[0, 0]) < 0.11
    assert [(m.name, m.label) for m in gestures] == [("swipe_right", GestureMsg.SWIPE_RIGHT)]
    assert gestures[0].confidence == pytest.approx(0.8)
    assert all(m.data for m in present)
    assert len(clouds) == len(tracks) == 6
