"""From the points of one track to one motion sample per cloud, and from samples to the thirteen features (thesis, sections 7.2 and 4.2)."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from radar_core import PointCloud
from radar_core.config import config, knob

FEATURE_NAMES: Final[tuple[str, ...]] = (
    "zero_crossings",
    "time_of_max_speed",
    "time_of_min_speed",
    "max_speed",
    "min_speed",
    "max_azimuth",
    "min_azimuth",
    "max_elevation",
    "min_elevation",
    "azimuth_at_max_speed",
    "elevation_at_max_speed",
    "azimuth_at_min_speed",
    "elevation_at_min_speed",
)
"""The thirteen features of section 4.2, in the order of `extract` and of ``Gesture.features``."""


_SIDELOBE_RANGE: Final[float] = 0.3  # m: the body's echo and its side lobes spread over a few range bins


@config
class FeatureConfig:
    """How a track's points become features."""

    gate: float = knob(0.13, unit="m/s", low=1e-3, high=10.0, doc="width of one Doppler gate; the strongest detection of a gate counts")
    body_speed: float = knob(0.4, unit="m/s", low=0.0, high=10.0, doc="slower detections belong to the body, not to the arm")
    weak: float = knob(20.0, unit="dB", low=0.0, high=100.0, doc="moving detections that much below the strongest moving one are ignored")
    min_snr: float = knob(7.0, unit="dB", low=-100.0, high=100.0, doc="weaker moving detections are ignored")
    sidelobe: float = knob(36.0, unit="dB", low=0.0, high=200.0, doc="moving detections that far below a slow one at their range are leaks")
    angles: str = knob(
        "relative",
        choices=("offset", "relative", "sensor"),
        doc="what the azimuth and elevation features hold: offsets from the track in metres, angles from it in rad, or sensor angles",
    )
    smoothing: float = knob(0.06, unit="s", low=0.0, high=1.0, doc="length of the window over which angles are averaged, weighted by SNR")


@dataclass(frozen=True)
class MotionSample:
    """What one cloud tells about the motion of one track.

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


def doppler_gates(radial_speed: NDArray[np.float32], snr: NDArray[np.float32], gate: float) -> NDArray[np.intp]:
    """Pick the strongest detection of every Doppler gate (section 7.2).

    Parameters
    ----------
    radial_speed, snr : ndarray, shape (n_points,)
        Range rate [m/s] and SNR [dB]; a detection without a range rate is never picked, one without an SNR only when alone.
    gate : float
        Width of a gate [m/s].

    Returns
    -------
    ndarray of int, shape (n_gates,)
        Indices into the arrays, ordered by range rate.
    """
    known = np.flatnonzero(np.isfinite(radial_speed))
    number = np.rint(radial_speed[known].astype(np.float64) / gate)
    strength = np.nan_to_num(snr[known], nan=-1e9, posinf=1e9, neginf=-1e9)
    order = np.lexsort((strength, number))
    number = number[order]
    last = np.append(number[1:] != number[:-1], True) if len(number) else np.zeros(0, bool)
    return np.asarray(known[order[last]])


def weighted_median(values: NDArray[np.floating], weights: NDArray[np.floating]) -> float:
    """Median of ``values`` with non-negative ``weights`` (shape (n,) each), leaving non-finite values out; NaN when none is left."""
    good = np.isfinite(values) & (weights > 0)
    if not good.any():
        return math.nan
    order = np.argsort(values[good])
    value, weight = values[good][order].astype(np.float64), weights[good][order].astype(np.float64)
    position = np.cumsum(weight) - 0.5 * weight
    return float(np.interp(0.5 * weight.sum(), position, value))


def summarise(cloud: PointCloud, body: tuple[float, float, float], settings: FeatureConfig) -> MotionSample:
    """Reduce one cloud's points of one track to a motion sample.

    The thesis takes the highest velocity of each frame and the median angle. Here the side (approaching or receding) is the one whose
    moving gates carry more amplitude times speed, so that a lone false alarm on the other side does not flip the sign, and gates far
    weaker than the strongest moving one (``weak``) do not count.

    Parameters
    ----------
    cloud : PointCloud
        The track's points only.
    body : tuple of float
        Distance, azimuth, elevation of the track's centre seen from the sensor [m, rad, rad].
    settings : FeatureConfig
        The knobs.
    """
    snr = np.clip(np.nan_to_num(cloud.snr, nan=settings.min_snr, posinf=200.0, neginf=-200.0).astype(np.float64), -200.0, 200.0)
    picked = doppler_gates(cloud.radial_speed, cloud.snr, settings.gate)
    picked = picked[_is_arm(cloud, snr, settings)[picked]]
    if len(picked):
        picked = picked[snr[picked] >= snr[picked].max() - settings.weak]
    speed, snr = cloud.radial_speed[picked].astype(np.float64), snr[picked]
    if not len(picked):
        return MotionSample(cloud.stamp_ns, 0.0, 0.0, math.nan, math.nan, math.nan, body)
    amplitude = 10.0 ** (snr / 20)
    receding = float(amplitude @ speed) > 0
    side = speed > 0 if receding else speed < 0
    weights = np.where(side, amplitude, 0.0)
    return MotionSample(
        cloud.stamp_ns,
        float(speed.max() if receding else speed.min()),
        float(weights.sum()),
        weighted_median(cloud.range[picked], weights),
        weighted_median(cloud.azimuth[picked], weights),
        weighted_median(cloud.elevation[picked], weights),
        body,
    )


def _is_arm(cloud: PointCloud, snr: NDArray[np.float64], settings: FeatureConfig) -> NDArray[np.bool_]:
    """Mask of the detections that move and are no leakage of a strong slow one (the body) through the side lobes of the Doppler window."""
    speed = np.abs(cloud.radial_speed)
    moving = (speed >= settings.body_speed) & (snr >= settings.min_snr)
    slow = np.flatnonzero(speed < settings.body_speed)
    if not len(slow) or not moving.any():
        return np.asarray(moving)
    near = np.abs(cloud.range[:, None] - cloud.range[None, slow]) <= _SIDELOBE_RANGE
    strongest = np.where(near, snr[None, slow], -np.inf).max(axis=1)
    return np.asarray(moving & (snr >= strongest - settings.sidelobe))


class MotionRing:
    """The last seconds of one track's motion samples; its length is a time, whatever the frame rate.

    Parameters
    ----------
    window : float
        Samples older than this [s] are forgotten.
    max_samples : int
        Bound for sources that send absurdly fast; the oldest samples go first.
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


def zero_crossings(speed: NDArray[np.float64], threshold: float) -> int:
    """Count the sign changes of ``speed`` (shape (n,)) among values beyond ``threshold``, so that noise about zero counts none."""
    sign = np.sign(speed[np.abs(speed) > threshold])
    return int(np.count_nonzero(sign[1:] != sign[:-1]))


def extract(samples: Iterable[MotionSample], start_ns: int, settings: FeatureConfig, *, min_samples: int = 3) -> NDArray[np.float64] | None:
    """Compute the thirteen features of one event (section 4.2).

    Parameters
    ----------
    samples : iterable of MotionSample
        The event, in order of time.
    start_ns : int
        Start of the event: the two times are counted from here, in seconds, so that they do not depend on the frame rate.
    settings : FeatureConfig
        The knobs.
    min_samples : int
        Fewest samples with motion from which features are made.

    Returns
    -------
    ndarray of float64, shape (13,) = `FEATURE_NAMES`, or None
        Always finite. None when too few samples have motion. Angle features are 0 where the sensor does not measure the angle.
    """
    rows = np.array([(s.stamp_ns - start_ns, s.speed, s.weight, s.distance, s.azimuth, s.elevation, *s.body) for s in samples], np.float64)
    if len(rows) == 0 or np.count_nonzero(rows[:, 2]) < min_samples:
        return None
    time, speed, weight = rows[:, 0] * 1e-9, rows[:, 1], rows[:, 2]
    moving = weight > 0
    lateral, height = (_fill(angle[moving], time[moving], weight[moving], settings.smoothing) for angle in _angles(rows, settings.angles))
    time, speed = time[moving], speed[moving]
    first, last = int(np.argmax(speed)), int(np.argmin(speed))
    return np.array(
        [
            zero_crossings(speed, settings.body_speed),
            time[first],
            time[last],
            speed[first],
            speed[last],
            lateral.max(),
            lateral.min(),
            height.max(),
            height.min(),
            lateral[first],
            height[first],
            lateral[last],
            height[last],
        ]
    )


def _angles(rows: NDArray[np.float64], kind: str) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
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


def _fill(angle: NDArray[np.float64], time: NDArray[np.float64], weight: NDArray[np.float64], window: float) -> NDArray[np.float64]:
    """Average over ``window`` with the weights, leaving NaN out; what stays unknown becomes the mean of the known, or 0."""
    near = np.abs(time[:, None] - time[None, :]) <= window / 2 + 1e-9
    known = np.isfinite(angle)
    weights = near * np.where(known, weight, 0.0)
    total = weights.sum(axis=1)
    clean = np.where(known, angle, 0.0)
    smooth = np.divide(weights @ clean, total, out=np.full(len(angle), np.nan), where=total > 0)
    fallback = float(np.mean(clean[known])) if known.any() else 0.0
    return np.where(total > 0, smooth, fallback)
