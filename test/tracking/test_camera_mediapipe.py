"""MediaPipe finds a rendered person; without it, or without a model, the user learns what to do. Nothing is downloaded."""

import builtins
import os
import sys

import numpy as np
import pytest
from camera_scenes import drawing

from radar_core import ConfigError
from radar_lab.camera import mediapipe_pose
from radar_lab.camera.mediapipe_pose import MediapipeConfig, MediapipePose
from radar_lab.camera.pinhole import CameraModel, CameraMount
from radar_lab.camera.synthetic import SyntheticCamera, SyntheticCameraConfig
from radar_lab.camera.truth import CameraTruth, CameraTruthConfig, PoseConfig, make_estimator

MOUNT = CameraMount(z=1.1)


@pytest.fixture
def open_pose():
    """Makes an estimator with the model that there is: the package's own, or a .task file that HANDWAVE_POSE_MODEL names."""
    pytest.importorskip("mediapipe", reason="MediaPipe is not installed: pip install 'handwave[camera]', in an environment of its own")
    made = []

    def make(**more):
        try:
            made.append(MediapipePose(MediapipeConfig(model_file=os.environ.get("HANDWAVE_POSE_MODEL", ""), **more)))
        except ConfigError as error:
            pytest.skip(f"MediaPipe has no model here: {error}")
        return made[-1]

    yield make
    for pose in made:
        pose.close()


def person():
    return SyntheticCamera(drawing(at=(2.5, 0.0)), SyntheticCameraConfig(mount=MOUNT, markers=(), hues=()))


@pytest.mark.parametrize("video", [False, True])
def test_finds_a_rendered_person(open_pose, video):
    """Six pictures of a mesh with skin and clothes: a person in each, joints within 40 px (16 cm), in the median within 12 px.

    Measured with 0.10.21: median 7 px, at most 24 px. What MediaPipe calls a shoulder or a hand is not quite what the skeleton does.
    """
    made, pose, error = person(), open_pose(video=video), []
    for k in range(6):
        found = pose.process(made.process(0.5 + 0.4 * k, k).colour)
        true = made.joints(0.5 + 0.4 * k)
        assert found.confidence.min() > 0.5
        error.append(
            [np.hypot(*(p - CameraModel().project(MOUNT.from_room(true[name])))) for name, p in zip(found.names, found.pixel, strict=True)]
        )
    assert np.median(error) < 12.0
    assert np.max(error) < 40.0


def test_nobody_is_nobody(open_pose):
    """An empty room: no joint, no confidence, no exception."""
    found = open_pose(video=False).process(np.full((480, 640, 3), 180, np.uint8))
    assert np.isnan(found.pixel).all()
    assert not found.confidence.any()


def test_joints_in_the_room(open_pose):
    """The whole chain with MediaPipe: arms and shoulders in the room, in the median within 6 cm."""
    made = person()
    truth = CameraTruth(CameraModel(), CameraTruthConfig(mount=MOUNT), open_pose(video=False))
    away = []
    for k in range(5):
        found = truth.process(made.process(0.5 + 0.4 * k, k))
        true = np.stack([made.joints(0.5 + 0.4 * k)[name] for name in found.names])
        away.append(np.sqrt(((found.position - true) ** 2).sum(-1)))
    assert np.nanmedian(away) < 0.06
    assert np.isfinite(away).mean() > 0.8


def test_without_mediapipe_the_user_is_told(monkeypatch):
    """The message names the extra, the version with a model and the other way."""
    real = builtins.__import__

    def without(name, *args, **more):
        if name.split(".")[0] == "mediapipe":
            raise ImportError("No module named 'mediapipe'")
        return real(name, *args, **more)

    monkeypatch.delitem(sys.modules, "mediapipe", raising=False)
    monkeypatch.setattr(builtins, "__import__", without)
    with pytest.raises(ConfigError, match=r"handwave\[camera\].*0\.10\.21.*estimator = markers"):
        make_estimator(PoseConfig(estimator="mediapipe"))


def test_without_a_model_nothing_is_downloaded(monkeypatch, tmp_path):
    """A version without a model: the message asks for a file; a file that is not there, or is no model, is named."""
    pytest.importorskip("mediapipe", reason="MediaPipe is not installed")
    with pytest.raises(ConfigError, match=r"nowhere\.task is not there"):
        MediapipePose(MediapipeConfig(model_file=str(tmp_path / "nowhere.task")))
    (tmp_path / "empty.task").write_bytes(b"nothing")
    with pytest.raises(ConfigError, match=r"empty\.task cannot be used by mediapipe"):
        MediapipePose(MediapipeConfig(model_file=str(tmp_path / "empty.task")))
    monkeypatch.setattr(mediapipe_pose, "_MODEL", mediapipe_pose.Path("modules", "no_such_model.tflite"))
    with pytest.raises(ConfigError, match="carries no model, and nothing is downloaded; name a pose_landmarker"):
        MediapipePose()


def test_joints_are_checked():
    """Names that MediaPipe does not know, and none at all."""
    with pytest.raises(ConfigError, match="names right_foot; choose from nose, left_shoulder"):
        MediapipeConfig(joints=("right_foot",))
    with pytest.raises(ConfigError, match="is empty"):
        MediapipeConfig(joints=())
