"""Two echoes in one cell: deterministic maximum likelihood for two sources, and when to believe it.

The likelihood of one source is the power of the snapshot along its steering vector; of two, in the span of both (Ziskind and Wax,
"Maximum likelihood localization of multiple sources by alternating projection", IEEE Trans. ASSP 36, 1988). All pairs of a coarse grid
are tried, then all direction cosines are refined together by Levenberg-Marquardt with the amplitudes eliminated.

Whatever one steering vector cannot explain looks like a second echo: an array with errors that no calibration took out, an extended
body, or, in mode azimuth on an array with several rows, an echo above or below the sensor's height.
"""

from __future__ import annotations

import functools
import math

import numpy as np
from numpy.typing import NDArray

from radar_core import ConfigError, DataError, RadarInfo
from radar_dsp.config import DoaConfig
from radar_dsp.pair_kernels import ALIKE
from radar_dsp.steering import Steering, make_steering
from radar_dsp.two_source_kernels import locate_pairs

Floats = NDArray[np.float64]
Split = tuple[Floats, NDArray[np.bool_], NDArray[np.intp]]
Tables = tuple[NDArray[np.float32], NDArray[np.float32]]
_MAX_GRID = 2048
_TRIALS = 6000


class TwoSources:
    """Directions of one or two echoes per detection.

    Parameters
    ----------
    config : DoaConfig
        Grid and probability of a false split. A `ConfigError` says that the search cannot do it, or that the array has too few channels to
        tell one echo from two.
    info, mode, steering : RadarInfo, str, Steering
        The radar, what it measures, and its array.

    Attributes
    ----------
    threshold : float
        Two echoes are reported where their likelihood exceeds that of one by more than this many noise powers.
    """

    def __init__(self, config: DoaConfig, info: RadarInfo, mode: str, steering: Steering) -> None:
        n, n_grid = len(steering.fold), steering.grid.shape[1]
        if config.search != "newton":
            raise ConfigError(f"doa.method 'dml2' needs doa.search 'newton', not {config.search!r}: on a grid, one echo looks like two")
        if n_grid > _MAX_GRID:
            raise ConfigError(
                f"doa.method 'dml2' tries all pairs of its grid, and {n_grid} points are more than {_MAX_GRID}; lower doa.grid_azimuth and "
                "doa.grid_elevation, or choose 'dml' when the array itself is too large"
            )
        # Real unknowns: two complex amplitudes and two directions; as many as measurements would fit every snapshot.
        unknowns = 8 if steering.two else 6
        if 2 * n <= unknowns:
            raise ConfigError(f"doa.method 'dml2' needs at least {unknowns // 2 + 1} virtual channels, the array has {n}; choose 'dml'")
        self._steering = steering
        self._tables = _pair_tables(steering)
        self.threshold = _threshold(_tail(config, info, mode), config.split)

    def process(self, snapshot: NDArray[np.complex64], snr: NDArray[np.float32]) -> Split:
        """Estimate directions.

        Parameters
        ----------
        snapshot : ndarray of complex64, shape (n_points, 1, n_channel)
            One snapshot per detection; a `DataError` says that there are several.
        snr : ndarray of float32, shape (n_points,)
            Measured signal-to-noise power ratio per channel; the noise power is mean power of the snapshot / (1 + snr).

        Returns
        -------
        angles : ndarray, shape (4, n_out)
            Azimuth, elevation, their standard deviations [rad]: the joint bound of both echoes at the fitted amplitudes.
        inside, source : ndarray of bool and of intp, shape (n_out,)
            Within the field of view; detection that each output belongs to, ascending.
        """
        if snapshot.shape[1] != 1:
            raise DataError(
                f"doa.method 'dml2' takes one snapshot per detection, got {snapshot.shape[1]}; choose 'capon' or 'dml' for more"
            )
        angles, inside, second, _ = _run(snapshot, snr, self._steering, self._tables, self.threshold)
        keep = np.ones(2 * len(second), np.bool_)
        keep[1::2] = second
        slot = np.flatnonzero(keep)
        return angles[:, slot], inside[slot], slot // 2


def _run(
    snapshot: NDArray[np.complex64], snr: NDArray[np.float32], steering: Steering, tables: Tables, threshold: float
) -> tuple[Floats, NDArray[np.bool_], NDArray[np.bool_], Floats]:
    """Run the search with a given threshold, see `radar_dsp.two_source_kernels.locate_pairs` for the results."""
    n = len(snapshot)
    angles, inside, second, statistic = np.full((4, 2 * n), np.nan), np.zeros(2 * n, np.bool_), np.zeros(n, np.bool_), np.zeros(n)
    locate_pairs(snapshot, snr, steering, *tables, threshold, angles, inside, second, statistic)
    return angles, inside, second, statistic


def _pair_tables(steering: Steering) -> Tables:
    """Tables ``gain`` and ``cross`` of `radar_dsp.pair_kernels.best_pair`."""
    table = steering.table[0] + 1j * steering.table[1].astype(np.float64)
    n = len(table)
    g = (steering.weight * table.T) @ table.conj()
    determinant = n * n - np.abs(g) ** 2
    inverse = np.where(determinant > (1 - ALIKE) * n * n, 1 / np.maximum(determinant, 1e-9), 0.0)
    return (n * inverse).astype(np.float32), np.stack([2 * inverse * g.real, 2 * inverse * g.imag]).astype(np.float32)


@functools.lru_cache(maxsize=16)
def _tail(config: DoaConfig, info: RadarInfo, mode: str) -> tuple[float, float]:
    """Fit the upper tail of the statistic without a second echo, P(T > t) = C t^k exp(-t), to simulated quantiles: log C and k.

    The statistic is the maximum over directions of a noise power with an exponential distribution; the form is that of the expected number
    of maxima of such a field above a level, and reaches where simulation cannot. One fit, to single echoes of 20 dB per channel with
    directions uniform in the field of view, serves every signal-to-noise ratio, as the first echo's power drops out.
    """
    steering = make_steering(config, info, mode)
    rng = np.random.default_rng(1)
    u = rng.uniform(-1, 1, (2, _TRIALS)) * np.sin(np.minimum(steering.limit, np.pi / 2))[:, None]
    if not steering.two:
        u = np.stack([u[steering.axes - 1], np.zeros(_TRIALS)])
    a = steering.fold.conj() * np.exp(-1j * (u.T @ steering.phase))
    noise = rng.normal(scale=math.sqrt(0.5), size=(*a.shape, 2)) @ np.array([1, 1j])
    snapshot = (10 * a + noise).astype(np.complex64)
    snr = (np.mean(np.abs(snapshot) ** 2, axis=1) - 1).astype(np.float32)
    statistic = _run(snapshot[:, None], snr, steering, _pair_tables(steering), -1.0)[3]
    chance = np.geomspace(0.3, 20 / len(statistic), 24)
    t = np.quantile(statistic, 1 - chance)
    # Quantiles deep in the tail come from few trials: weigh with the inverse deviation of log P, sqrt(P n).
    weight = np.sqrt(chance / (1 - chance))
    design = np.stack([np.ones_like(t), np.log(t)], axis=1)
    log_c, k = np.linalg.lstsq(design * weight[:, None], (np.log(chance) + t) * weight, rcond=None)[0]
    return float(log_c), float(k)


def _threshold(tail: tuple[float, float], chance: float) -> float:
    """Level that the statistic exceeds with this probability."""
    log_c, k = tail
    low, high = max(k, 1.0), 1e3
    for _ in range(60):
        middle = 0.5 * (low + high)
        above = log_c + k * math.log(middle) - middle > math.log(chance)
        low, high = (middle, high) if above else (low, middle)
    return high
