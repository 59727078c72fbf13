"""The cloud2 node over real DDS: somebody else's clouds become ours, nonsense is dropped and counted, radar/info is told."""

import array

import numpy as np
import pytest
from handwave.msg import PointCloud as PointCloudMsg
from handwave.msg import RadarInfo as RadarInfoMsg
from handwave.msg import Track, TrackArray
from rclpy.parameter import Parameter
from rclpy.qos import QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import PointCloud2, PointField
from tf2_msgs.msg import TFMessage

import radar_ros.nodes.cloud2
import radar_ros.nodes.tracking
from radar_core import ConfigError, PointCloud, Pose, RadarInfo, Waveform
from radar_core.geometry import spherical_to_cartesian
from radar_dsp import Baseband, BasebandConfig
from radar_ros import qos
from radar_ros.messages.convert import cloud_from_msg, cloud_to_cloud2, from_time, info_from_msg
from radar_sim import Action, Effects, NoiseConfig, Person, Scene, SceneRadar, Simulator
from radar_sim.people import Walk

STAMP = 77 * 10**9 + 5


def points(n=5):
    """A radar's points with a range rate and an SNR."""
    rng = np.random.default_rng(n)
    distance, azimuth, elevation = rng.uniform(1, 5, n), rng.uniform(-1, 1, n), rng.uniform(-0.5, 0.5, n)
    columns = (
        *spherical_to_cartesian(distance, azimuth, elevation).T,
        distance,
        azimuth,
        elevation,
        rng.normal(size=n),
        rng.uniform(5, 30, n),
    )
    names = ("x", "y", "z", "range", "azimuth", "elevation", "radial_speed", "snr")
    return PointCloud(STAMP, 0, "their_radar", **{k: np.asarray(v, np.float32) for k, v in zip(names, columns, strict=True)})


def theirs(frame="their_radar", n=5):
    """As a message: our own PointCloud2 is one among many."""
    msg = cloud_to_cloud2(points(n))
    msg.header.frame_id = frame
    return msg


@pytest.fixture
def node(ros):
    """Start the node; collect what it says; give a publisher that offers best effort only, as many drivers do."""

    def start(namespace="", **parameters):
        given = {"topic": "/their/cloud", "doppler": "radial_speed", "intensity": "snr", **parameters}
        overrides = [Parameter(name, value=value) for name, value in given.items()]
        made = ros.add(radar_ros.nodes.cloud2.make_node(parameter_overrides=overrides, namespace=namespace))
        made.errors = []
        made.problem = made.caution = made.errors.append
        space = f"/{namespace}" if namespace else ""
        made.clouds = ros.collect(PointCloudMsg, f"{space}/radar/points", qos.sensor(reliable=True))
        made.infos = ros.collect(RadarInfoMsg, f"{space}/radar/info", qos.LATCHED)
        made.frames = ros.collect(TFMessage, "/tf_static", qos.LATCHED)
        quality, outs = QoSProfile(depth=10, reliability=ReliabilityPolicy.BEST_EFFORT), []

        def restart():
            if outs:
                ros.node.destroy_publisher(outs.pop())
                assert ros.spin_until(lambda: not made.count_publishers("/their/cloud"), 30.0)
            outs.append(ros.node.create_publisher(PointCloud2, "/their/cloud", quality))
            assert ros.spin_until(lambda: outs[0].get_subscription_count() and made._points.get_subscription_count())

        def send(msg):
            before = made.processed + made.dropped
            outs[0].publish(msg)
            assert ros.spin_until(lambda: made.processed + made.dropped > before)

        restart()
        made.send, made.restart = send, restart
        return made

    return start


def test_their_clouds_become_ours(ros, node):
    """Positions, angles, range rates and SNR bit for bit (single precision both); their stamp; our frame, mount and tf."""
    n = node(**{"mount.z": 2.0, "mount.yaw": 0.3, "frame_interval": 0.05})
    n.send(theirs())
    assert ros.spin_until(lambda: n.clouds and n.infos and n.frames)
    got, sent = cloud_from_msg(n.clouds[0]), points()
    assert (got.stamp_ns, got.sequence, got.frame_id) == (STAMP, 0, "radar")
    for name in ("x", "y", "z", "radial_speed", "snr"):
        np.testing.assert_array_equal(getattr(got, name), getattr(sent, name))
    for name in ("range", "azimuth", "elevation"):
        np.testing.assert_allclose(getattr(got, name), getattr(sent, name), atol=1e-6)
    info = info_from_msg(n.infos[0])
    assert (info.frame_id, info.mount.z, info.mount.yaw, info.waveform.n_sample, info.waveform.frame_interval) == (
        "radar",
        2.0,
        0.3,
        0,
        0.05,
    )
    assert n.frames[0].transforms[0].child_frame_id == "radar"
    assert n.frames[0].transforms[0].transform.translation.z == 2.0


def test_nonsense_is_dropped_and_the_next_cloud_is_taken(ros, node):
    """One line that names topic and field; nothing is sent for it."""
    n = node()
    broken = theirs()
    broken.data = broken.data[:-1]
    other = theirs()
    other.fields[4] = PointField(name="vr", offset=16, datatype=7, count=1)
    n.send(broken)
    n.send(other)
    n.send(theirs(n=3))
    assert n.dropped == 2
    assert "/their/cloud: data has" in n.errors[0]
    assert "/their/cloud: has no field 'radial_speed'; it has: x, y, z, range, vr" in n.errors[1]
    assert ros.spin_until(lambda: n.clouds)
    assert [len(m.x) for m in n.clouds] == [3]


def test_points_without_a_position_are_left_out(ros, node):
    """Organised clouds fill their holes with NaN: no error, but told in the diagnostics."""
    n = node()
    msg = theirs()
    table = np.frombuffer(bytes(msg.data), "<f4").reshape(5, -1).copy()
    table[1, 0] = np.nan
    msg.data = array.array("B", table.tobytes())
    n.send(msg)
    assert ros.spin_until(lambda: n.clouds)
    assert len(n.clouds[0].x) == 4
    assert n.extra_diagnostics()[0]["points_without_position"] == 1


def test_an_empty_frame_is_taken_from_their_messages(ros, node):
    """radar/info waits for the first cloud then; the namespace stands before it once; another frame is told, not obeyed."""
    n = node(namespace="left", frame_id="")
    ros.spin_until(lambda: False, 0.7)
    assert not n.infos
    n.send(theirs())
    n.send(theirs(frame="else"))
    assert ros.spin_until(lambda: n.infos and len(n.clouds) == 2)
    assert {m.header.frame_id for m in (*n.clouds, n.infos[0])} == {"left/their_radar"}
    assert "clouds come in the frames 'their_radar' and 'else'" in n.errors[0]


def test_stamps_by_arrival(ros, node):
    """Where a driver stamps with another clock (or not at all): the node's time when a cloud comes, less the latency."""
    n = node(stamp="arrival", latency=0.5)
    before = n.get_clock().now().nanoseconds
    n.send(theirs())
    after = n.get_clock().now().nanoseconds
    assert ros.spin_until(lambda: n.clouds)
    assert before <= from_time(n.clouds[0].header.stamp) + 500_000_000 <= after


def test_silence_is_told(ros, node):
    """With what to look for."""
    n = node()
    n._heard -= 10.0
    assert "its publisher is silent" in n.extra_diagnostics()[1][0]


def test_a_mistake_in_the_settings_is_one_line(ros):
    """Before anything is subscribed."""
    with pytest.raises(ConfigError, match="intensity_unit is 'dB'"):
        radar_ros.nodes.cloud2.make_node(parameter_overrides=[Parameter("intensity_unit", value="dB")])


@pytest.mark.long
def test_a_walker_is_tracked_over_nonsense_and_a_driver_that_starts_again(ros, node):
    """Their driver sends nonsense, ends and starts again: one person, where the simulated one is."""
    radar = RadarInfo(waveform=Waveform(frame_interval=0.05), mount=Pose(z=1.2))
    person = Person(id=1, position=(4.5, -0.6), script=(Action(walk=Walk(to=(1.8, 0.6))),))
    scene = Scene(duration=3.0, seed=5, radars=(SceneRadar.of(radar),), people=(person,), effects=Effects(noise=NoiseConfig()))
    simulator = Simulator(scene)
    baseband = Baseband(BasebandConfig(), simulator.info)
    n = node(**{"mount.z": 1.2, "frame_interval": 0.05})
    tracking = ros.add(radar_ros.nodes.tracking.make_node())
    tracks = ros.collect(TrackArray, "tracks", qos.RESULT)
    assert ros.connect("radar/points", "tracks")
    n.send(cloud_to_cloud2(Baseband(BasebandConfig(), simulator.info).process(simulator.process(0).frame)))
    assert ros.spin_until(lambda: tracking.frame_interval)  # radar/info is told with the first cloud: what comes before is dropped
    for k in range(simulator.n_frames):
        made = simulator.process(k)
        if k == 20:
            broken = theirs()
            broken.data = broken.data[:7]
            n.send(broken)
            n.restart()
        n.send(cloud_to_cloud2(baseband.process(made.frame)))
        assert ros.spin_until(lambda: len(tracks) > k, 30.0)  # noqa: B023  (it is called at once)
    assert n.dropped == 1
    (last,) = [track for track in tracks[-1].tracks if track.status == Track.CONFIRMED]
    assert np.hypot(*(np.array(last.position[:2]) - made.truth.position[0, :2])) < 0.4
