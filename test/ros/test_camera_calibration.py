"""`handwave calibrate-camera`: a camera that stands elsewhere than assumed, found from a hand or a body that radar and camera saw."""

import math

import numpy as np
import pytest
import yaml
from rclpy.serialization import serialize_message
from typer.testing import CliRunner

from radar_app.camera_commands import trajectories
from radar_app.cli import app
from radar_core import DataError
from radar_lab.alignment import NotObservableError, Trajectory
from radar_lab.camera.extrinsics import calibrate
from radar_lab.camera.pinhole import CameraMount
from radar_lab.camera.truth import JointTruth
from radar_ros.bags import TYPES, BagWriter
from radar_ros.messages.camera import joints_to_msg
from radar_ros.messages.tracks import hand_to_msg, tracks_to_msg
from radar_tracking import HandTrack, Track, Tracks, TrackStatus

TRUE = CameraMount(x=0.12, y=-0.35, z=1.42, yaw=0.09, tilt=-0.11, roll=0.02)
ASSUMED = CameraMount(x=0.0, y=-0.3, z=1.3, yaw=0.0, tilt=-0.11, roll=0.02)
LATE = 0.06
RADAR_STD, CAMERA_STD = 0.03, 0.008


def hand(t):
    """A hand that is carried about a room: two metres each way, half a metre up and down."""
    return np.stack([2.5 + 0.9 * np.sin(0.9 * t), 1.0 * np.sin(0.7 * t + 1), 1.2 + 0.35 * np.sin(2.3 * t)], -1)


def seen(seconds=40.0, seed=0, still=False):
    """What radar and camera say of it: stamps [ns] and places, radar errors alike for 0.1 s; the camera's in the room that it assumes."""
    rng = np.random.default_rng(seed)
    radar_time, camera_time = np.arange(0.0, seconds, 0.02), np.arange(0.0, seconds, 1 / 30)
    keep, errors = math.exp(-0.02 / 0.1), [rng.normal(0.0, RADAR_STD, 3)]
    for _ in radar_time[1:]:
        errors.append(keep * errors[-1] + math.sqrt(1 - keep**2) * rng.normal(0.0, RADAR_STD, 3))
    place = (lambda t: np.tile((2.5, 0.0, 1.2), (len(t), 1))) if still else hand
    optical = TRUE.from_room(place(camera_time) + rng.normal(0.0, CAMERA_STD, (len(camera_time), 3)))
    stamps = [np.round(t * 1e9).astype(np.int64) + 10**9 for t in (radar_time, camera_time + LATE)]
    return (stamps[0], place(radar_time) + errors), (stamps[1], ASSUMED.to_room(optical))


def as_trajectories(radar, camera, d=3):
    made = []
    for (stamp, place), std in ((radar, RADAR_STD), (camera, CAMERA_STD)):
        made.append(Trajectory(stamp, place[:, :d], np.tile(np.eye(d) * std**2, (len(stamp), 1, 1))))
    return made


@pytest.mark.long
def test_the_camera_is_found_within_what_is_said():
    """Place, yaw and latency of 12 sessions: mean square error over variance in 0.3 to 2.5 (measured: 0.94).

    The 99.9 % band of their 60 parameters is 0.5 to 1.7; it is widened because the covariance is measured from stretches of each session.
    """
    square = []
    for seed in range(12):
        found = calibrate(*as_trajectories(*seen(seed=seed)), ASSUMED)
        std = found.alignment.std
        errors = [found.mount.x - TRUE.x, found.mount.y - TRUE.y, found.mount.z - TRUE.z, found.mount.yaw - TRUE.yaw, found.latency - LATE]
        square.append([(e / std[name]) ** 2 for e, name in zip(errors, ("x", "y", "z", "yaw", "offset"), strict=True)])
        assert np.abs(errors[:3]).max() < 0.06
        assert abs(errors[3]) < 0.02
        assert abs(errors[4]) < 0.02
        assert found.mount.tilt == pytest.approx(TRUE.tilt, abs=1e-9)
        assert found.mount.roll == pytest.approx(TRUE.roll, abs=1e-9)
    assert 0.3 < np.mean(square) < 2.5


def test_a_body_leaves_height_and_tilt():
    """On the floor plane: x, y, yaw and latency; z, tilt and roll are those assumed."""
    found = calibrate(*as_trajectories(*seen(), d=2), ASSUMED)
    assert (found.mount.z, found.mount.tilt) == (ASSUMED.z, pytest.approx(ASSUMED.tilt))
    assert found.mount.yaw == pytest.approx(TRUE.yaw, abs=0.02)
    assert np.hypot(found.mount.x - TRUE.x, found.mount.y - TRUE.y) < 0.06


def test_a_hand_that_stands_still_tells_nothing():
    """Refused: what is open is named."""
    with pytest.raises((NotObservableError, DataError)):
        calibrate(*as_trajectories(*seen(still=True, seconds=10.0)), ASSUMED)


def record(path, radar, camera):
    """Write a recording with a hand, a person and the camera's joints."""
    rows = [(stamp, "hand", place) for stamp, place in zip(*radar, strict=True)]
    rows += [(stamp, "camera/joints", place) for stamp, place in zip(*camera, strict=True)]
    eye = np.eye(3)[None]
    with BagWriter(path) as writer:
        for k, (stamp, topic, place) in enumerate(sorted(rows, key=lambda row: row[0])):
            stamp = int(stamp)
            if topic == "hand":
                ahead, behind = (hand(np.array([stamp * 1e-9 - 1 + s]))[0] for s in (0.01, -0.01))
                speed = (ahead - behind) / 0.02
                msg = hand_to_msg(HandTrack(stamp, k, "room", 1, True, 5, 0.0, place, speed, np.eye(6) * RADAR_STD**2, 0.5))
                body = Track(3, TrackStatus.CONFIRMED, 1.0, 0.0, 5, place, speed, np.full(3, 0.1), np.eye(6) * RADAR_STD**2)
                tracks = tracks_to_msg(Tracks(stamp, k, "room", (body,), np.empty(0, np.int32)))
                writer.write("/tracks", TYPES["tracks"], stamp, serialize_message(tracks))
            else:
                there = np.repeat(place[None], 2, 0)
                covariance = np.repeat(eye * CAMERA_STD**2, 2, 0)
                names, more = ("right_hand", "left_shoulder"), (np.zeros((2, 5)), np.zeros((2, 2)), np.ones(2), ("", ""))
                truth = JointTruth(stamp, k, "room", names, there, np.full((2, 3), np.nan), covariance, covariance * 0, *more)
                msg = joints_to_msg(truth)
            writer.write(f"/{topic}", TYPES[topic], stamp, serialize_message(msg))


@pytest.mark.long
def test_the_command_writes_the_nodes_settings(tmp_path):
    """From a rosbag2 MCAP and the settings that the node had to better ones, which keep the rest."""
    record(tmp_path / "walk", *seen())
    before = {"mount": {name: getattr(ASSUMED, name) for name in ("x", "y", "z", "yaw", "tilt", "roll")}, "below_skin": [0.05]}
    (tmp_path / "before.yaml").write_text(yaml.safe_dump(before))
    for what in ("hand", "body"):
        out = tmp_path / f"{what}.yaml"
        arguments = ["calibrate-camera", str(tmp_path / "walk"), "-o", str(out), "-c", str(tmp_path / "before.yaml"), "--with", what]
        done = CliRunner().invoke(app, arguments, catch_exceptions=False)
        assert done.exit_code == 0
        assert "m rms apart after alignment" in done.output
        after = yaml.safe_load(out.read_text())
        assert after["below_skin"] == [0.05]
        assert after["mount"]["yaw"] == pytest.approx(TRUE.yaw, abs=0.02)
        assert after["latency"] == pytest.approx(LATE, abs=0.02)
        assert 0.0 < after["position_std"] < 0.05


def test_recordings_that_cannot_do_are_refused(tmp_path):
    """A joint that the camera does not look for; a topic that is missing."""
    radar, camera = seen(seconds=2.0)
    record(tmp_path / "short", radar, camera)
    with pytest.raises(DataError, match="never saw nose; its joints are right_hand, left_shoulder"):
        trajectories(tmp_path / "short", "hand", "nose")
    with BagWriter(tmp_path / "empty") as writer:
        msg = hand_to_msg(HandTrack(0, 0, "room", 1, True, 5, 0.0, np.zeros(3), np.zeros(3), np.eye(6), 0.5))
        writer.write("/hand", TYPES["hand"], 0, serialize_message(msg))
    with pytest.raises(DataError, match=r"needs camera/joints \+ hand, but holds hand"):
        trajectories(tmp_path / "empty", "hand", "right_hand")
