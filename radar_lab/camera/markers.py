"""Coloured markers as joints: balls or bands of one hue each, found without any model."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from radar_core import ConfigError
from radar_core.config import config, knob
from radar_core.types import Float64Array
from radar_lab.camera.pose import Keypoints, require_image

IndexArray = NDArray[np.intp]

_CIRCLE = 360.0  # degrees
_MOST = 100
_SLACK = 1e-9  # px: points on the circle are inside in spite of rounding


@config
class MarkerConfig:
    """Which markers a person wears, and what counts as one."""

    names: tuple[str, ...] = knob(("right_hand",), doc="joints that wear a marker, e.g. right_hand, left_wrist")
    hues: tuple[float, ...] = knob(
        (120.0,), unit="deg", low=0.0, high=360.0, doc="hue of each, as colour pickers show it: 0 red, 60 yellow, 120 green, 240 blue"
    )
    tolerance: float = knob(15.0, unit="deg", low=1.0, high=90.0, doc="hues this far from a marker's are its own")
    saturation: float = knob(0.5, low=0.05, high=1.0, doc="paler pixels are no marker's (0: grey, 1: pure colour)")
    brightness: float = knob(0.2, low=0.01, high=1.0, doc="darker pixels are no marker's")
    min_pixels: int = knob(12, unit="px", low=1, high=10**6, doc="smaller spots are no marker")
    pixel_std: float = knob(
        0.5, unit="px", low=0.0, high=100.0, doc="how far the middle of a marker's pixels is from the joint, in u and v"
    )
    off_centre: float = knob(0.05, low=0.0, high=1.0, doc="the same as a share of the marker's radius: light and half-hidden markers")

    def validate(self) -> None:
        """Raise `ConfigError` when markers and hues differ in number, two have one name, or their hues cannot be told apart."""
        if len(self.names) != len(self.hues) or not self.names:
            raise ConfigError(
                f"MarkerConfig has {len(self.names)} names but {len(self.hues)} hues; give one hue to each marker", key=("hues",)
            )
        if len(self.names) > _MOST:
            raise ConfigError(f"MarkerConfig.names has {len(self.names)} joints; {_MOST} are the most", key=("names",))
        if len(set(self.names)) < len(self.names):
            raise ConfigError(f"MarkerConfig.names {self.names} repeat; each joint wears one marker", key=("names",))
        for i, hue in enumerate(self.hues):
            for name, other in zip(self.names[:i], self.hues[:i], strict=True):
                apart = abs((hue - other + _CIRCLE / 2) % _CIRCLE - _CIRCLE / 2)
                if apart < 2 * self.tolerance:
                    raise ConfigError(
                        f"MarkerConfig.hues: {name} and {self.names[i]} are {apart:g} degrees apart, less than twice the tolerance "
                        f"({self.tolerance:g}); choose colours that differ more, or a smaller tolerance",
                        key=("hues", i),
                    )


class MarkerFinder:
    """Find markers by their hue; ``names`` are those of the joints.

    Of each hue the largest connected spot is the marker. The joint is the middle of the smallest circle around it: right for a ball of
    which fingers hide up to half, and for a band. The confidence is the spot's share of all spots of that hue (two of one size: 0.5), times
    that of the circle which it fills (a ball 1, a band of 1 : 2 0.5). A spot at the image's border is cut off: not found.
    """

    def __init__(self, config: MarkerConfig | None = None) -> None:
        self.config = config or MarkerConfig()
        self.names = self.config.names

    def process(self, image: NDArray[np.uint8]) -> Keypoints:
        """Find the markers of an image, shape (height, width, 3): see `radar_lab.camera.pose.PoseEstimator`."""
        require_image(image)
        n = len(self.names)
        pixel, confidence, std = np.full((n, 2), np.nan), np.zeros(n), np.full(n, self.config.pixel_std)
        label = np.zeros(image.shape[:2], np.uint8)
        rows, columns, hue = self._vivid(image)
        for i, wanted in enumerate(self.config.hues):
            own = np.abs((hue - wanted + _CIRCLE / 2) % _CIRCLE - _CIRCLE / 2) <= self.config.tolerance
            spot = self._largest(rows[own], columns[own], image.shape[:2]) if np.count_nonzero(own) >= self.config.min_pixels else None
            if spot is not None:
                v, u, share = spot
                label[v, u] = i + 1
                pixel[i], radius = enclosing_circle(_rims(u.astype(np.float64), v.astype(np.float64)))
                filled = len(u) / (math.pi * (radius + 0.5) ** 2)  # half a pixel more, because pixels reach beyond their centres
                confidence[i] = share * min(1.0, filled)
                std[i] = math.hypot(self.config.pixel_std, self.config.off_centre * radius)
        return Keypoints(self.names, pixel, confidence, std, label)

    def close(self) -> None:
        """Nothing is held."""

    def _vivid(self, image: NDArray[np.uint8]) -> tuple[IndexArray, IndexArray, Float64Array]:
        """Rows, columns and hues [deg] of the pixels that have a colour, each of shape (n,)."""
        red, green, blue = image[..., 0], image[..., 1], image[..., 2]
        high = np.maximum(np.maximum(red, green), blue)
        chroma = high - np.minimum(np.minimum(red, green), blue)
        rows, columns = np.nonzero((high >= self.config.brightness * 255.0) & (chroma >= self.config.saturation * high) & (chroma > 0))
        r, g, b = (image[rows, columns, k].astype(np.float64) for k in range(3))
        top, range_ = high[rows, columns], chroma[rows, columns].astype(np.float64)
        sector = np.where(top == r, (g - b) / range_, np.where(top == g, 2.0 + (b - r) / range_, 4.0 + (r - g) / range_))
        return rows, columns, (60.0 * sector) % _CIRCLE

    def _largest(self, rows: IndexArray, columns: IndexArray, shape: tuple[int, ...]) -> tuple[IndexArray, IndexArray, float] | None:
        """Rows and columns of the largest spot among some pixels, and its share of all spots; None: there is none, or it is cut off."""
        top, left = rows.min(), columns.min()
        mask = np.zeros((rows.max() - top + 1, columns.max() - left + 1), np.bool_)
        mask[rows - top, columns - left] = True
        labels, count = ndimage.label(mask, np.ones((3, 3)))
        sizes = np.bincount(labels.ravel(), minlength=count + 1)[1:]
        largest = int(sizes.argmax())
        if sizes[largest] < self.config.min_pixels:
            return None
        v, u = np.nonzero(labels == largest + 1)
        v, u = v + top, u + left
        if u.min() < 1 or v.min() < 1 or u.max() > shape[1] - 2 or v.max() > shape[0] - 2:
            return None
        return v, u, float(sizes[largest] / sizes[sizes >= self.config.min_pixels].sum())


def _rims(u: Float64Array, v: Float64Array) -> Float64Array:
    """First and last pixel of every row of a spot, shape (n, 2): no other can lie on its enclosing circle."""
    order = np.lexsort((u, v))
    starts = np.flatnonzero(np.diff(v[order], prepend=v.min() - 1.0))
    ends = np.append(starts[1:], len(u)) - 1
    return np.asarray(np.stack([u[order], v[order]], -1)[np.unique(np.concatenate([starts, ends]))])


def enclosing_circle(points: Float64Array) -> tuple[Float64Array, float]:
    """Smallest circle around points, shape (n, 2), at least one (Welzl 1991, incrementally): centre, shape (2,), and radius."""
    order = np.random.default_rng(0).permutation(len(points))  # any order is right; a random one is fast
    at = [complex(*points[i]) for i in order]
    centre, radius = at[0], 0.0
    for i, p in enumerate(at):
        if abs(p - centre) <= radius:
            continue
        centre, radius = p, 0.0
        for j, q in enumerate(at[:i]):
            if abs(q - centre) <= radius:
                continue
            centre, radius = (p + q) / 2, abs(p - q) / 2 + _SLACK
            for r in at[:j]:
                if abs(r - centre) > radius:
                    centre = _through(p, q, r)
                    radius = max(abs(p - centre), abs(q - centre), abs(r - centre)) + _SLACK
    return np.array([centre.real, centre.imag]), radius


def _through(p: complex, q: complex, r: complex) -> complex:
    """Centre of the circle through three points; of the two farthest where they lie on a line."""
    a, b = q - p, r - p
    cross = a.real * b.imag - a.imag * b.real
    if abs(cross) < 1e-9:
        return max(((p + q) / 2, abs(p - q)), ((p + r) / 2, abs(p - r)), ((q + r) / 2, abs(q - r)), key=lambda pair: pair[1])[0]
    return p + 1j * (a * abs(b) ** 2 - b * abs(a) ** 2) / (2 * cross)
