"""What an RGB-D camera gives: a colour image and a depth image of the same pixels."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from radar_core import DataError
from radar_core.checks import require_shape


@dataclass(frozen=True, eq=False)
class RgbdFrame:
    """A colour image and the depth image that is aligned to it: the same pixel shows the same direction.

    Attributes
    ----------
    stamp_ns : int
        As the camera's driver gives it [ns]; the light may be older by the camera's latency.
    sequence : int
        Counts the frames.
    colour : ndarray of uint8, shape (height, width, 3)
        Red, green, blue.
    depth : ndarray of uint16 or float32, shape (height, width)
        Along the optical axis: whole millimetres (ROS: 16UC1), or metres (32FC1). 0, NaN and infinity: not measured.
    """

    stamp_ns: int
    sequence: int
    colour: NDArray[np.uint8]
    depth: NDArray[Any]

    def __post_init__(self) -> None:
        if self.colour.dtype != np.uint8:
            raise DataError(f"RgbdFrame.colour is {self.colour.dtype}, expected uint8 (red, green, blue)")
        require_shape("RgbdFrame.colour", self.colour, (None, None, 3))
        if self.depth.dtype not in (np.uint16, np.float32):
            raise DataError(f"RgbdFrame.depth is {self.depth.dtype}, expected uint16 [mm] or float32 [m]")
        if self.depth.shape != self.colour.shape[:2]:
            raise DataError(
                f"RgbdFrame.depth has shape {self.depth.shape} but colour {self.colour.shape[:2]}; switch on the alignment of depth to "
                "colour in the camera's driver (RealSense: align_depth.enable)"
            )
