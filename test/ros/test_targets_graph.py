"""A whole graph behind a board that follows people itself: a simulated walk, sent as an LD2450 does, becomes one track."""

import importlib
import sys
import threading
import time
from pathlib import Path

import numpy as np
import pytest
from handwave.msg import RadarInfo as RadarInfoMsg
from handwave.msg import Track as TrackMsg
from handwave.msg import TrackArray as TrackArrayMsg
from rclpy.parameter import Parameter
from std_msgs.msg import UInt32
from visualization_msgs.msg import MarkerArray

from radar_app.graph import NODES, graph
from radar_ros import qos
from radar_ros.board_results import NO_POINTS

sys.path.insert(0, str(Path(__file__).parents[1] / "driver"))
import ld2450_emulator as ld


@pytest.fixture
def board(tmp_path):
    emulated = ld.Board(tmp_path / "ttyUSB0")
    yield emulated
    emulated.close()


@pytest.mark.long
def test_a_walker_is_tracked_through_the_line(ros, board, capfd):
    """One person where the walk is, also after the board was unplugged for a moment; gestures are off, and the driver says why."""
    tracks = ros.collect(TrackArrayMsg, "tracks", qos.RESULT)
    counts = ros.collect(UInt32, "people_count", qos.RESULT)
    markers = ros.collect(MarkerArray, "tracks/markers", qos.RESULT)
    infos = ros.collect(RadarInfoMsg, "radar/info", qos.LATCHED)
    settings = {"driver": {"ld2450.port": str(board.link), "ld2450.mount.z": 1.2}}
    for spec in sorted(graph("targets", parameters=settings), key=lambda spec: spec.name == "driver"):
        overrides = [Parameter(name, value=value) for name, value in spec.parameters.items()]
        ros.add(importlib.import_module(NODES[spec.name].module).make_node(parameter_overrides=overrides))
    assert ros.spin_until(lambda: infos)
    truth = np.column_stack([np.linspace(-0.6, 0.6, 50), np.linspace(4.5, 1.8, 50)])

    def send():
        for number, (x, y) in enumerate(truth):
            if number == 25:
                board.unplug()
                time.sleep(0.2)
                board.plug()
                time.sleep(1.0)  # the driver looks for it every half second
            board.send(ld.report((x, y, -0.5)))
            time.sleep(0.1)

    sender = threading.Thread(target=send)
    sender.start()
    ros.spin_until(lambda: not sender.is_alive(), 30.0)
    sender.join()
    ros.spin_until(lambda: False, 0.3)
    confirmed = [(m, t) for m in tracks for t in m.tracks if t.status == TrackMsg.CONFIRMED]
    assert len(confirmed) > 20
    assert len({t.id for _, t in confirmed[:10]}) == 1
    message, last = confirmed[-1]
    assert message.header.frame_id == "room"
    assert np.hypot(last.position[0] - 1.8, last.position[1] + 0.6) < 0.3
    assert last.position[2] == pytest.approx(1.2, abs=0.3)
    assert 0 < np.sqrt(np.array(last.covariance).reshape(6, 6)[0, 0]) < 0.3
    assert max(count.data for count in counts) == 1
    assert markers
    assert NO_POINTS in "".join(capfd.readouterr())
