"""Nodes over real DDS: lifecycle, what bad input gets, and that results come."""

import functools
import time
from types import SimpleNamespace

import numpy as np
import pytest
from handwave.msg import PointCloud as PointCloudMsg
from handwave.msg import RadarFrame as RadarFrameMsg
from handwave.msg import RadarInfo as RadarInfoMsg
from handwave.msg import StageStatus as StageStatusMsg
from handwave.msg import TrackArray as TrackArrayMsg
from handwave.srv import TrackHand
from lifecycle_msgs.msg import State
from rclpy.parameter import Parameter
from rosgraph_msgs.msg import Clock

import radar_ros.nodes.baseband
import radar_ros.nodes.driver
import radar_ros.nodes.hand
import radar_ros.nodes.tracking
from radar_core import ConfigError, RadarFrame, RadarInfo, Waveform
from radar_ros import qos
from radar_ros.messages.convert import frame_to_msg, info_to_msg, to_time
from radar_sim import Simulator, load_scene


def overrides(**values):
    return {"parameter_overrides": [Parameter(name, value=value) for name, value in values.items()]}


def driver(ros, **values):
    return ros.add(radar_ros.nodes.driver.make_node(**overrides(scene="single_target", at_end="loop", **values)))


@pytest.mark.long
def test_driver_survives_twenty_life_cycles(ros):
    """Configure, activate, deactivate, cleanup, twenty times; frames come in every life and none while suspended."""
    node = driver(ros, autostart=False)
    frames = ros.collect(RadarFrameMsg, "radar/frame", qos.sensor())
    for life in range(20):
        node.trigger_configure()
        node.trigger_activate()
        before = len(frames)
        assert ros.spin_until(lambda b=before: len(frames) > b + 2), f"no frames in life {life}"
        node.trigger_deactivate()
        ros.spin_until(lambda: False, 0.1)
        resting = len(frames)
        ros.spin_until(lambda: False, 0.1)
        assert len(frames) == resting
        node.trigger_cleanup()
        assert node._state_machine.current_state[0] == State.PRIMARY_STATE_UNCONFIGURED


def test_driver_says_why_it_cannot_configure(ros, tmp_path):
    """A scene with a mistake: the transition fails, the node lives, the message says where."""
    scene = tmp_path / "bad.yaml"
    scene.write_text("duration: 3\npeople:\n  - {idd: 4}\n")
    with pytest.raises(ConfigError, match=r"bad\.yaml:3: unknown key 'people\.0\.idd'"):
        radar_ros.nodes.driver.make_node(**overrides(scene=str(scene)))


def test_frames_clouds_and_tracks_flow(ros):
    """Driver, baseband and tracking in one process over DDS: tracks carry the cloud's stamp and sequence."""
    ros.add(radar_ros.nodes.baseband.make_node())
    ros.add(radar_ros.nodes.tracking.make_node())
    frames = ros.collect(RadarFrameMsg, "radar/frame", qos.sensor(depth=50))
    clouds = ros.collect(PointCloudMsg, "radar/points", qos.sensor(depth=50))
    tracks = ros.collect(TrackArrayMsg, "tracks", qos.RESULT)
    driver(ros)
    assert ros.spin_until(lambda: len(tracks) > 20)
    by_sequence = {c.sequence: c for c in clouds}
    frame_stamps = {f.sequence: f.header.stamp.sec * 10**9 + f.header.stamp.nanosec for f in frames}
    half = RadarInfo().waveform.acquisition_ns // 2
    for msg in tracks[-10:]:
        cloud = by_sequence[msg.sequence]
        assert cloud.header.stamp == msg.header.stamp
        assert len(msg.point_track_id) == len(cloud.x)
        stamp = msg.header.stamp.sec * 10**9 + msg.header.stamp.nanosec
        assert stamp == frame_stamps[msg.sequence] + half
    assert all(np.diff([f.sequence for f in frames]) >= 1)


@pytest.fixture
def baseband(ros):
    """A baseband node, its status messages, and publishers of frames and infos."""
    node = ros.add(radar_ros.nodes.baseband.make_node(**overrides(reliable=True)))
    errors = []
    node.problem = errors.append
    infos = ros.node.create_publisher(RadarInfoMsg, "radar/info", qos.LATCHED)
    frames = ros.node.create_publisher(RadarFrameMsg, "radar/frame", qos.sensor(reliable=True))
    done = ros.collect(StageStatusMsg, "stage_status", qos.sensor(reliable=True))
    assert ros.spin_until(lambda: frames.get_subscription_count() and infos.get_subscription_count())
    return node, errors, infos, frames, done


def frame(sequence, shape=(2, 64, 4, 64), fill=0.0):
    rng = np.random.default_rng(sequence)
    cube = (rng.normal(size=shape) + fill).astype(np.complex64)
    return frame_to_msg(RadarFrame(cube=cube, stamp_ns=10**9 + sequence, sequence=sequence, frame_id="radar"))


def test_a_frame_that_contradicts_its_info_is_refused_and_the_next_is_taken(ros, baseband):
    """One clear message; the stage goes on."""
    node, errors, infos, frames, done = baseband
    infos.publish(info_to_msg(RadarInfo(), 0))
    assert ros.spin_until(lambda: any(s.header.stamp.sec == 0 for s in done))
    frames.publish(frame(0, (2, 32, 4, 64)))
    assert ros.spin_until(lambda: errors)
    assert "has shape (2, 32, 4, 64)" in errors[0]
    frames.publish(frame(1, fill=np.nan))
    assert ros.spin_until(lambda: len(errors) > 1)
    assert "RadarFrame.cube has" in errors[1]
    frames.publish(frame(2))
    assert ros.spin_until(lambda: any(s.sequence == 2 for s in done))
    assert node.dropped == 2


@pytest.mark.long
def test_frames_before_the_info_are_dropped_and_said_once(ros, baseband):
    """The message says what is missing."""
    node, errors, _, frames, _ = baseband
    for sequence in range(45):  # 4.5 s: longer than a start-up may take
        frames.publish(frame(sequence))
        ros.spin_until(lambda: False, 0.1)
    assert "no radar/info" in errors[0]
    assert node.dropped == 45


def test_an_info_that_changes_is_refused_and_the_old_one_is_taken_again(ros, baseband):
    """Another radar on the same topics: frames are refused until the first radar is back."""
    _, errors, infos, frames, done = baseband
    infos.publish(info_to_msg(RadarInfo(), 0))
    assert ros.spin_until(lambda: done)
    infos.publish(info_to_msg(RadarInfo(waveform=Waveform(bandwidth=1e9)), 0))
    assert ros.spin_until(lambda: errors)
    assert "radar/info changed while running" in errors[0]
    frames.publish(frame(5))
    ros.spin_until(lambda: False, 0.3)
    assert not any(s.sequence == 5 for s in done)
    infos.publish(info_to_msg(RadarInfo(), 1))
    ros.spin_until(lambda: False, 0.3)
    frames.publish(frame(6))
    assert ros.spin_until(lambda: any(s.sequence == 6 for s in done))


def test_one_problem_is_one_line(ros):
    """A fault in every frame, each with its own number, fills neither the log nor the memory; the next line tells how many there were."""
    node = ros.add(radar_ros.nodes.baseband.make_node())
    lines = []
    node.get_logger = lambda: SimpleNamespace(error=lines.append)
    for sequence in range(1000):
        node.problem(f"frame {sequence} has 3 non-finite values")
        node.problem("another problem")
    assert lines == ["frame 0 has 3 non-finite values", "another problem"]
    assert len(node._problems) == 2
    now = time.monotonic()
    node._problems.told = functools.partial(node._problems.told, now=now + 60.0)
    node.problem("frame 1000 has 3 non-finite values")
    assert lines[-1] == "frame 1000 has 3 non-finite values (999 more like this since the last time)"


@pytest.mark.long
def test_the_driver_goes_on_when_the_clock_is_set_back(ros):
    """Simulated time jumps from 0 to its first value, and back when it starts again: frames come all the same, and none counts as lost."""
    frames = ros.collect(RadarFrameMsg, "radar/frame", qos.sensor(depth=50))
    node = driver(ros, use_sim_time=True)
    clock = ros.node.create_publisher(Clock, "/clock", 1)
    assert ros.spin_until(lambda: clock.get_subscription_count())

    def tick(start_ns):
        for step in range(40):
            clock.publish(Clock(clock=to_time(start_ns + step * 10_000_000)))
            ros.spin_until(lambda: False, 0.02)

    tick(1000 * 10**9)
    before = len(frames)
    assert before > 5
    tick(10 * 10**9)
    assert len(frames) > before + 5
    assert frames[-1].header.stamp.sec < 11
    assert node.dropped < 40  # neither jump is a loss


def test_lost_frames_are_counted(ros, baseband):
    """Gaps in the sequence show in the status."""
    node, _, infos, frames, done = baseband
    infos.publish(info_to_msg(RadarInfo(), 0))
    assert ros.spin_until(lambda: done)
    for sequence in (10, 11, 15):
        frames.publish(frame(sequence))
        assert ros.spin_until(lambda s=sequence: any(m.sequence == s for m in done))
    assert node.dropped == 3
    assert done[-1].dropped == 3


def test_hand_service_answers(ros):
    """An unknown track is refused with what there is; the nearest person can be asked for; stopping works."""
    ros.add(radar_ros.nodes.hand.make_node())
    client = ros.node.create_client(TrackHand, "hand/track")
    assert client.wait_for_service(10.0)

    def call(enable, track_id):
        future = client.call_async(TrackHand.Request(enable=enable, track_id=track_id))
        assert ros.spin_until(future.done)
        return future.result()

    refused = call(True, 99)
    assert not refused.success
    assert "no track 99; tracks now: none" in refused.message
    assert call(True, -1).success
    assert call(False, -1).success


def test_driver_paces_and_stamps_evenly(ros):
    """Stamps are whole frame intervals apart, whatever the timers do; the source's frames come in order."""
    frames = ros.collect(RadarFrameMsg, "radar/frame", qos.sensor(depth=50))
    driver(ros)
    started = time.monotonic()
    assert ros.spin_until(lambda: len(frames) >= 25)
    assert time.monotonic() - started > 25 * 0.02 * 0.9  # never faster than the radar
    stamps = np.array([f.header.stamp.sec * 10**9 + f.header.stamp.nanosec for f in frames])
    sequences = np.array([f.sequence for f in frames])
    np.testing.assert_array_equal(np.diff(stamps), np.diff(sequences) * 20_000_000)


def test_simulated_frames_are_the_library_s(ros):
    """What the driver publishes is what the simulator makes, bit for bit."""
    frames = ros.collect(RadarFrameMsg, "radar/frame", qos.sensor(depth=50))
    driver(ros)
    assert ros.spin_until(lambda: len(frames) >= 3)
    simulator = Simulator(load_scene("single_target"))
    for msg in frames[:3]:
        expected = simulator.process(msg.sequence).frame.cube
        assert bytes(msg.data) == expected.tobytes()
