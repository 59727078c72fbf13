"""Direction of arrival from the phases between the virtual channels (thesis, 2.3, 2.16 and figure A.15)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import get_args

import numpy as np
from numpy.typing import NDArray

from radar_core import ConfigError, DataError, RadarInfo
from radar_core.checks import require_finite
from radar_dsp.config import Backend, DoaConfig
from radar_dsp.doa_kernels import locate
from radar_dsp.steering import make_steering, resolve_mode

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Directions:
    """Directions of n_out echoes; float64 arrays of shape (n_out,), NaN where not measured.

    Attributes
    ----------
    azimuth, elevation, azimuth_std, elevation_std : ndarray
        Direction in the sensor frame and its Cramer-Rao bounds [rad].
    inside : ndarray of bool, shape (n_out,)
        Within the array's field of view; true where the mode measures nothing, false where the snapshot was all zeros.
    source : ndarray of intp, shape (n_out,)
        Index of the snapshot that each echo came from, ascending; only the two-source mode gives one index twice, the stronger echo first.
    """

    azimuth: FloatArray
    elevation: FloatArray
    azimuth_std: FloatArray
    elevation_std: FloatArray
    inside: NDArray[np.bool_]
    source: NDArray[np.intp]


class DirectionFinder:
    """Directions of the echoes in detected cells.

    ``dml``: maximum of the likelihood |a(u)^H v|^2 / |a|^2 of (2.16) over the calibrated steering vectors, by a coarse grid and Newton's
    method, or on a grid alone. ``dml2``: two echoes where they fit clearly better, see `radar_dsp.two_sources`. ``capon``: maximum of 1 /
    (a^H R^-1 a) with the diagonally loaded covariance R of the snapshots (Capon, Proc. IEEE 57, 1969); the same direction as ``dml`` when
    there is one snapshot.

    Parameters
    ----------
    config : DoaConfig
        Mode, method, search.
    info : RadarInfo
        The radar. A `ConfigError` says that its array cannot measure what the mode or the method asks for, or that the back end is unknown.
    backend : str
        ``numba`` or ``numpy``: who runs the inner loops.

    Attributes
    ----------
    mode : str
        ``azimuth_elevation``, ``azimuth``, ``elevation`` or ``void``.
    neighbours : bool
        Whether the cells around a detection should come along as snapshots.
    steering : Steering or None
        The calibrated array; None in mode void. For kernels that call `radar_dsp.doa_kernels.locate` themselves.
    steps : int
        Newton steps.
    """

    def __init__(self, config: DoaConfig, info: RadarInfo, backend: Backend = "numba") -> None:
        if backend not in get_args(Backend):
            raise ConfigError(f"backend is {backend!r}, choose one of {', '.join(get_args(Backend))}")
        self.mode = resolve_mode(config.mode, info.array.virtual, info.waveform.wavelength)
        self.neighbours = config.method == "capon" and self.mode != "void"
        self.steps = config.newton_steps if config.search == "newton" else 0
        self.steering = None if self.mode == "void" else make_steering(config, info, self.mode)
        self._method, self._loading, self._backend = config.method, config.loading, backend
        self._n_channel = info.array.n_tx * info.array.n_rx
        if config.method == "dml2" and self.steering is not None:
            from radar_dsp.two_sources import TwoSources  # as the others below, loaded only where it is chosen

            self._pairs = TwoSources(config, info, self.mode, self.steering)

    def process(self, snapshot: NDArray[np.complex64], snr: NDArray[np.floating]) -> Directions:
        """Estimate directions and their bounds (of one snapshot).

        Parameters
        ----------
        snapshot : ndarray of complex64, shape (n_points, n_channel) or (n_points, n_snapshot, n_channel)
            Spectrum of the virtual channels at each detection, motion compensated. ``dml`` sums the likelihoods of several snapshots,
            ``capon`` makes its covariance of them. A `DataError` says that one is not finite, or that the shapes do not fit.
        snr : ndarray, shape (n_points,)
            Signal-to-noise power ratio per channel.
        """
        n = len(snapshot)
        if snapshot.ndim not in (2, 3) or snapshot.shape[-1] != self._n_channel or len(snr) != n:
            raise DataError(
                f"snapshot has shape {snapshot.shape} and snr {snr.shape}; expected (n_points, {self._n_channel}) or "
                f"(n_points, n_snapshot, {self._n_channel}) and (n_points,)"
            )
        require_finite("snapshot", snapshot)  # comparisons with NaN would make a direction of it
        if self.steering is None or n == 0:
            nan = np.full(n, np.nan)
            return Directions(nan, nan, nan, nan, np.ones(n, np.bool_), np.arange(n))
        if snapshot.ndim == 2:
            snapshot = snapshot[:, None, :]
        angles, inside, source = self._locate(snapshot, snr)
        return Directions(angles[0], angles[1], angles[2], angles[3], inside, source)

    def _locate(self, snapshot: NDArray[np.complex64], snr: NDArray[np.floating]) -> tuple[FloatArray, NDArray[np.bool_], NDArray[np.intp]]:
        assert self.steering is not None
        n = len(snapshot)
        if self._method == "dml2":
            return self._pairs.process(snapshot, snr)
        if self._backend == "numpy":
            from radar_dsp import doa_numpy

            given = snapshot, snr, self.steering, self.steps
            return *(doa_numpy.capon(*given, self._loading) if self._method == "capon" else doa_numpy.locate(*given)), np.arange(n)
        angles, inside = np.empty((4, n)), np.empty(n, np.bool_)
        if self._method == "capon":
            from radar_dsp.capon_kernels import locate_capon

            locate_capon(snapshot, snr, self.steering, self.steps, self._loading, angles, inside)
        else:
            locate(snapshot, snr, self.steering, self.steps, angles, inside)
        return angles, inside, np.arange(n)
