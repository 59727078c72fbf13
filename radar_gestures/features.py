"""From the points of one track to a motion sample per cloud, and from samples to the thirteen features (thesis, 7.2 and 4.2)."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Final, Literal

import numpy as np
from numpy.typing import NDArray

from radar_core.config import config, knob
from radar_core.types import BoolArray, Float64Array
from radar_gestures.maps import Detections, doppler_gates

FEATURE_NAMES: Final[tuple[str, ...]] = (
    "zero_crossings", "time_of_max_speed", "time_of_min_speed", "max_speed", "min_speed", "max_azimuth", "min_azimuth", "max_elevation",
    "min_elevation", "azimuth_at_max_speed", "elevation_at_max_speed", "azimuth_at_min_speed", "elevation_at_min_speed",
)  # fmt: skip
"""The thirteen features of section 4.2, in the order of `extract` and of ``Gesture.features``.

``zero_crossings`` is a count, times are s from the start of the event, speeds m/s (positive = receding); azimuths (left positive) and
elevations (up positive) are rad, or m where ``FeatureConfig.angles`` is ``offset``.
"""


_SIDELOBE_RANGE: Final[float] = 0.3  # m: the body's echo and its side lobes spread over a few range bins
_GAUSSIAN: Final[float] = -10.0 / math.log(10.0)  # dB: 20 log10 of exp(-x^2 / 2) is this times x^2
_FAR: Final[float] = 3.7  # standard deviations beside the body: -60 dB, which is as good as nothing


@config
class FeatureConfig:
    """How a track's points become features."""

    gate: float = knob(0.13, unit="m/s", low=1e-3, high=10.0, doc="width of one Doppler gate; the strongest detection of a gate counts")
    body_speed: float = knob(0.4, unit="m/s", low=0.0, high=10.0, doc="slower detections belong to the body, not to the arm")
    weak: float = knob(20.0, unit="dB", low=0.0, high=100.0, doc="moving detections that much below the strongest moving one are ignored")
    min_snr: float = knob(7.0, unit="dB", low=-100.0, high=100.0, doc="weaker moving detections are ignored")
    sidelobe: float = knob(36.0, unit="dB", low=0.0, high=200.0, doc="moving detections that far below a slow one at their range are leaks")
    angles: Literal["offset", "relative", "sensor"] = knob(
        "relative",
        doc="what the azimuth and elevation features hold: offsets from the track in metres, angles from it in rad, or sensor angles",
    )
    smoothing: float = knob(0.06, unit="s", low=0.0, high=1.0, doc="length of the window over which angles are averaged, weighted by SNR")
    median: float = knob(0.1, unit="s", low=0.0, high=1.0, doc="window of the medians of speed and angles, against a neighbour's points")
    lateral: float = knob(0.35, unit="m", low=0.05, high=100.0, doc="moving detections beside the body count less (standard deviation)")


@dataclass(frozen=True)
class MotionSample:
    """Motion of one track in one cloud.

    Attributes
    ----------
    stamp_ns : int
        Of the cloud [ns].
    speed : float
        Radial speed of the fastest moving Doppler gate, signed (positive = receding) [m/s]; 0 when nothing of the track moves.
    weight : float
        Sum of the amplitudes of the moving gates (1 = noise floor); 0 when nothing moves.
    distance : float
        Range of the moving points from the sensor [m]; NaN when nothing moves.
    azimuth, elevation : float
        Median direction of the moving points, weighted by amplitude, seen from the sensor [rad]; NaN when nothing moves or the sensor
        does not measure it.
    body : tuple of float, length 3
        Distance [m], azimuth and elevation [rad] of the track's centre, seen from the sensor.
    """

    stamp_ns: int
    speed: float
    weight: float
    distance: float
    azimuth: float
    elevation: float
    body: tuple[float, float, float]


def weighted_medians(rows: NDArray[np.floating], weights: NDArray[np.floating]) -> list[float]:
    """Weighted median of every row, shape (n_rows, n), between the values where it falls between two; NaN where nothing is left.

    Weights, shape (n,), are not negative. Non-finite values and those of weight 0 are left out.
    """
    if not len(weights):
        return [math.nan] * len(rows)
    good = np.isfinite(rows) & (weights > 0)
    order = np.where(good, rows, np.inf).argsort(axis=1, kind="stable")
    row = np.arange(len(rows))[:, None]
    value, weight = rows[row, order].astype(np.float64), np.where(good, weights, 0.0)[row, order]
    total = weight.cumsum(axis=1)
    position, half = total - 0.5 * weight, 0.5 * total[:, -1:]
    place, known = (position < half).sum(axis=1), good.any(axis=1)
    columns = (column.tolist() for column in (place, half[:, 0], position, value, known))
    return [_between(*numbers) for numbers in zip(*columns, strict=True)]


def _between(place: int, x: float, positions: list[float], values: list[float], known: bool) -> float:
    """Value at x, on the line between the values at the positions before and at ``place``; NaN when not ``known``."""
    if not known:
        return math.nan
    if place == 0:
        return values[0]
    low, high = positions[place - 1], positions[place]
    return values[place - 1] + (x - low) * (values[place] - values[place - 1]) / (high - low)


def summarise(
    cloud: Detections, body: tuple[float, float, float], config: FeatureConfig, picked: NDArray[np.intp] | None = None
) -> MotionSample:
    """Reduce one cloud's points of one track to a motion sample.

    The thesis takes the highest velocity of each frame and the median angle. Here the side (approaching or receding) is the one whose
    moving gates carry more amplitude times speed, so that a lone false alarm on the other side does not flip the sign, and gates far weaker
    than the strongest moving one (``weak``) do not count. Detections count as weaker the farther they are beside the body (``lateral``):
    those far away are more often a neighbour's.

    Parameters
    ----------
    cloud : Detections
        The track's points only.
    body : tuple of float
        Distance, azimuth, elevation of the track's centre seen from the sensor [m, rad, rad].
    config : FeatureConfig
        The knobs.
    picked : ndarray of int, shape (n_gates,), or None
        The strongest detections of the gates, where the caller has them already (`doppler_gates`).

    Returns
    -------
    MotionSample
        Speed and weight 0 and NaN for the place when nothing moves. A direction is NaN when none of the gates that count has one: those
        that have one decide. A detection without SNR counts as one of ``min_snr``, one without a range rate not at all.
    """
    snr = np.clip(np.where(np.isnan(cloud.snr), config.min_snr, cloud.snr).astype(np.float64), -200.0, 200.0)
    if picked is None:
        picked = doppler_gates(cloud.radial_speed, cloud.snr, config.gate)
    picked = picked[_is_arm(cloud, snr, config)[picked]]
    snr = snr[picked] + _beside(cloud.range[picked], cloud.azimuth[picked] - body[1], config.lateral)
    if len(picked):
        strong = snr >= snr.max() - config.weak
        picked, snr = picked[strong], snr[strong]
    speed = cloud.radial_speed[picked].astype(np.float64)
    if not len(picked):
        return MotionSample(cloud.stamp_ns, 0.0, 0.0, math.nan, math.nan, math.nan, body)
    amplitude = 10.0 ** (snr / 20)
    receding = float(amplitude @ speed) > 0
    weights = np.where(speed > 0 if receding else speed < 0, amplitude, 0.0)
    places = np.array((cloud.range[picked], cloud.azimuth[picked], cloud.elevation[picked]))
    distance, azimuth, elevation = weighted_medians(places, weights)
    fastest = float(speed.max() if receding else speed.min())
    return MotionSample(cloud.stamp_ns, fastest, float(weights.sum()), distance, azimuth, elevation, body)


def _is_arm(cloud: Detections, snr: Float64Array, config: FeatureConfig) -> BoolArray:
    """Mask of the detections that move and are no leakage of a strong slow one (the body) through the side lobes of the Doppler window."""
    speed = np.abs(cloud.radial_speed)
    moving = (speed >= config.body_speed) & (snr >= config.min_snr)
    slow = np.flatnonzero(speed < config.body_speed)
    if not len(slow) or not moving.any():
        return np.asarray(moving)
    with np.errstate(invalid="ignore"):  # two infinite ranges: not near
        near = np.abs(cloud.range[:, None] - cloud.range[None, slow]) <= _SIDELOBE_RANGE
    strongest = np.where(near, snr[None, slow], -np.inf).max(axis=1)
    return np.asarray(moving & (snr >= strongest - config.sidelobe))


def _beside(distance: NDArray[np.floating], azimuth: NDArray[np.floating], lateral: float) -> Float64Array:
    """How much less a detection counts for being beside the body [dB, 0 or less]; not at all where its place is unknown."""
    with np.errstate(invalid="ignore"):  # the sine of an unknown azimuth
        away = np.clip(np.asarray(distance * np.sin(azimuth), np.float64) / lateral, -_FAR, _FAR)
    return np.where(np.isnan(away), 0.0, _GAUSSIAN * np.square(away))


class MotionRing:
    """The last ``window`` seconds of one track's motion samples; its length is a time, whatever the frame rate.

    ``max_samples`` bounds it for sources that send absurdly fast; the oldest samples go first.
    """

    def __init__(self, window: float, max_samples: int = 4096) -> None:
        self._window_ns = round(window * 1e9)
        self._samples: deque[MotionSample] = deque(maxlen=max_samples)

    def __len__(self) -> int:
        return len(self._samples)

    def add(self, sample: MotionSample) -> None:
        """Append a sample; one that is not later than the last means that time jumped back, and everything before it is forgotten."""
        if self._samples and sample.stamp_ns <= self._samples[-1].stamp_ns:
            self._samples.clear()
        self._samples.append(sample)
        while self._samples[0].stamp_ns < sample.stamp_ns - self._window_ns:
            self._samples.popleft()

    def between(self, start_ns: int, end_ns: int) -> list[MotionSample]:
        """Return the samples with ``start_ns <= stamp_ns <= end_ns``, in order of time."""
        return [sample for sample in self._samples if start_ns <= sample.stamp_ns <= end_ns]


def zero_crossings(speed: Float64Array, threshold: float) -> int:
    """Count the sign changes of ``speed`` (shape (n,)) among values beyond ``threshold``, so that noise about zero counts none."""
    sign = np.sign(speed[np.abs(speed) > threshold])
    return int(np.count_nonzero(sign[1:] != sign[:-1]))


def extract(samples: Iterable[MotionSample], start_ns: int, config: FeatureConfig, *, min_samples: int = 3) -> Float64Array | None:
    """Compute the thirteen features of one event (section 4.2).

    Parameters
    ----------
    samples : iterable of MotionSample
        The event, in order of time.
    start_ns : int
        Start of the event: the two times are counted from here, in seconds, so that they do not depend on the frame rate.
    config : FeatureConfig
        The knobs.
    min_samples : int
        Fewest samples with motion from which features are made.

    Returns
    -------
    ndarray of float64, shape (13,) = `FEATURE_NAMES`, or None
        Always finite, in s, m/s and rad (m with ``angles`` offset); None when fewer than ``min_samples`` samples have motion.

        - An angle that is NaN in some samples is averaged over its neighbours within ``smoothing``; where these have none either, it is
          the mean over the event.
        - An angle that is NaN in all samples, as the elevation of a sensor that does not measure it, gives 0 in all its features: with
          angles taken from the track this is "at the height of the body".
        - A track whose own direction is unknown counts as straight ahead (0).
        - With ``angles`` offset, a sample without a distance has no angles.
    """
    rows = np.array([(s.stamp_ns - start_ns, s.speed, s.weight, s.distance, s.azimuth, s.elevation, *s.body) for s in samples], np.float64)
    if len(rows) == 0 or np.count_nonzero(rows[:, 2]) < min_samples:
        return None
    time, speed, weight = rows[:, 0] * 1e-9, rows[:, 1], rows[:, 2]
    moving = weight > 0
    time, speed, weight = time[moving], speed[moving], weight[moving]
    angles = [_fill(angle[moving], time, weight, config.smoothing) for angle in _angles(rows, config.angles)]
    speed, lateral, height = running_medians(np.array([speed, *angles]), time, config.median)
    first, last = int(np.argmax(speed)), int(np.argmin(speed))
    extremes = (time[first], time[last], speed[first], speed[last], lateral.max(), lateral.min(), height.max(), height.min())
    return np.array([zero_crossings(speed, config.body_speed), *extremes, lateral[first], height[first], lateral[last], height[last]])


def running_medians(rows: Float64Array, time: Float64Array, window: float) -> Float64Array:
    """Median of every row, shape (n_rows, n), over a window of time [s] about each sample; one without neighbours stays as it is."""
    near = np.abs(time[:, None] - time[None, :]) <= window / 2 + 1e-9
    values = np.sort(np.where(near, rows[:, None], np.inf), axis=-1)
    count = near.sum(axis=1)
    middle = np.stack([(count - 1) // 2, count // 2], axis=-1)
    return np.asarray(np.take_along_axis(values, middle[None], axis=-1).mean(axis=-1))


def _angles(rows: Float64Array, kind: str) -> tuple[Float64Array, Float64Array]:
    """Azimuth and elevation signals, shape (n,) each, in the chosen kind; the track's place is its median over the event."""
    distance, azimuth, elevation = rows[:, 3], rows[:, 4], rows[:, 5]
    if kind == "sensor":
        return azimuth, elevation
    body_azimuth, body_elevation = (
        np.median(column[np.isfinite(column)]) if np.isfinite(column).any() else 0.0 for column in rows[:, 7:9].T
    )
    azimuth, elevation = azimuth - body_azimuth, elevation - body_elevation
    azimuth = (azimuth + np.pi) % (2 * np.pi) - np.pi
    if kind == "relative":
        return azimuth, elevation
    return distance * np.sin(azimuth), distance * np.sin(elevation)


def _fill(angle: Float64Array, time: Float64Array, weight: Float64Array, window: float) -> Float64Array:
    """Average over ``window`` with the weights, leaving NaN out; what stays unknown becomes the mean of the known, or 0."""
    near = np.abs(time[:, None] - time[None, :]) <= window / 2 + 1e-9
    known = np.isfinite(angle)
    weights = near * np.where(known, weight, 0.0)
    total = weights.sum(axis=1)
    clean = np.where(known, angle, 0.0)
    smooth = np.divide(weights @ clean, total, out=np.full(len(angle), np.nan), where=total > 0)
    fallback = float(np.mean(clean[known])) if known.any() else 0.0
    return np.where(total > 0, smooth, fallback)
