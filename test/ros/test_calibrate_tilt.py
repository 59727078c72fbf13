"""The command `calibrate-tilt`: from a recording, from a running graph over real DDS, and what a driver makes of its file."""

import json
from dataclasses import replace

import numpy as np
import pytest
from calibrating import listened
from handwave.msg import PointCloud as PointCloudMsg
from handwave.msg import RadarInfo as RadarInfoMsg
from rclpy.parameter import Parameter
from rclpy.serialization import serialize_message
from typer.testing import CliRunner

import radar_ros.nodes.driver
from radar_app.cli import app
from radar_core import Pose
from radar_core.errors import HandwaveError
from radar_core.mounting import load_mount
from radar_dsp import Baseband, BasebandConfig
from radar_ros import qos
from radar_ros.bags import TYPES, BagWriter
from radar_ros.messages.convert import cloud_to_msg, frame_to_msg, info_from_msg, info_to_msg
from radar_sim import Scene, Simulator
from radar_sim.effects.config import Effects, NoiseConfig
from radar_sim.people import Action, Person, Walk
from radar_sim.scene import Fidelity, SceneRadar

MOUNT = Pose(z=1.4, tilt=-0.35)
PLACES = ((3.5, 0.8), (2.0, -0.5), (4.2, -0.9), (4.0, 0.9))


@pytest.fixture(scope="module")
def walk():
    """What a radar that is tilted down, and says it is not, sees of a person who walks about: info, clouds, frames."""
    radar = SceneRadar(mount=MOUNT)
    scene = Scene(
        duration=8.0,
        seed=4,
        radars=(replace(radar, waveform=replace(radar.waveform, frame_interval=0.1)),),
        people=(Person(position=(2.0, 0.0), script=tuple(Action(walk=Walk(to=place, speed=1.0)) for place in PLACES)),),
        effects=Effects(noise=NoiseConfig(noise_figure=15.0)),
        fidelity=Fidelity(model="separable"),
    )
    simulator = Simulator(scene)
    baseband = Baseband(BasebandConfig(), simulator.info)
    frames = [replace(simulator.process(k).frame, stamp_ns=10**9 + k * 100_000_000) for k in range(simulator.n_frames)]
    return replace(simulator.info, mount=Pose(z=MOUNT.z)), [baseband.process(frame) for frame in frames], frames


def write(path, info, messages, name=""):
    """Record the info, then (stamp, kind, message)."""
    with BagWriter(path) as writer:
        writer.write(f"{name}/radar/info", TYPES["radar/info"], 0, serialize_message(info_to_msg(info, 0)))
        for stamp, kind, msg in messages:
            writer.write(f"{name}/{kind}", TYPES[kind], stamp, serialize_message(msg))


def check(found):
    """Two deviations, of which most is how bodies differ."""
    assert abs(found.mount.tilt - MOUNT.tilt) < 2 * found.tilt_std < 0.15
    assert replace(found.mount, tilt=0.0) == Pose(z=MOUNT.z)


def test_a_recording_of_clouds_or_frames_gives_a_mount_file(walk, tmp_path):
    """The command on real bags, as text and as JSON; of a radar in a namespace, and with another height."""
    info, clouds, frames = walk
    write(tmp_path / "points", info, [(c.stamp_ns, "radar/points", cloud_to_msg(c)) for c in clouds])
    write(tmp_path / "raw", info, [(f.stamp_ns, "radar/frame", frame_to_msg(f)) for f in frames], "/left")
    done = CliRunner().invoke(app, ["calibrate-tilt", str(tmp_path / "points"), "-o", str(tmp_path / "a.yaml")])
    assert done.exit_code == 0, done.output
    found = load_mount(tmp_path / "a.yaml")
    check(found)
    assert (found.radar, found.reference, found.pose_covariance[4, 4]) == (info.frame_id, "", found.tilt_std**2)
    assert "calibrate-tilt" in (tmp_path / "a.yaml").read_text()
    assert "note: somebody moved for 8 s only" in done.output
    command = ["calibrate-tilt", str(tmp_path / "raw"), "-o", str(tmp_path / "b.yaml"), "--radar", "left", "--json"]
    done = CliRunner().invoke(app, command)
    told = json.loads(done.output)
    assert told["mount"]["tilt"] == pytest.approx(found.mount.tilt, abs=1e-3)
    assert told["seconds"] == 8
    lower = json.loads(CliRunner().invoke(app, [*command, "--height", "1.0"]).output)["mount"]
    assert lower["z"] == 1.0
    assert lower["tilt"] > told["mount"]["tilt"] + 0.05  # the same points are higher above the radar


def test_a_running_graph_gives_the_same(ros, walk, tmp_path):
    """The command as a process listens to real DDS until Ctrl-C."""
    info, clouds, _ = walk
    out = tmp_path / "mount.yaml"
    told = ros.node.create_publisher(RadarInfoMsg, "radar/info", qos.LATCHED)
    points = ros.node.create_publisher(PointCloudMsg, "radar/points", qos.stream_out())
    told.publish(info_to_msg(info, 0))
    listened(
        ros,
        ["calibrate-tilt", "-o", str(out), "--duration", "100"],
        (told, points),
        (points.publish(cloud_to_msg(cloud)) for cloud in clouds),
    )
    check(load_mount(out))


def test_a_driver_takes_the_tilt(ros, walk, tmp_path):
    """What the command wrote is what the driver says."""
    info, clouds, _ = walk
    write(tmp_path / "points", info, [(c.stamp_ns, "radar/points", cloud_to_msg(c)) for c in clouds])
    assert CliRunner().invoke(app, ["calibrate-tilt", str(tmp_path / "points"), "-o", str(tmp_path / "a.yaml")]).exit_code == 0
    got = ros.collect(RadarInfoMsg, "radar/info", qos.LATCHED)
    settings = [Parameter("calibration", value=str(tmp_path / "a.yaml")), Parameter("duration", value=0.1)]
    ros.add(radar_ros.nodes.driver.make_node(parameter_overrides=settings))
    assert ros.spin_until(lambda: bool(got))
    check(replace(load_mount(tmp_path / "a.yaml"), mount=info_from_msg(got[0]).mount))


def test_what_cannot_be_used_is_refused(walk, tmp_path):
    """Nobody who moves, infinite elevations, a radar that is not there, another activity; no file is written."""
    info, clouds, _ = walk
    still = [replace(c, radial_speed=0 * c.radial_speed) for c in clouds]
    write(tmp_path / "still", info, [(c.stamp_ns, "radar/points", cloud_to_msg(c)) for c in still])
    loud = [replace(c, elevation=np.full_like(c.elevation, np.inf)) for c in clouds]
    write(tmp_path / "infinite", info, [(c.stamp_ns, "radar/points", cloud_to_msg(c)) for c in loud])
    wrong = (
        ("still", [], "somebody moves in 0 s only"),
        ("infinite", [], "infinite values of elevation"),
        ("still", ["--radar", "left"], 'has no left/radar/points with left/radar/info; radars in it: ""'),
        ("still", ["--activity", "sit"], "activity"),
    )
    for bag, more, text in wrong:
        done = CliRunner().invoke(app, ["calibrate-tilt", str(tmp_path / bag), "-o", str(tmp_path / "x.yaml"), *more])
        assert isinstance(done.exception, HandwaveError)
        assert text in str(done.exception)
    assert not (tmp_path / "x.yaml").exists()
