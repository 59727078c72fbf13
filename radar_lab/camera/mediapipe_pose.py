"""MediaPipe's pose landmarks as joints, for people without markers (Bazarevsky et al. 2020, BlazePose).

Nothing is downloaded. Versions up to 0.10.21 carry their model (``mediapipe.solutions``); later ones carry none and need a
``pose_landmarker*.task`` file that the user names (``mediapipe.tasks``).
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from radar_core import ConfigError, DataError
from radar_core.config import config, knob
from radar_core.types import Float64Array
from radar_lab.camera.pose import Keypoints, require_image

_LANDMARKS: dict[str, tuple[int, ...]] = {
    "nose": (0,),
    "left_shoulder": (11,), "right_shoulder": (12,), "left_elbow": (13,), "right_elbow": (14,),
    "left_wrist": (15,), "right_wrist": (16,),
    "left_hand": (15, 17, 19), "right_hand": (16, 18, 20),
    "left_hip": (23,), "right_hip": (24,),
}  # fmt: skip
"""Landmarks whose mean is a joint. A hand's middle lies between wrist and the knuckles of index and little finger."""
_MODEL = Path("modules", "pose_landmark", "pose_landmark_full.tflite")  # inside the package
_INSTALL = (
    "install it with: pip install 'handwave[camera]' (mediapipe 0.10.21 for Python 3.10 to 3.12 carries its model; it needs numpy < 2, so "
    "give it an environment of its own), or wear coloured markers: estimator = markers"
)


@config
class MediapipeConfig:
    """Where the model is, and how sure it must be."""

    joints: tuple[str, ...] = knob(
        ("left_shoulder", "right_shoulder", "left_elbow", "right_elbow", "left_wrist", "right_wrist", "left_hand", "right_hand"),
        doc=f"joints to give, of: {', '.join(_LANDMARKS)}",
    )
    model_file: str = knob("", doc="pose_landmarker*.task file; empty: the model inside the installed package (mediapipe up to 0.10.21)")
    min_confidence: float = knob(0.5, low=0.0, high=1.0, doc="a person is found, and followed, if the model is so sure")
    video: bool = knob(True, doc="images follow each other: a person is followed from one to the next, which is faster; off: each is new")
    pixel_std: float = knob(6.0, unit="px", low=0.0, high=100.0, doc="how far a joint is from where the model says, in u and v")

    def validate(self) -> None:
        """Raise `ConfigError` when a joint is not one of MediaPipe's."""
        unknown = [name for name in self.joints if name not in _LANDMARKS]
        if unknown or not self.joints:
            said = f"names {', '.join(unknown)}" if unknown else "is empty"
            raise ConfigError(f"MediapipeConfig.joints {said}; choose from {', '.join(_LANDMARKS)}", key=("joints",))


class MediapipePose:
    """Find the joints of one person, by their ``names``. Raises `ConfigError` when MediaPipe is not installed, or there is no model."""

    def __init__(self, config: MediapipeConfig | None = None) -> None:
        self.config = config or MediapipeConfig()
        self.names = self.config.joints
        self._rows = [list(_LANDMARKS[name]) for name in self.names]
        self._detect, self._close = _open(self.config)

    def process(self, image: NDArray[np.uint8]) -> Keypoints:
        """Find the joints of an image, shape (height, width, 3): see `radar_lab.camera.pose.PoseEstimator`.

        Raises `DataError` when the image is none, or MediaPipe fails on it.
        """
        require_image(image)
        n = len(self.names)
        pixel, confidence, std = np.full((n, 2), np.nan), np.zeros(n), np.full(n, self.config.pixel_std)
        try:
            landmarks = self._detect(np.ascontiguousarray(image))
        except (RuntimeError, ValueError) as error:
            raise DataError(f"MediaPipe cannot use the image of shape {image.shape}: {error}") from None
        if landmarks is None:
            return Keypoints(self.names, pixel, confidence, std)
        # Landmarks are shares of the image's width and height, counted from its edge; the middle of the first pixel is half a pixel in.
        place = landmarks[:, :2] * (image.shape[1], image.shape[0]) - 0.5
        for i, rows in enumerate(self._rows):
            pixel[i], confidence[i] = place[rows].mean(0), landmarks[rows, 2].min()
        return Keypoints(self.names, pixel, np.clip(confidence, 0.0, 1.0), std)

    def close(self) -> None:
        """Let go of the model and its threads."""
        self._close()


_Detect = Callable[[NDArray[np.uint8]], "Float64Array | None"]


def _open(config: MediapipeConfig) -> tuple[_Detect, Callable[[], None]]:
    """Open the model that there is: what gives landmarks (x share, y share, visibility), shape (33, 3), of an image, and what closes it."""
    try:
        import mediapipe
    except ImportError as error:
        raise ConfigError(f"MediaPipe is not there ({error}); {_INSTALL}") from None
    if config.model_file:
        return _open_task(mediapipe, config)
    if not (Path(mediapipe.__file__).parent / _MODEL).exists():
        raise ConfigError(
            f"mediapipe {mediapipe.__version__} carries no model, and nothing is downloaded; name a pose_landmarker*.task file "
            f"(parameter model_file), or use a version that carries one: {_INSTALL}"
        )
    return _open_solution(mediapipe, config)


def _open_solution(mediapipe: Any, config: MediapipeConfig) -> tuple[_Detect, Callable[[], None]]:
    # Complexity 1 is the one model in the package; 0 and 2 would be downloaded.
    pose = mediapipe.solutions.pose.Pose(
        static_image_mode=not config.video,
        model_complexity=1,
        min_detection_confidence=config.min_confidence,
        min_tracking_confidence=config.min_confidence,
    )

    def detect(image: NDArray[np.uint8]) -> Float64Array | None:
        found = pose.process(image).pose_landmarks
        return None if found is None else np.array([(p.x, p.y, p.visibility) for p in found.landmark])

    return detect, pose.close


def _open_task(mediapipe: Any, config: MediapipeConfig) -> tuple[_Detect, Callable[[], None]]:
    path = Path(config.model_file)
    if not path.is_file():
        raise ConfigError(f"mediapipe.model_file {path} is not there; name a pose_landmarker*.task file, or leave it empty")
    from mediapipe.tasks import python as tasks

    vision = tasks.vision
    options = vision.PoseLandmarkerOptions(
        base_options=tasks.BaseOptions(model_asset_path=str(path)),
        running_mode=vision.RunningMode.VIDEO if config.video else vision.RunningMode.IMAGE,
        min_pose_detection_confidence=config.min_confidence,
        min_tracking_confidence=config.min_confidence,
    )
    try:
        landmarker = vision.PoseLandmarker.create_from_options(options)
    except (RuntimeError, ValueError, OSError) as error:
        raise ConfigError(f"mediapipe.model_file {path} cannot be used by mediapipe {mediapipe.__version__}: {error}") from None
    count = 0

    def detect(image: NDArray[np.uint8]) -> Float64Array | None:
        nonlocal count
        count += 1
        wrapped = mediapipe.Image(image_format=mediapipe.ImageFormat.SRGB, data=image)
        # Times only have to ascend; the order of the images is all that following needs.
        result = landmarker.detect_for_video(wrapped, count * 33) if config.video else landmarker.detect(wrapped)
        found = result.pose_landmarks
        return None if not found else np.array([(p.x, p.y, p.visibility) for p in found[0]])

    return detect, landmarker.close
