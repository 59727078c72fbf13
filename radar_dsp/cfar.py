"""Two-dimensional CFAR detection; speed wraps around, range does not.

At the ends of the range axis a cell is judged by the training cells that exist, with a rank and a threshold of its own: padding with
zeros would raise the false-alarm rate there a hundredfold.
"""

from __future__ import annotations

from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from radar_core import ConfigError
from radar_dsp import thresholds
from radar_dsp.config import CfarConfig

MIN_TRAINING = 6
"""A cell with fewer training cells is not judged at all: the threshold would be so high that it only hides the problem."""

FloatMap = NDArray[np.float32]
Cells = tuple[NDArray[np.intp], NDArray[np.intp]]
AnyArray = NDArray[Any]


class TrainingWindow:
    """Which cells train which: a frame of cells around the cell under test without its guard.

    Parameters
    ----------
    config : CfarConfig
        Guard and training cells.
    usable : ndarray of bool, shape (n_speed, n_range)
        False: neither judged nor used for training (the coupling).
    """

    def __init__(self, config: CfarConfig, usable: NDArray[np.bool_]) -> None:
        self.usable = usable
        n_speed, n_range = usable.shape
        # A window that wraps onto itself would count cells twice, so it must not be longer than the axis.
        self.half_speed = min(config.guard_speed + config.training_speed, (n_speed - 1) // 2)
        self.half_range = min(config.guard_range + config.training_range, n_range - 1)
        guard_speed, guard_range = min(config.guard_speed, self.half_speed), config.guard_range
        self.offsets = np.array(
            [
                (i, j)
                for i in range(-self.half_speed, self.half_speed + 1)
                for j in range(-self.half_range, self.half_range + 1)
                if abs(i) > guard_speed or abs(j) > guard_range
            ],
            np.intp,
        ).reshape(-1, 2)
        self._stride = n_range + 2 * self.half_range
        self.shifts = self.offsets[:, 0] * self._stride + self.offsets[:, 1]

    def pad(self, values: AnyArray, fill: float) -> AnyArray:
        """Wrap along speed, put ``fill`` where a training cell does not exist; shape (n_speed + 2 half_speed, n_range + 2 half_range)."""
        n_speed, n_range = self.usable.shape
        hs, hr = self.half_speed, self.half_range
        padded = np.full((n_speed + 2 * hs, self._stride), fill, values.dtype)
        inner = padded[hs : hs + n_speed, hr : hr + n_range]
        np.copyto(inner, values, where=self.usable)
        if hs:
            padded[:hs] = padded[n_speed : n_speed + hs]
            padded[hs + n_speed :] = padded[hs : 2 * hs]
        return padded

    def each(self, padded: AnyArray) -> list[AnyArray]:
        """View of the padded array per training cell; flat, in step with `flat` (one long loop is several times faster than short rows)."""
        flat, length = padded.ravel(), self.usable.shape[0] * self._stride - 2 * self.half_range
        start = self.half_speed * self._stride + self.half_range
        return [flat[start + s : start + s + length] for s in self.shifts.tolist()]

    def flat(self, values: AnyArray) -> AnyArray:
        """Per-cell values in the layout of `each`, shape (n_speed * stride - 2 half_range,)."""
        n_range, hr = self.usable.shape[1], self.half_range
        wide = np.zeros((self.usable.shape[0], self._stride), values.dtype)
        wide[:, hr : hr + n_range] = values
        result: AnyArray = wide.ravel()[hr : wide.size - hr]
        return result

    def unflat(self, flat: AnyArray) -> AnyArray:
        """Undo `flat`; shape (n_speed, n_range)."""
        wide = np.empty((self.usable.shape[0], self._stride), flat.dtype)
        wide.ravel()[self.half_range : wide.size - self.half_range] = flat
        result: AnyArray = wide[:, self.half_range : self.half_range + self.usable.shape[1]]
        return result

    def gather(self, padded: AnyArray, cells: Cells) -> AnyArray:
        """Training cells of single cells, shape (n_cells, n_offsets)."""
        centre = (cells[0] + self.half_speed) * self._stride + cells[1] + self.half_range
        result: AnyArray = padded.ravel()[centre[:, None] + self.shifts]
        return result

    def patterns(self) -> tuple[NDArray[np.bool_], NDArray[np.intp]]:
        """Group the cells by which of their training cells exist.

        Returns
        -------
        tuple of (ndarray of bool, ndarray of intp)
            Existing training cells, shape (n_patterns, n_offsets); pattern of every cell, shape (n_speed, n_range).
        """
        padded = self.pad(self.usable, False)
        key = np.zeros(self.usable.shape)
        for weight, exists in zip(np.random.default_rng(0).random(len(self.offsets)), self.each(padded), strict=True):
            key += weight * self.unflat(exists)
        _, first, index = np.unique(key, return_index=True, return_inverse=True)
        speed_bin, range_bin = np.unravel_index(first, self.usable.shape)
        return self.gather(padded, (speed_bin, range_bin)).astype(np.bool_), index.reshape(self.usable.shape)


class Detector(Protocol):
    """A CFAR algorithm."""

    def detect(self, power: FloatMap) -> NDArray[np.bool_]:
        """Mask of the cells above their threshold, shape (n_speed, n_range)."""

    def noise(self, power: FloatMap, cells: Cells) -> FloatMap:
        """Estimated noise power at single cells, shape (n_cells,)."""


class OrderedStatistic:
    """Ordered-statistic CFAR (Rohling 1983), as a rank test without sorting.

    P > a x_(k) holds exactly when at least k training cells x have a x < P, so counting comparisons decides.

    Parameters
    ----------
    config : CfarConfig
        Rank and wanted false-alarm probability.
    window : TrainingWindow
        Training cells.
    correlation : ndarray, shape (n_offsets, n_offsets)
        Squared correlation coefficient of the noise between training cells.
    n_channel : int
        Number of integrated channels.
    """

    def __init__(self, config: CfarConfig, window: TrainingWindow, correlation: NDArray[np.float64], n_channel: int) -> None:
        self._window = window
        exists, pattern = window.patterns()
        n = exists.sum(axis=1).astype(np.float64)
        judged = n >= MIN_TRAINING
        rank = np.clip(np.round(config.rank * n), 1, np.maximum(n, 1))
        quantile = config.rank
        events = thresholds.indicator_covariance(correlation, quantile, n_channel)
        effective = effective_number(exists, events)
        factor, level = np.full(len(n), np.inf), np.ones(len(n))
        factor[judged], level[judged] = thresholds.os_factor(config.false_alarm, rank[judged], n[judged], effective[judged], n_channel)
        usable = window.usable & judged[pattern]
        self._reciprocal = np.where(usable, (1.0 / factor)[pattern], 0.0).astype(np.float32)
        self._rank = np.where(usable, rank[pattern], len(window.shifts) + 1).astype(np.uint16)
        self._level = level[pattern].astype(np.float32)
        self.factor = factor[pattern]

    def detect(self, power: FloatMap) -> NDArray[np.bool_]:
        """Mask of the cells above their threshold, shape (n_speed, n_range)."""
        window = self._window
        threshold = window.flat(power * self._reciprocal)
        count = np.zeros(threshold.shape, np.uint8 if len(window.shifts) < 256 else np.uint16)
        below = np.empty(threshold.shape, np.bool_)
        as_number = below.view(np.uint8)
        for training in window.each(window.pad(power, np.inf)):
            np.less(training, threshold, out=below)
            np.add(count, as_number, out=count)
        return np.asarray(window.unflat(count) >= self._rank)

    def noise(self, power: FloatMap, cells: Cells) -> FloatMap:
        """Estimated noise power at single cells, shape (n_cells,)."""
        training = np.sort(self._window.gather(self._window.pad(power, np.inf), cells), axis=1)
        rank = self._rank[cells].astype(np.intp)
        return np.asarray(training[np.arange(len(rank)), rank - 1] / self._level[cells], np.float32)


class CellAverage:
    """Cell-averaging CFAR; parameters as `OrderedStatistic`."""

    def __init__(self, config: CfarConfig, window: TrainingWindow, correlation: NDArray[np.float64], n_channel: int) -> None:
        self._window = window
        exists, pattern = window.patterns()
        n = exists.sum(axis=1)
        factor = np.where(
            n >= MIN_TRAINING, thresholds.ca_factor(config.false_alarm, effective_number(exists, correlation), n_channel), np.inf
        )
        self._mean_of_sum = (1.0 / np.maximum(n, 1)).astype(np.float32)[pattern]
        self.factor = np.where(window.usable, factor[pattern], np.inf)
        self._judged = np.isfinite(self.factor)
        self._factor = np.where(self._judged, self.factor, 1.0).astype(np.float32)

    def _noise(self, power: FloatMap) -> FloatMap:
        # Direct sums: running sums lose everything beside one strong cell in float32.
        views = self._window.each(self._window.pad(power, 0.0))
        total = np.zeros(views[0].shape, np.float32)
        for training in views:
            total += training
        return np.asarray(self._window.unflat(total) * self._mean_of_sum, np.float32)

    def detect(self, power: FloatMap) -> NDArray[np.bool_]:
        """Mask of the cells above their threshold, shape (n_speed, n_range)."""
        noise = self._noise(power)
        return np.asarray((power > self._factor * noise) & (noise > 0) & self._judged)

    def noise(self, power: FloatMap, cells: Cells) -> FloatMap:
        """Estimated noise power at single cells, shape (n_cells,)."""
        training = self._window.gather(self._window.pad(power, 0.0), cells)
        return np.asarray(training.sum(axis=1, dtype=np.float32) * self._mean_of_sum[cells])


ALGORITHMS: dict[str, type[OrderedStatistic] | type[CellAverage]] = {"os": OrderedStatistic, "ca": CellAverage}


def effective_number(exists: NDArray[np.bool_], correlation: NDArray[np.float64]) -> NDArray[np.float64]:
    """Count the independent cells whose mean varies as much as that of the correlated ones.

    Parameters
    ----------
    exists : ndarray of bool, shape (n_patterns, n_offsets)
        Training cells that exist.
    correlation : ndarray, shape (n_offsets, n_offsets)
        Correlation coefficients of what is averaged.

    Returns
    -------
    ndarray, shape (n_patterns,)
        Effective number, between 1 and the number of cells.
    """
    member = exists.astype(np.float64)
    total = np.einsum("pi,ij,pj->p", member, correlation, member, optimize=True)
    n = member.sum(axis=1)
    return np.asarray(np.where(n > 0, n**2 / np.maximum(total, 1e-9), 1.0), np.float64)


def make_detector(
    config: CfarConfig,
    usable: NDArray[np.bool_],
    correlation: tuple[NDArray[np.complex128], NDArray[np.complex128]],
    n_channel: int,
) -> Detector:
    """Make the CFAR algorithm that the configuration names.

    Parameters
    ----------
    config : CfarConfig
        Algorithm and its settings.
    usable : ndarray of bool, shape (n_speed, n_range)
        False where the coupling is suppressed.
    correlation : tuple of ndarray, shapes (n_speed,) and (n_range,)
        Correlation coefficients of the noise over the distance in cells (`windows.noise_correlation`), per axis.
    n_channel : int
        Number of integrated channels.

    Raises
    ------
    ConfigError
        When the frame is too small for any cell to have enough training cells.
    """
    window = TrainingWindow(config, usable)
    exists = window.patterns()[0] if len(window.offsets) else np.zeros((1, 0), np.bool_)
    if exists.sum(axis=1).max() < MIN_TRAINING:
        raise ConfigError(
            f"a spectrum of {usable.shape[0]} x {usable.shape[1]} cells (speed x range) leaves no cell {MIN_TRAINING} training cells; "
            "lower cfar.guard_*, raise cfar.training_*, shrink the coupling region, or use more samples and chirps"
        )
    lag = window.offsets[:, None, :] - window.offsets[None, :, :]
    squared = np.abs(correlation[0][lag[..., 0] % usable.shape[0]] * correlation[1][lag[..., 1] % usable.shape[1]]) ** 2
    return ALGORITHMS[config.algorithm](config, window, np.minimum(squared, 1.0), n_channel)
