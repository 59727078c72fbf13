"""The command `calibrate-pair`: from a recording, from a running graph over real DDS, and what drivers make of its file."""

import functools
import json
import math
from dataclasses import replace

import numpy as np
import pytest
import yaml
from calibrating import listened
from geometry_msgs.msg import PoseWithCovarianceStamped
from handwave.msg import PointCloud as PointCloudMsg
from handwave.msg import RadarInfo as RadarInfoMsg
from rclpy.parameter import Parameter
from rclpy.serialization import serialize_message
from tf2_msgs.msg import TFMessage
from typer.testing import CliRunner

import radar_ros.nodes.driver
from radar_app.cli import app
from radar_core import ConfigError, DataError, Pose
from radar_core.mounting import MountCalibration, load_mount
from radar_dsp import Baseband, BasebandConfig
from radar_lab.alignment.pair import PairConfig, Walker, calibrate_pair
from radar_ros import qos
from radar_ros.bags import TYPES, BagWriter
from radar_ros.messages.convert import cloud_to_msg, frame_to_msg, info_from_msg, info_to_msg
from radar_ros.walks import from_bag
from radar_sim import Scene, Simulator
from radar_sim.effects.config import Effects, NoiseConfig
from radar_sim.people import Action, Person, Walk
from radar_sim.scene import Fidelity, SceneRadar

SECONDS = 16.0
MOUNTS = {"left": Pose(x=0.1, y=0.3, yaw=-0.1), "right": Pose(x=0.05, y=-0.3, yaw=0.15)}
LAG_NS = 10_000_000  # of the right radar's clock
PLACES = ((3.5, 0.8), (2.0, -0.5), (4.2, -0.9), (4.0, 0.9), (1.8, 0.4), (3.0, -0.8))


@pytest.fixture(scope="module")
def walk():
    """What both radars, one of whose clocks is behind, see of a person who walks to and fro: infos, clouds, some frames."""
    script = tuple(Action(walk=Walk(to=place, speed=1.0)) for place in PLACES)
    radars = [SceneRadar(frame_id=f"{name}/radar", mount=mount) for name, mount in MOUNTS.items()]
    radars = [replace(radar, waveform=replace(radar.waveform, frame_interval=0.04)) for radar in radars]
    scene = Scene(
        duration=SECONDS,
        seed=4,
        radars=tuple(radars),
        people=(Person(position=(2.0, 0.0), script=script),),
        effects=Effects(noise=NoiseConfig(noise_figure=15.0)),
        fidelity=Fidelity(model="separable"),
    )
    infos, clouds, frames = {}, {}, {}
    for name in MOUNTS:
        simulator = Simulator(scene, name)
        baseband, late = Baseband(BasebandConfig(), simulator.info), LAG_NS if name == "right" else 0
        # what a driver would say before calibration: height and tilt, but not where
        infos[name] = replace(simulator.info, mount=Pose() if name == "right" else MOUNTS[name])
        made = [replace(simulator.process(k).frame, stamp_ns=10**9 + k * 40_000_000 - late) for k in range(simulator.n_frames)]
        clouds[name], frames[name] = [baseband.process(frame) for frame in made], made[:40]
    return infos, clouds, frames


def write(path, infos, messages):
    """Record infos, then (topic, stamp, message) of both radars in order of time."""
    with BagWriter(path) as writer:
        for name, info in infos.items():
            writer.write(f"/{name}/radar/info", TYPES["radar/info"], 0, serialize_message(info_to_msg(info, 0)))
        for stamp, name, kind, msg in sorted(messages, key=lambda m: m[:2]):
            writer.write(f"/{name}/{kind}", TYPES[kind], stamp, serialize_message(msg))


@pytest.fixture(scope="module")
def bag(walk, tmp_path_factory):
    """A real recording of clouds."""
    path = tmp_path_factory.mktemp("walks") / "walk"
    infos, clouds, _ = walk
    write(path, infos, [(c.stamp_ns, name, "radar/points", cloud_to_msg(c)) for name in MOUNTS for c in clouds[name]])
    return path


def check(mount: MountCalibration):
    """Four sigma of a walk of 16 s, which is twice as unsure as a minute's; and sure enough to be of use."""
    error = np.array([mount.mount.x, mount.mount.y, mount.mount.yaw]) - [MOUNTS["right"].x, MOUNTS["right"].y, MOUNTS["right"].yaw]
    std = np.sqrt(np.diagonal(mount.covariance))
    assert (np.abs(error) < 4 * std).all()
    assert math.hypot(*std[:2]) < 0.03
    assert std[2] < math.radians(0.5)
    assert abs(mount.clock_offset - LAG_NS * 1e-9) < 4 * mount.clock_offset_std < 0.04
    assert (mount.radar, mount.reference) == ("right/radar", "left/radar")


@pytest.mark.long
def test_a_recording_gives_mount_file_table_and_picture(bag, tmp_path):
    """The command on a real bag: file, table and picture; --json says the same."""
    out, picture = tmp_path / "right.yaml", tmp_path / "walk.png"
    done = CliRunner().invoke(app, ["calibrate-pair", str(bag), "-o", str(out), "--picture", str(picture)])
    assert done.exit_code == 0, done.output
    found = load_mount(out)
    check(found)
    assert set(yaml.safe_load(out.read_text())["mount"]) == {"x", "y", "z", "yaw", "tilt"}
    assert picture.read_bytes().startswith(b"\x89PNG")
    assert "clock offset" in done.output
    assert "note: both radars saw the person for 1" in done.output
    done = CliRunner().invoke(app, ["calibrate-pair", str(bag), "-o", str(out), "--json"])
    told = json.loads(done.output)
    assert told["mount"]["x"] == found.mount.x
    assert told["pairs"] > 300
    assert load_mount(out) == found


@pytest.mark.long
def test_radars_may_change_roles(bag):
    """The left radar beside the right one: with the right one's true mount, the left one's comes out as it is."""
    first, second = from_bag(bag, ["right", "left"], functools.partial(Walker, PairConfig()))
    first.info = replace(first.info, mount=MOUNTS["right"])
    result = calibrate_pair(first, second)
    error = np.array([result.mount.mount.x - MOUNTS["left"].x, result.mount.mount.y - MOUNTS["left"].y])
    assert (np.abs(error) < 4 * np.array(result.std[:2])).all()
    assert result.alignment.offset == pytest.approx(-LAG_NS * 1e-9, abs=4 * result.alignment.std["offset"])


def test_raw_frames_do_as_well_as_clouds(walk, tmp_path):
    """Where a bag has frames only, the baseband makes the same clouds of them: the same positions."""
    infos, clouds, frames = walk
    write(tmp_path / "raw", infos, [(f.stamp_ns, name, "radar/frame", frame_to_msg(f)) for name in MOUNTS for f in frames[name]])
    write(tmp_path / "points", infos, [(c.stamp_ns, n, "radar/points", cloud_to_msg(c)) for n in MOUNTS for c in clouds[n][:40]])
    shares, follow = [], functools.partial(Walker, PairConfig())
    raw, points = (from_bag(tmp_path / name, list(MOUNTS), follow, shares.append) for name in ("raw", "points"))
    for a, b in zip(raw, points, strict=True):
        assert np.array_equal(a.trajectory().position, b.trajectory().position)
        assert len(a.trajectory()) > 15  # found in the 17th cloud; from the 34th on two tracks share who starts to walk
    assert shares[79] == shares[-1] == 1.0


@pytest.mark.long
def test_a_running_graph_gives_the_same(ros, walk, bag, tmp_path):
    """The command as a process listens to real DDS until Ctrl-C; the clouds come faster than in life, their stamps count."""
    infos, clouds, _ = walk
    out = tmp_path / "right.yaml"
    readers = [ros.node.create_publisher(RadarInfoMsg, f"{name}/radar/info", qos.LATCHED) for name in MOUNTS]
    points = {name: ros.node.create_publisher(PointCloudMsg, f"{name}/radar/points", qos.stream_out()) for name in MOUNTS}
    for name, publisher in zip(MOUNTS, readers, strict=True):
        publisher.publish(info_to_msg(infos[name], 0))

    def play():
        for pair in zip(*(clouds[name] for name in MOUNTS), strict=True):
            for publisher, cloud in zip(points.values(), pair, strict=True):
                publisher.publish(cloud_to_msg(cloud))
            yield

    output = listened(ros, ["calibrate-pair", "-o", str(out), "--duration", "100", "--json"], (*readers, *points.values()), play())
    check(load_mount(out))
    first, second = from_bag(bag, list(MOUNTS), functools.partial(Walker, PairConfig()))
    # best effort: a reader that stalls may lose a few clouds
    assert json.loads(output)["pairs"] > 0.8 * calibrate_pair(first, second).alignment.pairs


def test_a_graph_that_is_not_there(ros, monkeypatch):
    """After a while it says which radar is silent, and what to do."""
    from radar_ros import walks as module

    monkeypatch.setattr(module, "_WAIT", 0.3)
    listener = module.Listener(["left", "right"], functools.partial(Walker, PairConfig()))
    try:
        with pytest.raises(DataError, match=r"left/radar/info and right/radar/info within .*handwave up"):
            listener.listen(1.0)
    finally:
        listener.close()


def test_what_cannot_be_used_is_refused(walk, bag, tmp_path):
    """Radars that are not there, the same one twice, an empty room, unknown knobs; no file is written."""
    infos, clouds, _ = walk
    with pytest.raises(DataError, match="radars in it: left, right"):
        from_bag(bag, ["left", "middle"], functools.partial(Walker, PairConfig()))
    nobody = [replace(c.select(np.zeros(len(c), bool))) for c in clouds["left"][:50]]
    write(
        tmp_path / "empty",
        infos,
        [(c.stamp_ns, n, "radar/points", cloud_to_msg(replace(c, frame_id=f"{n}/radar"))) for n in MOUNTS for c in nobody],
    )
    with pytest.raises(DataError, match="left/radar sees nobody in 50 clouds"):
        calibrate_pair(*from_bag(tmp_path / "empty", list(MOUNTS), functools.partial(Walker, PairConfig())))
    for more, match in ((["--radars", "left,left"], "name two radars"), (["--config", str(tmp_path / "no.yaml")], "cannot read it")):
        done = CliRunner().invoke(app, ["calibrate-pair", str(bag), "-o", str(tmp_path / "x.yaml"), *more])
        assert isinstance(done.exception, ConfigError)
        assert match in str(done.exception)
    assert not (tmp_path / "x.yaml").exists()


@pytest.fixture
def measured(tmp_path):
    """A calibration file for the right radar of the scene two_radars."""
    rows = ((1e-4, 2e-5, 0.0), (2e-5, 4e-4, 1e-6), (0.0, 1e-6, 9e-6))
    MountCalibration(
        radar="right/radar", reference="left/radar", mount=Pose(x=0.2, y=-0.7, z=1.3, yaw=0.4, tilt=-0.1), covariance=rows
    ).save(tmp_path / "right.yaml")
    return tmp_path / "right.yaml"


def test_a_driver_takes_the_mount_and_tells_how_sure_it_is(ros, measured):
    """radar/info, tf and radar/pose say the file's mount; the other radar's driver may get the file too, and stays where it is."""
    got = {
        name: ros.collect(kind, name, qos.LATCHED)
        for name, kind in (("right/radar/pose", PoseWithCovarianceStamped), ("left/radar/pose", PoseWithCovarianceStamped))
    }
    infos = {name: ros.collect(RadarInfoMsg, f"{name}/radar/info", qos.LATCHED) for name in MOUNTS}
    transforms = ros.collect(TFMessage, "/tf_static", qos.LATCHED)
    settings = [Parameter("scene", value="two_radars"), Parameter("calibration", value=str(measured)), Parameter("duration", value=0.1)]
    for name in MOUNTS:
        ros.add(radar_ros.nodes.driver.make_node(namespace=name, parameter_overrides=settings))
    assert ros.spin_until(
        lambda: got["right/radar/pose"] and all(infos.values()) and len({t.transforms[0].child_frame_id for t in transforms}) == 2
    )
    file = load_mount(measured)
    assert info_from_msg(infos["right"][0]).mount == file.mount
    assert info_from_msg(infos["left"][0]).mount == Pose(y=0.8, z=1.2, yaw=-0.3)
    assert not got["left/radar/pose"]
    pose = got["right/radar/pose"][0]
    assert pose.header.frame_id == "room"
    tf = next(t.transforms[0].transform for t in transforms if t.transforms[0].child_frame_id == "right/radar")
    assert (pose.pose.pose.position.x, pose.pose.pose.position.z) == (tf.translation.x, tf.translation.z) == (0.2, 1.3)
    assert pose.pose.pose.orientation == tf.rotation
    covariance = np.reshape(pose.pose.covariance, (6, 6))
    np.testing.assert_array_equal(covariance[np.ix_([0, 1, 5], [0, 1, 5])], file.covariance)
    assert np.count_nonzero(covariance) == np.count_nonzero(file.covariance)


@pytest.mark.parametrize(
    ("text", "match"),
    [
        ("radar: right/radar\nmount: {x: 0, roll: 1}\n", "unknown key 'mount.roll'"),
        ("radar: right/radar\nmount: {}\nversion: 2\n", "version is 2"),
        ("radar: right/radar\nmount: {}\ncovariance: [[1, 0, 0], [0, -1, 0], [0, 0, 1]]\n", "negative eigenvalues"),
        ("radar: right/radar\nmount: {}\ncovariance: [[1, 2, 0], [0, 1, 0], [0, 0, 1]]\n", "symmetric"),
        ("radar: ''\nmount: {}\n", "radar is empty"),
    ],
)
def test_a_broken_file_is_refused_by_the_driver(ros, tmp_path, text, match):
    """One message with file and key; the driver does not start."""
    path = tmp_path / "broken.yaml"
    path.write_text(text)
    settings = [Parameter("scene", value="two_radars"), Parameter("calibration", value=str(path))]
    with pytest.raises(ConfigError, match=match) as caught:
        radar_ros.nodes.driver.make_node(namespace="right", parameter_overrides=settings)
    assert "broken.yaml" in str(caught.value)
