"""Depth at a pixel: of the nearest surface in a small window, with its standard deviation."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from radar_core import ConfigError, DataError
from radar_core.config import config, knob
from radar_core.types import Float64Array

_MAD = 1.4826  # standard deviation over median absolute deviation, for a normal distribution
_MEDIAN = math.pi / 2  # variance of a median over that of a mean, for a normal distribution
_CHANCE = 4.7  # by noise alone a spread squared of n pixels exceeds its mean by more than this / sqrt(n) in 2 % of the cases
_WITHIN = 6.0  # standard deviations of the noise that a surface is at least thick
_MILLIMETRE = 1e-3


@config
class DepthConfig:
    """How depth is read, and how good the camera says it is."""

    radius: int = knob(3, unit="px", low=0, high=50, doc="the window reaches this far to each side of the pixel")
    nearest: float = knob(0.2, unit="m", low=0.0, high=100.0, doc="what is nearer is not believed")
    farthest: float = knob(8.0, unit="m", low=0.01, high=1000.0, doc="what is farther is not believed")
    share: float = knob(0.25, low=0.01, high=1.0, doc="share of the window's pixels that a surface must have")
    thickness: float = knob(0.06, unit="m", low=0.001, high=1.0, doc="pixels this much deeper than the nearest are the same surface")
    noise_floor: float = knob(0.001, unit="m", low=0.0, high=1.0, doc="standard deviation of depth, the part that does not grow with depth")
    noise_growth: float = knob(
        0.0025, unit="1/m", low=0.0, high=1.0, doc="the part that grows with the square of depth; stereo cameras have it"
    )
    correlation: float = knob(2.0, unit="px", low=0.0, high=100.0, doc="errors of pixels nearer to each other than this hang together")

    def validate(self) -> None:
        """Raise `ConfigError` when no depth would be believed."""
        if self.nearest >= self.farthest:
            raise ConfigError(f"DepthConfig.nearest = {self.nearest:g} m is not below farthest = {self.farthest:g} m; nothing lies between")

    def noise(self, depth: float) -> float:
        """Tell the standard deviation of one pixel [m] at a depth [m]: stereo measures disparity, so it grows with the square of depth."""
        return self.noise_floor + self.noise_growth * depth * depth


@dataclass(frozen=True, eq=False)
class Depths:
    """Depth at some pixels."""

    # depth, std: along the optical axis, and its standard deviation [m]; NaN: there is no surface; shape (n,)
    depth: Float64Array
    std: Float64Array
    reason: tuple[str, ...]  # why not, one entry per pixel; empty: there is one


class DepthReader:
    """Read depth images at pixels that need not be whole.

    In the window around a pixel the nearest surface counts, because a hand is in front of what is behind it: the nearest depth at which
    enough pixels (`share`) lie within `thickness` of each other. Its median is the depth. Few pixels in front of it are flying pixels of
    an edge, or noise. The variance is that of the median of noisy pixels, and the square of what the surface's spread exceeds the noise
    by: which point of a slanted surface the pixel means is not known better.
    """

    def __init__(self, config: DepthConfig | None = None) -> None:
        self.config = config or DepthConfig()

    def process(self, image: NDArray[Any], pixel: NDArray[np.floating], label: NDArray[np.uint8] | None = None) -> Depths:
        """Read a depth image at some pixels.

        Parameters
        ----------
        image : ndarray of uint16 [mm] or float32 [m], shape (height, width)
            0, NaN and infinity: not measured. `DataError` is raised for another type or shape.
        pixel : ndarray, shape (n, 2) = (u, v)
            Where; NaN: nowhere.
        label : ndarray of uint8, shape (height, width), or None
            Pixels that show the k-th pixel's own surface are k + 1; None: any surface may be its own.
        """
        if image.dtype not in (np.uint16, np.float32) or image.ndim != 2:
            raise DataError(f"depth image is {image.dtype} of shape {image.shape}, expected uint16 [mm] or float32 [m] of (height, width)")
        if label is not None and label.shape != image.shape:
            raise DataError(f"label has shape {label.shape} but the depth image {image.shape}; they must show the same pixels")
        places = np.asarray(pixel, np.float64).reshape(-1, 2).tolist()
        found = [self._read(image, u, v, label, i + 1) for i, (u, v) in enumerate(places)]
        values = np.array([(depth, std) for depth, std, _ in found], np.float64).reshape(-1, 2)
        return Depths(values[:, 0], values[:, 1], tuple(reason for _, _, reason in found))

    def _read(self, image: NDArray[Any], u: float, v: float, label: NDArray[np.uint8] | None, own: int) -> tuple[float, float, str]:
        height, width = image.shape
        if not (-0.5 < u < width - 0.5 and -0.5 < v < height - 0.5):
            return math.nan, math.nan, "outside the image"
        column, row, reach = round(u), round(v), self.config.radius
        part = np.s_[max(row - reach, 0) : row + reach + 1, max(column - reach, 0) : column + reach + 1]
        window = image[part]
        depth = _metres(window if label is None else window[label[part] == own])
        with np.errstate(invalid="ignore"):
            depth = np.sort(depth[(depth >= self.config.nearest) & (depth <= self.config.farthest)])
        surface = self._surface(depth, math.ceil(self.config.share * window.size))
        if not len(surface):
            return math.nan, math.nan, f"no surface: {len(depth)} of {window.size} pixels are its own and have a depth"
        middle = float(np.median(surface))
        return middle, self._std(surface, middle), ""

    def _surface(self, depth: Float64Array, enough: int) -> Float64Array:
        """Depths of the nearest surface, of ascending depths; empty: there is none."""
        if len(depth) < enough:
            return depth[:0]
        behind = depth + np.maximum(self.config.thickness, _WITHIN * (self.config.noise_floor + self.config.noise_growth * depth**2))
        end = np.searchsorted(depth, behind, side="right")
        count = end - np.arange(len(depth))
        first = np.flatnonzero(count >= enough)
        if not len(first):
            return depth[:0]
        # The first full window may begin at flying pixels and miss the surface's far side: of those that overlap it, the fullest.
        start = int(first[0]) + int(np.argmax(count[first[0] : end[first[0]]]))
        return depth[start : end[start]]

    def _std(self, surface: Float64Array, middle: float) -> float:
        noise = self.config.noise(middle)
        spread = _MAD * float(np.median(np.abs(surface - middle)))
        independent = max(1.0, len(surface) / max(self.config.correlation, 1.0) ** 2)
        by_noise = noise * noise * (1.0 + _CHANCE / math.sqrt(independent))
        variance = noise * noise * min(_MEDIAN / independent, 1.0) + max(spread * spread - by_noise, 0.0)
        return math.sqrt(variance)


def _metres(window: NDArray[Any]) -> Float64Array:
    """Depths of a window, in metres, shape (n,)."""
    depth = window.ravel().astype(np.float64)
    return depth * _MILLIMETRE if window.dtype == np.uint16 else depth
