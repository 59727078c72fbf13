"""What an RGB-D camera gives, and what pose estimators find in it: joints of a person in a colour image."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from radar_core import DataError
from radar_core.checks import require_shape
from radar_core.types import Float64Array


@dataclass(frozen=True, eq=False)
class RgbdFrame:
    """A colour image and the depth image that is aligned to it: the same pixel shows the same direction."""

    stamp_ns: int  # as the camera's driver gives it [ns]; the light may be older by the camera's latency
    sequence: int  # counts the frames
    colour: NDArray[np.uint8]  # red, green, blue, shape (height, width, 3)
    # Along the optical axis: whole millimetres (ROS: 16UC1), or metres (32FC1). 0, NaN and infinity: not measured, uint16 or float32, shape
    # (height, width)
    depth: NDArray[Any]

    def __post_init__(self) -> None:
        require_image(self.colour, "RgbdFrame.colour")
        if self.depth.dtype not in (np.uint16, np.float32):
            raise DataError(f"RgbdFrame.depth is {self.depth.dtype}, expected uint16 [mm] or float32 [m]")
        if self.depth.shape != self.colour.shape[:2]:
            raise DataError(
                f"RgbdFrame.depth has shape {self.depth.shape} but colour {self.colour.shape[:2]}; switch on the alignment of depth to "
                "colour in the camera's driver (RealSense: align_depth.enable)"
            )


@dataclass(frozen=True, eq=False)
class Keypoints:
    """Joints in an image."""

    names: tuple[str, ...]  # of n joints, e.g. ``right_hand``; sides are the person's own
    pixel: Float64Array  # the centre of the first pixel is (0, 0); NaN: not found; shape (n, 2) = (u, v)
    confidence: Float64Array  # 0 (not found) to 1, shape (n,)
    pixel_std: Float64Array  # standard deviation of u and of v, shape (n,) [px]
    # K + 1 where the image shows what joint k was found by, so that depth is read there only; None: the estimator does not know, shape
    # (height, width), or None
    label: NDArray[np.uint8] | None = None

    def __post_init__(self) -> None:
        n = len(self.names)
        require_shape("Keypoints.pixel", self.pixel, (n, 2))
        require_shape("Keypoints.confidence", self.confidence, (n,))
        require_shape("Keypoints.pixel_std", self.pixel_std, (n,))
        if not (np.isfinite(self.pixel_std).all() and (self.pixel_std >= 0).all()):
            raise DataError(f"Keypoints.pixel_std is {self.pixel_std}; a pose estimator must give 0 or more for every joint")


class PoseEstimator(Protocol):
    """Something that finds joints, by their ``names``, in colour images; users may give their own to `CameraTruth`."""

    names: tuple[str, ...]

    def process(self, image: NDArray[np.uint8]) -> Keypoints:
        """Find the joints of an image of red, green, blue, shape (height, width, 3). Raises `DataError` when the image is none."""
        ...

    def close(self) -> None:
        """Let go of models and threads."""
        ...


def require_image(image: NDArray[np.uint8], name: str = "image") -> None:
    """Raise `DataError` unless ``image`` is one of red, green, blue, uint8 of shape (height, width, 3)."""
    if image.dtype != np.uint8 or image.ndim != 3 or image.shape[2] != 3:
        raise DataError(f"{name} is {image.dtype} of shape {image.shape}, expected uint8 of (height, width, 3) = red, green, blue")
