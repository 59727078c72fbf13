"""The driver node with an emulated DCA1000: frames as messages, diagnostics, the lifecycle, and kill -9."""

import os
import signal
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticArray
from handwave.msg import RadarFrame as RadarFrameMsg
from handwave.msg import RadarInfo as RadarInfoMsg
from rclpy.parameter import Parameter

from radar_app.graph import NodeSpec
from radar_app.supervisor import Supervisor
from radar_core import DeviceError
from radar_ros import qos
from radar_ros.messages.convert import frame_from_msg, from_time
from radar_ros.nodes.driver import make_node

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "driver"))
from dca1000_bench import Bench
from dca1000_emulator import BOARD, HOST, cfg, encode

SHAPE = (2, 16, 4, 64)
RNG = np.random.default_rng(9)
CUBES = [(RNG.integers(-2000, 2000, SHAPE) + 1j * RNG.integers(-2000, 2000, SHAPE)).astype(np.complex64) for _ in range(3)]
LONG = 40.0  # s


@pytest.fixture
def bench(tmp_path):
    """A capture card and a sensor."""
    one = Bench(tmp_path, [encode(cube) for cube in CUBES], cfg())
    yield one
    one.close()


def parameters(one, **other):
    """Settings of the node for the emulated boards."""
    given = {
        "config": str(one.cfg),
        "serial_port": str(one.tty),
        "host_address": HOST,
        "board_address": BOARD,
        "silence": 0.3,
        "timeout": 0.2,
    }
    given |= {"config_port": one.card.config_port, "data_port": one.card.data_port, **other}
    return {"source": "dca1000", **{f"dca1000.{name}": value for name, value in given.items()}}


def node_of(one, **other):
    """The node itself, in this process."""
    return make_node(parameter_overrides=[Parameter(name, value=value) for name, value in parameters(one, **other).items()])


def test_frames_are_published_as_the_board_sends_them(ros, bench):
    """Every sample, the info of the .cfg, stamps on the node's clock, and diagnostics that tell of packets and states."""
    frames = ros.collect(RadarFrameMsg, "radar/frame", qos.sensor(reliable=True))
    infos = ros.collect(RadarInfoMsg, "radar/info", qos.LATCHED)
    reports = ros.collect(DiagnosticArray, "diagnostics")
    node = ros.add(node_of(bench))
    assert ros.spin_until(lambda: len(frames) >= 20 and infos and reports and reports[-1].status[0].message != "idle", LONG)
    now = node.get_clock().now().nanoseconds
    for msg in frames:
        frame = frame_from_msg(msg)
        np.testing.assert_array_equal(frame.cube, CUBES[frame.sequence % 3])
        assert now - 60e9 < from_time(msg.header.stamp) < now
    values = {v.key: v.value for v in reports[-1].status[0].values}
    assert values["capture board.state"] == values["sensor.state"] == "running"
    assert values["capture board.packets_lost"] == "0"
    assert int(values["capture board.packets"]) > 20 * 23


def test_the_lifecycle_powers_the_board(ros, bench):
    """Deactivate: sensor and recording stop. Activate: frames come again. Cleanup: everything is let go of, and can be had by others."""
    frames = ros.collect(RadarFrameMsg, "radar/frame", qos.sensor(reliable=True))
    node = ros.add(node_of(bench))
    assert ros.spin_until(lambda: len(frames) >= 3, LONG)
    node.trigger_deactivate()
    assert not bench.card.recording
    assert not bench.cli.running
    ros.spin_until(lambda: False, 0.2)
    count = len(frames)
    node.trigger_activate()
    assert ros.spin_until(lambda: len(frames) >= count + 3, LONG)
    node.trigger_deactivate()
    node.trigger_cleanup()
    other = bench.source()
    other.power_up()
    other.power_down()


def test_a_board_that_is_not_there_is_one_line(bench):
    """The node does not start, and says what to check."""
    import rclpy

    bench.card.silent = True
    rclpy.init(args=[])
    try:
        with pytest.raises(DeviceError, match=r"capture board did not power up: .* does not answer system connect: check its power"):
            node_of(bench, timeout=0.05)
    finally:
        rclpy.try_shutdown()


@pytest.mark.long
def test_kill_9_of_the_driver(ros, bench):
    """The board goes on sending to a port that nobody has; the respawned driver stops it, sets it up, and frames come from 0 again.

    How long that takes is printed, and measured by the benchmark: within 3 s of the death on a machine that is not busy.
    """
    frames = ros.collect(RadarFrameMsg, "radar/frame", qos.sensor(reliable=True))
    lines = []
    specs = (NodeSpec("driver", "radar_ros.nodes.driver", parameters(bench)),)
    with Supervisor(specs, respawn=True, log=lambda name, line: lines.append(line)) as supervisor:
        assert ros.spin_until(lambda: len(frames) > 10, LONG), lines
        old = supervisor.pid("driver")
        os.kill(old, signal.SIGKILL)
        died = time.monotonic()
        assert ros.spin_until(lambda: any(e[0] == "driver" for e in supervisor.poll()), 5.0)
        assert bench.card.recording
        assert bench.cli.running
        ros.spin_until(lambda: False, 0.2)
        count = len(frames)
        starts = bench.log.count("sensorStart")
        assert ros.spin_until(lambda: bench.log.count("sensorStart") > starts, LONG), lines
        board = time.monotonic() - died
        assert ros.spin_until(lambda: len(frames) > count, LONG), lines
        print(f"board set up again after {board:.2f} s, frames after {time.monotonic() - died:.2f} s")
        assert frames[count].sequence < 500  # 10 s: connecting takes a busy machine long
        assert ros.spin_until(lambda: len(frames) > count + 10, LONG), lines
        assert supervisor.running == ["driver"]
    assert not bench.card.recording
    assert not bench.cli.running
    for msg in frames[count:]:
        frame = frame_from_msg(msg)
        np.testing.assert_array_equal(frame.cube, CUBES[frame.sequence % 3])
    assert not any("Traceback" in line for line in lines)


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_ends_the_driver_and_stops_the_board(ros, bench, number):
    """The sensor is stopped, then the recording; nothing goes on sending."""
    frames = ros.collect(RadarFrameMsg, "radar/frame", qos.sensor(reliable=True))
    lines = []
    with Supervisor(
        (NodeSpec("driver", "radar_ros.nodes.driver", parameters(bench)),), log=lambda name, line: lines.append(line)
    ) as supervisor:
        assert ros.spin_until(lambda: len(frames) > 3, LONG), lines
        os.kill(supervisor.pid("driver"), number)
        ended = []
        assert ros.spin_until(lambda: ended.extend(supervisor.poll()) or ended, 10.0)
    assert ended == [("driver", 0)]
    assert bench.log[-2:] == ["sensorStop", 6]
    assert not any("Traceback" in line for line in lines)
