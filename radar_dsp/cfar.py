"""CFAR detection (thesis, figure A.12): four algorithms, three windows; speed wraps around, range does not.

At the ends of the range axis a cell is judged by the training cells that exist, with a rank and a threshold of its own: padding with
zeros would raise the false-alarm rate there a hundredfold.
"""

from __future__ import annotations

import functools
from typing import Any

import numpy as np
from numpy.typing import NDArray

from radar_core import ConfigError
from radar_dsp import kernels, thresholds
from radar_dsp.config import CfarConfig
from radar_dsp.kernels import Cells, FloatMap

MIN_TRAINING = 4  # a cell with fewer training cells is not judged at all: the threshold would be so high that it only hides the problem
_USUAL = 0.1
"""Patterns of training cells that a larger share of the cells has get a more careful threshold than those beside ends and coupling."""

AnyArray = NDArray[Any]
Correlation = tuple[NDArray[np.complex128], NDArray[np.complex128]]
"""Correlation coefficients of the noise over the distance in cells (`windows.noise_correlation`), shapes (n_speed,) and (n_range,)."""


class TrainingWindow:
    """Which cells train which: those around the cell under test, beyond its guard.

    Parameters
    ----------
    config : CfarConfig
        Window, guard and training cells.
    usable : ndarray of bool, shape (n_speed, n_range)
        False: neither judged nor used for training (the coupling).

    Attributes
    ----------
    half, least : tuple of int, int
        Reach of the window in speed and range [cells]. A side with fewer cells than ``least``, at an end of the range axis, is not
        compared: the other one counts alone.
    offsets, side : ndarray of intp, of bool, shape (n_offsets, 2), (n_offsets,)
        Training cells relative to the cell under test, in speed and range; whether they are beyond it (in range, or in speed where the
        range is the same): greatest-of and smallest-of compare the sides.
    """

    def __init__(self, config: CfarConfig, usable: NDArray[np.bool_]) -> None:
        self.usable = usable
        n_speed, n_range = usable.shape
        # A window that wraps onto itself would count cells twice, so it must not be longer than the axis.
        half_speed = 0 if config.window == "range" else min(config.guard_speed + config.training_speed, (n_speed - 1) // 2)
        half_range = 0 if config.window == "speed" else min(config.guard_range + config.training_range, n_range - 1)
        self.half = (half_speed, half_range)
        guard_speed = min(config.guard_speed, half_speed)
        self.offsets = np.array(
            [
                (i, j)
                for i in range(-half_speed, half_speed + 1)
                for j in range(-half_range, half_range + 1)
                if abs(i) > guard_speed or abs(j) > config.guard_range
            ],
            np.intp,
        ).reshape(-1, 2)
        self.side = np.where(self.offsets[:, 1] != 0, self.offsets[:, 1], self.offsets[:, 0]) > 0
        self.least = max(len(self.side) // 4, 1)

    def patterns(self) -> tuple[NDArray[np.bool_], NDArray[np.intp]]:
        """Group the cells by which of their training cells exist.

        Gives the existing training cells of each pattern, shape (n_patterns, n_offsets), and the pattern of every cell, shape (n_speed,
        n_range).
        """
        padded = kernels.pad(np.ones(self.usable.shape, np.float32), self.usable, self.half, 0.0) > 0
        n_speed, n_range = self.usable.shape
        key = np.zeros(self.usable.shape)
        for weight, (i, j) in zip(np.random.default_rng(0).random(len(self.offsets)), self.offsets + self.half, strict=True):
            key += weight * padded[i : i + n_speed, j : j + n_range]
        _, first, index = np.unique(key, return_index=True, return_inverse=True)
        cells = np.unravel_index(first, self.usable.shape)
        place = self.offsets + self.half
        exists = padded[cells[0][:, None] + place[:, 0], cells[1][:, None] + place[:, 1]]
        return exists.reshape(len(first), len(place)), index.reshape(self.usable.shape)


class Detector:
    """A CFAR algorithm with its window.

    Parameters
    ----------
    config : CfarConfig
        Algorithm and wanted false-alarm probability.
    window : TrainingWindow
        Training cells.
    correlation : tuple of ndarray, shapes (n_speed,) and (n_range,)
        Of the noise.
    n_channel : int
        Number of integrated channels.

    Attributes
    ----------
    factor : ndarray, shape (n_speed, n_range)
        Threshold over the noise level of every cell, infinite where a cell is not judged.
    """

    def __init__(self, config: CfarConfig, window: TrainingWindow, correlation: Correlation, n_channel: int) -> None:
        self._window = window
        exists, pattern = window.patterns()
        factor, level = _factors(config, window, exists, pattern, correlation, n_channel)
        self.factor = np.where(window.usable, factor[pattern], np.inf)
        self._judged = np.isfinite(self.factor)
        self._mean_level = level[pattern].astype(np.float32)
        self._prepare(config, exists, pattern)

    def _prepare(self, config: CfarConfig, exists: NDArray[np.bool_], pattern: NDArray[np.intp]) -> None:
        """Make the tables of the algorithm from the patterns of training cells, see `TrainingWindow.patterns`."""
        raise NotImplementedError

    def detect(self, power: FloatMap) -> NDArray[np.bool_]:
        """Mask of the cells above their threshold, shape (n_speed, n_range)."""
        raise NotImplementedError

    def noise(self, power: FloatMap, cells: Cells) -> FloatMap:
        """Estimated noise power at single cells, shape (n_cells,)."""
        raise NotImplementedError


class OrderedStatistic(Detector):
    """Ordered-statistic CFAR (Rohling 1983), as a rank test without sorting.

    P > a x_(k) holds exactly when at least k training cells x have a x < P, so counting comparisons decides.
    """

    def _prepare(self, config: CfarConfig, exists: NDArray[np.bool_], pattern: NDArray[np.intp]) -> None:
        rank = np.clip(np.round(config.rank * exists.sum(axis=1)), 1, None).astype(np.int32)
        self._reciprocal = np.where(self._judged, 1.0 / np.where(self._judged, self.factor, 1.0), 0.0).astype(np.float32)
        self._rank = np.where(self._judged, rank[pattern], len(self._window.offsets) + 1).astype(np.int32)

    def detect(self, power: FloatMap) -> NDArray[np.bool_]:
        """See `Detector.detect`."""
        window = self._window
        padded = kernels.pad(power, window.usable, window.half, np.inf)
        mask: NDArray[np.bool_] = kernels.rank_test(padded, power * self._reciprocal, self._rank, window.offsets, window.half)
        return mask

    def noise(self, power: FloatMap, cells: Cells) -> FloatMap:
        """See `Detector.noise`."""
        window = self._window
        padded = kernels.pad(power, window.usable, window.half, np.inf)
        level: FloatMap = kernels.ordered(padded, cells, window.offsets, window.half, self._rank[cells])
        return level / self._mean_level[cells]


class Average(Detector):
    """Cell-averaging CFAR, and the greater or the smaller of the averages on both sides."""

    def _prepare(self, config: CfarConfig, exists: NDArray[np.bool_], pattern: NDArray[np.intp]) -> None:
        window = self._window
        self._factor = np.where(self._judged, self.factor, 1.0).astype(np.float32)
        sides = [window.side, ~window.side] if config.algorithm != "ca" else [np.ones(len(window.side), np.bool_)]
        self._parts = []
        for side in sides:
            n = exists[:, side].sum(axis=1)
            n[n < (window.least if config.algorithm != "ca" else 1)] = 0
            self._parts.append((np.ascontiguousarray(window.offsets[side]), n[pattern].astype(np.float32)))
        self._choose = np.fmax if config.algorithm == "go" else np.fmin

    def _level(self, power: FloatMap) -> FloatMap:
        window = self._window
        padded = kernels.pad(power, window.usable, window.half, 0.0)
        means = [
            np.divide(kernels.sums(padded, offsets, window.half), n, out=np.full(n.shape, np.nan, np.float32), where=n > 0)
            for offsets, n in self._parts
        ]
        level: FloatMap = means[0] if len(means) == 1 else self._choose(*means)  # NaN where a side is not compared
        return level

    def detect(self, power: FloatMap) -> NDArray[np.bool_]:
        """See `Detector.detect`."""
        level = self._level(power)
        return np.asarray((power > self._factor * level) & (level > 0) & self._judged)

    def noise(self, power: FloatMap, cells: Cells) -> FloatMap:
        """See `Detector.noise`."""
        return np.asarray((self._level(power) / self._mean_level)[cells], np.float32)


def _factors(
    config: CfarConfig, window: TrainingWindow, exists: AnyArray, pattern: AnyArray, correlation: Correlation, n_channel: int
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Threshold factor and mean level of every pattern of training cells, shape (n_patterns,); infinite where there are too few."""
    factor, level = np.full(len(exists), np.inf), np.ones(len(exists))
    key = tuple(axis.tobytes() for axis in correlation)
    share = np.bincount(pattern.ravel(), minlength=len(exists)) / pattern.size
    for p, training in enumerate(exists):
        numbers = thresholds.NUMBERS if share[p] > _USUAL else thresholds.NUMBERS // 5
        if training.sum() >= MIN_TRAINING:
            offsets = _canonical(window.offsets[training])
            wanted = config.algorithm, config.rank, config.false_alarm
            factor[p], level[p] = _design(wanted, n_channel, window.least, numbers, offsets, key)
    return factor, level


def _canonical(offsets: NDArray[np.intp]) -> tuple[tuple[int, int], ...]:
    """One of the four mirror images of a pattern: noise has no direction, so they share a threshold."""
    images = [tuple(sorted(map(tuple, (offsets * (a, b)).tolist()))) for a in (1, -1) for b in (1, -1)]
    return min(images)


@functools.lru_cache(maxsize=4096)
def _design(
    wanted: tuple[str, float, float], n_channel: int, least: int, numbers: int, offsets: tuple[tuple[int, int], ...], key: tuple[bytes, ...]
) -> tuple[float, float]:
    """Threshold factor and mean level for a pattern of training cells; kept, because every baseband with this configuration asks again."""
    algorithm, rank, false_alarm = wanted
    place = np.array([(0, 0), *offsets])
    axes = [np.frombuffer(axis, np.complex128) for axis in key]
    lag = place[:, None, :] - place[None, :, :]
    correlation = axes[0][lag[..., 0] % len(axes[0])] * axes[1][lag[..., 1] % len(axes[1])]
    along = np.where(place[1:, 1] != 0, place[1:, 1], place[1:, 0]) > 0
    k = max(int(np.round(rank * len(offsets))), 1)

    def level(power: NDArray[Any]) -> NDArray[np.float64]:
        if algorithm == "os":
            return np.asarray(np.partition(power, k - 1, axis=1)[:, k - 1], np.float64)
        if algorithm == "ca":
            return np.asarray(power.mean(axis=1), np.float64)
        sides = [power[:, side].mean(axis=1) for side in (along, ~along) if side.sum() >= least]
        return np.asarray(functools.reduce(np.maximum if algorithm == "go" else np.minimum, sides), np.float64)

    return thresholds.design(correlation, level, false_alarm, n_channel, numbers)


def make_detector(config: CfarConfig, usable: NDArray[np.bool_], correlation: Correlation, n_channel: int) -> Detector:
    """Make the CFAR detector that the configuration names.

    Parameters
    ----------
    config : CfarConfig
        Algorithm, window and their knobs.
    usable : ndarray of bool, shape (n_speed, n_range)
        False where the coupling is suppressed. A `ConfigError` says that no cell has enough training cells.
    correlation, n_channel
        As of `Detector`.
    """
    window = TrainingWindow(config, usable)
    exists = window.patterns()[0] if len(window.offsets) else np.zeros((1, 0), np.bool_)
    if exists.sum(axis=1).max() < MIN_TRAINING:
        raise ConfigError(
            f"a spectrum of {usable.shape[0]} x {usable.shape[1]} cells (speed x range) leaves no cell {MIN_TRAINING} training cells; "
            "lower cfar.guard_*, raise cfar.training_*, shrink the coupling region, or use more samples and chirps"
        )
    kind = OrderedStatistic if config.algorithm == "os" else Average
    return kind(config, window, correlation, n_channel)
