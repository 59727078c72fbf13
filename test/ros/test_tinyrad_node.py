"""The driver node on a TinyRad through the real libusb: its life, and its death."""

import os
import signal
import sys
import time
from itertools import pairwise
from pathlib import Path

import pytest
from diagnostic_msgs.msg import DiagnosticArray
from handwave.msg import RadarFrame as RadarFrameMsg
from handwave.msg import RadarInfo as RadarInfoMsg
from rclpy.parameter import Parameter
from usb.backend import libusb0, libusb1, openusb

from radar_app.graph import graph
from radar_app.supervisor import Supervisor
from radar_core import ConfigError, DeviceError
from radar_driver.boards.tinyrad import find
from radar_ros import qos
from radar_ros.messages.convert import from_time
from radar_ros.nodes.driver import make_node

sys.path.insert(0, str(Path(__file__).parents[1] / "driver"))
from umockdev_machine import Machine, missing


@pytest.fixture
def machine(monkeypatch):
    """A machine with a board: what is started from now on finds it."""
    if missing():
        pytest.skip(missing())
    one = Machine()
    for name, value in one.changes.items():
        monkeypatch.setenv(name, value)
    yield one
    one.close()


def specs(**knobs):
    settings = {"source": "tinyrad", **{f"tinyrad.{name}": value for name, value in knobs.items()}}
    return graph("live", parameters={"driver": settings}, without=("baseband", "tracking", "gestures", "hand", "visualisation"))


@pytest.mark.long
@pytest.mark.umockdev
def test_kill_9_of_the_driver_and_its_restart(ros, machine):
    """SIGKILL while frames come: started again, it brings the board into step, and frames come again; then the same with the plug."""
    frames = ros.collect(RadarFrameMsg, "radar/frame", qos.sensor(depth=50))
    infos = ros.collect(RadarInfoMsg, "radar/info", qos.LATCHED)
    diagnostics = ros.collect(DiagnosticArray, "diagnostics")
    lines = []
    with Supervisor(specs(), respawn=True, log=lambda name, line: lines.append(line)) as supervisor:
        assert ros.spin_until(lambda: len(frames) > 20 and infos, 30.0), lines
        assert any(infos[0].channel_error)  # from the board's memory
        uneven = [
            abs(from_time(b.header.stamp) - from_time(a.header.stamp) - 20_000_000 * (b.sequence - a.sequence)) for a, b in pairwise(frames)
        ]
        # The clocks are compared by the frame that came fastest so far: most steps are exact but for the allowed drift of 2 us a frame.
        assert sorted(uneven)[len(uneven) // 2] < 100_000
        os.kill(supervisor.pid("driver"), signal.SIGKILL)
        assert ros.spin_until(lambda: supervisor.poll(), 5.0)
        frames.clear()
        assert ros.spin_until(lambda: len(frames) > 10, 30.0), lines[-5:]
        machine.say("unplug")
        assert ros.spin_until(lambda: any("unplugged: plug it in again" in line for line in lines), 10.0), lines[-5:]
        machine.say("plug")
        frames.clear()
        assert ros.spin_until(lambda: len(frames) > 10, 10.0), lines[-5:]
        diagnostics.clear()
        assert ros.spin_until(lambda: told(diagnostics).get("sequencer.state") == "running", 10.0)
        values = told(diagnostics)
        assert values["controller.temperature"] == "31.25"
        assert values["reopened"] == "1"
        started = time.monotonic()
    assert time.monotonic() - started < 3.0
    assert len(supervisor.crashes) == 1


def told(diagnostics):
    """Values of the driver's newest diagnostics."""
    found = {}
    for message in diagnostics:
        for status in message.status:
            if "driver" in status.name:
                found = {pair.key: pair.value for pair in status.values}
    return found


def make(**values):
    return make_node(parameter_overrides=[Parameter(name, value=value) for name, value in values.items()])


@pytest.mark.usefixtures("ros")
def test_a_driver_without_its_board_says_so():
    """Nothing plugged in at this machine, or no libusb to look with: one message with the remedy."""
    if find():
        pytest.skip("a TinyRad is plugged in")
    remedy = "no TinyRad is plugged in: plug it in" if libusb1.get_backend() else "needs libusb, .*: sudo apt-get install libusb-1.0-0"
    with pytest.raises(DeviceError, match=remedy):
        make(source="tinyrad")


@pytest.mark.usefixtures("ros")
def test_a_driver_without_libusb_says_what_to_install(monkeypatch):
    """As on a fresh machine; looking for boards finds none and does not fail."""
    monkeypatch.setattr(libusb1, "get_backend", lambda *_, **__: None)
    for other in (libusb0, openusb):
        monkeypatch.setattr(other, "get_backend", lambda *_, **__: None)
    assert find() == []
    with pytest.raises(DeviceError, match="the TinyRad needs libusb, which is not there: sudo apt-get install libusb"):
        make(source="tinyrad")


@pytest.mark.usefixtures("ros")
def test_knobs_are_parameters():
    """tinyrad.chirps and others by name, with description and range; what the board cannot do is refused before it is touched."""
    with pytest.raises(ConfigError, match="the board's memory holds 12 frames"):
        make(**{"source": "tinyrad", "tinyrad.buffers": 60})
    with pytest.raises(ConfigError, match=r"tinyrad\.power"):
        make(**{"source": "tinyrad", "tinyrad.power": 101})
    node = make(**{"source": "tinyrad", "autostart": False, "tinyrad.sequence": [2, 1], "tinyrad.mount.z": 0.8})
    assert list(node.get_parameter("tinyrad.sequence").value) == [2, 1]
    assert node._config.sequence == (2, 1)
    assert node._config.mount.z == 0.8
    assert "[s]" in node.describe_parameter("tinyrad.timeout").description
    node.destroy_node()
