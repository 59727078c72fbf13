"""Two simulated radars, every node a process of its own: a radar that is killed and starts again does not cost the hand track."""

import os
import signal

import pytest
from diagnostic_msgs.msg import DiagnosticArray
from handwave.msg import HandTrack as HandTrackMsg
from handwave.msg import PointCloud as PointCloudMsg
from handwave.msg import TrackArray as TrackArrayMsg
from std_msgs.msg import Bool

from radar_app.graph import graph
from radar_app.supervisor import Supervisor
from radar_ros import qos
from radar_ros.messages.convert import from_time
from radar_tracking import TrackStatus

# Somebody who draws for as long as the test may take. 20 frames a second and the body of ellipsoids: seven processes on two cores.
SCENE = """
duration: 300.0
seed: 14
radars:
  - {frame_id: left/radar, mount: {y: 0.8, z: 1.2, yaw: -0.3}, waveform: {frame_interval: 0.05}}
  - {frame_id: right/radar, mount: {y: -0.8, z: 1.2, yaw: 0.3}, waveform: {frame_interval: 0.05}}
effects: {noise: {noise_figure: 15}, losses: {level: 20}}
people:
  - id: 1
    height: 1.76
    position: [2.3, 0.0]
    heading: 3.142
    script: [{draw: {shape: circle, duration: 298.0, size: 0.28, speed: 0.7}}]
"""


@pytest.fixture
def seen(ros, tmp_path):
    """The graph of two radars in processes, and all that it says; ``wait`` also starts nodes again that died."""
    (tmp_path / "drawing.yaml").write_text(SCENE)
    settings = {
        "driver": {"scene": str(tmp_path / "drawing.yaml")},
        "fusion": {"slop": 0.03},  # drivers start when they are ready: frames lie up to 25 ms apart
        "hand": {"lost_after": 3.0},  # a busy machine holds clouds back
    }
    specs = graph("two_radars", parameters=settings, without=("gestures", "visualisation"))

    class Seen:
        lines: list[str] = []
        clouds = ros.collect(PointCloudMsg, "radar/points", qos.sensor(reliable=True))
        tracks = ros.collect(TrackArrayMsg, "tracks", qos.RESULT)
        hands = ros.collect(HandTrackMsg, "hand", qos.RESULT)
        diagnostics = ros.collect(DiagnosticArray, "diagnostics", 50)
        trigger = ros.node.create_publisher(Bool, "hand/trigger", qos.COMMAND)
        supervisor = Supervisor(specs, respawn=True, log=lambda name, line: Seen.lines.append(f"{name}: {line}"))

        def wait(self, wanted, timeout=60.0):
            assert ros.spin_until(lambda: self.supervisor.poll() is not None and wanted(), timeout), self.lines[-20:]

        def hands_of(self, radars, since_ns=0):
            """Hand tracks of clouds of so many radars."""
            stamps = {from_time(m.header.stamp) for m in self.clouds if len(m.sources) == radars}
            return [m for m in self.hands if from_time(m.header.stamp) in stamps and from_time(m.header.stamp) >= since_ns]

    with Seen.supervisor:
        yield Seen()


@pytest.mark.long
def test_a_radar_is_killed_and_starts_again(ros, seen):
    """The hand is followed by both, by the one that is left, and by both again; no message in between says that it ended."""
    together = lambda: seen.tracks and any(t.status == TrackStatus.CONFIRMED for t in seen.tracks[-1].tracks)  # noqa: E731
    seen.wait(lambda: together() and len(seen.clouds[-1].sources) == 2 and seen.trigger.get_subscription_count())
    for _ in range(60):  # the hand node may know of nobody yet: then a true does nothing, and a second one changes nothing
        seen.trigger.publish(Bool(data=True))
        if ros.spin_until(lambda: seen.hands, 1.0):
            break
    seen.wait(lambda: len(seen.hands_of(2)) >= 20)
    killed = from_time(seen.clouds[-1].header.stamp)
    os.kill(seen.supervisor.pid("right/driver"), signal.SIGKILL)
    seen.wait(lambda: len(seen.hands_of(1)) >= 10)
    alone = from_time(seen.hands_of(1)[-1].header.stamp)
    seen.wait(lambda: len(seen.hands_of(2, alone)) >= 20)
    assert seen.supervisor.crashes == [("right/driver", -signal.SIGKILL)], seen.lines[-20:]
    assert all(m.active for m in seen.hands)
    assert len({m.parent_id for m in seen.hands}) == 1
    lonely = [m for m in seen.clouds if len(m.sources) == 1 and from_time(m.header.stamp) > killed]
    assert {m.sources[0].header.frame_id for m in lonely} == {"left/radar"}
    assert any("right is silent" in s.message for array in seen.diagnostics for s in array.status if s.name == "fusion: processing")
    hand = [{v.key: v.value for v in s.values} for array in seen.diagnostics for s in array.status if s.name == "hand: processing"]
    shares = [float(values["velocity_none_percent"]) for values in hand if values["velocity_none_percent"] != "unknown"]
    assert shares
    assert all(0.0 <= share <= 100.0 for share in shares)
    # two radars beside each other at the hand's height tell its velocity on the floor plane; one alone, along its line of sight
    assert max(m.velocity_rank for m in seen.hands_of(2)) >= 2
    assert max(m.velocity_rank for m in seen.hands_of(1)) >= 1
