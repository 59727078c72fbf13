"""Direction of arrival by deterministic maximum likelihood (thesis, 2.3 and 2.16), for one echo per cell."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from radar_core import ConfigError, RadarInfo
from radar_dsp.config import DoaConfig

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Directions:
    """Directions of n points; every array float64, shape (n_points,), NaN where not measured.

    Attributes
    ----------
    azimuth, elevation : ndarray
        Direction in the sensor frame [rad].
    azimuth_std, elevation_std : ndarray
        Cramer-Rao bounds [rad].
    inside : ndarray of bool, shape (n_points,)
        Within the array's field of view; true where nothing is measured.
    """

    azimuth: FloatArray
    elevation: FloatArray
    azimuth_std: FloatArray
    elevation_std: FloatArray
    inside: NDArray[np.bool_]


def resolve_mode(mode: str, virtual: FloatArray, wavelength: float) -> str:
    """Turn ``auto`` into what the array can measure, and refuse what it cannot.

    Parameters
    ----------
    mode : str
        A mode of `DoaConfig`.
    virtual : ndarray, shape (n_channel, 2) = (y, z)
        Virtual elements [m].
    wavelength : float
        Wavelength [m].

    Returns
    -------
    str
        ``azimuth_elevation``, ``azimuth`` or ``void``.

    Raises
    ------
    ConfigError
        When the mode asks for more than the array has elements for.
    """
    scatter = np.atleast_2d(np.cov(virtual.T / wavelength, bias=True))
    # A hundredth of a wavelength of spread is mounting tolerance, not an aperture.
    both = float(np.linalg.eigvalsh(scatter)[0]) > 1e-4 and len(virtual) >= 3
    best = "azimuth_elevation" if both else "azimuth" if scatter[0, 0] > 1e-4 else "void"
    if mode == "auto":
        return best
    order = ("void", "azimuth", "azimuth_elevation")
    if order.index(mode) > order.index(best):
        raise ConfigError(f"doa.mode is {mode!r} but the {len(virtual)} virtual elements can only give {best!r}; choose that or 'auto'")
    return mode


class DirectionFinder:
    """Maximum of |a(u)^H v| (2.16): coarse search over a grid of steering vectors, then Newton's method.

    Works in direction cosines u = (y, z): there the steering phase is linear and the bound is the same everywhere.

    Parameters
    ----------
    config : DoaConfig
        Mode, grid, refinement.
    info : RadarInfo
        The radar.
    """

    def __init__(self, config: DoaConfig, info: RadarInfo) -> None:
        array, wavelength = info.array, info.waveform.wavelength
        self.mode = resolve_mode(config.mode, array.virtual, wavelength)
        self._steps = config.newton_steps
        self._limit = (array.fov_azimuth / 2, array.fov_elevation / 2)
        if self.mode == "void":
            return
        axes = 2 if self.mode == "azimuth_elevation" else 1
        phase = 2 * math.pi / wavelength * (array.virtual - array.virtual.mean(axis=0))[:, :axes]
        self._phase = phase
        self._grid, self._step = _grid(config, self._limit, axes)
        self._steering = np.ascontiguousarray(np.exp(1j * self._grid @ phase.T).T.astype(np.complex64))
        # Columns: value, first and second derivatives of sum_c v_c exp(+j phase_c . u), the conjugate beam former.
        pairs = [(0, 0), (0, 1), (1, 1)] if axes == 2 else [(0, 0)]
        self._derivatives = np.stack([np.ones(len(phase)), *(1j * phase.T), *(-phase[:, i] * phase[:, j] for i, j in pairs)], axis=1)
        # Fisher information of u per unit of signal-to-noise ratio; centred phases take care of the unknown amplitude.
        self._bound = np.linalg.inv(2 * phase.T @ phase)

    def process(self, snapshot: NDArray[np.complex64], snr: NDArray[np.float32]) -> Directions:
        """Estimate the direction of one echo per snapshot.

        Parameters
        ----------
        snapshot : ndarray of complex64, shape (n_points, n_channel)
            Spectrum of the virtual channels at each detection, motion compensated.
        snr : ndarray of float32, shape (n_points,)
            Signal-to-noise power ratio per channel.

        Returns
        -------
        Directions
            Estimates and bounds.
        """
        n = len(snapshot)
        if self.mode == "void" or n == 0:
            nan = np.full(n, np.nan)
            return Directions(nan, nan, nan, nan, np.ones(n, np.bool_))
        u = self._grid[np.argmax(_power(snapshot @ self._steering), axis=1)]
        u = self._refine(snapshot.astype(np.complex128), u)
        return self._to_angles(u, snr.astype(np.float64))

    def _refine(self, snapshot: NDArray[np.complex128], start: FloatArray) -> FloatArray:
        u = start.copy()
        for _ in range(self._steps):
            beam = (snapshot * np.exp(1j * (u @ self._phase.T))) @ self._derivatives
            u = np.clip(u + _newton_step(beam, u.shape[1], self._step), start - self._step, start + self._step)
        return u

    def _to_angles(self, u: FloatArray, snr: FloatArray) -> Directions:
        two = u.shape[1] == 2
        uy, uz = u[:, 0], u[:, 1] if two else np.zeros(len(u))
        visible = uy**2 + uz**2 < 1.0
        sin_el = np.clip(uz, -1.0, 1.0)
        cos_el = np.maximum(np.sqrt(1 - sin_el**2), 1e-9)
        sin_az = np.clip(uy / cos_el, -1.0, 1.0)
        azimuth, elevation = np.arcsin(sin_az), np.arcsin(sin_el)
        slope = np.maximum(cos_el * np.cos(azimuth), 1e-3)
        tilt = sin_az * sin_el / cos_el
        b = self._bound
        spread = b[0, 0] + (2 * tilt * b[0, 1] + tilt**2 * b[1, 1] if two else 0.0)
        azimuth_std = np.sqrt(spread / snr) / slope
        inside = visible & (np.abs(azimuth) <= self._limit[0])
        if not two:
            nan = np.full(len(u), np.nan)
            return Directions(azimuth, nan, azimuth_std, nan, inside)
        elevation_std = np.sqrt(b[1, 1] / snr) / cos_el
        return Directions(azimuth, elevation, azimuth_std, elevation_std, inside & (np.abs(elevation) <= self._limit[1]))


def _grid(config: DoaConfig, limit: tuple[float, float], axes: int) -> tuple[FloatArray, FloatArray]:
    """Direction cosines of the coarse search, shape (n_grid, axes), and their spacing, shape (axes,)."""
    sides = []
    for half, points in zip(limit, (config.grid_azimuth, config.grid_elevation), strict=True):
        # A little beyond the field of view: an echo from outside must find its own direction, to be dropped, not the next best inside.
        edge = min(1.0, math.sin(min(half, math.pi / 2)) + 0.1)
        sides.append(np.linspace(-edge, edge, points))
    sides = sides[:axes]
    mesh = np.stack([m.ravel() for m in np.meshgrid(*sides, indexing="ij")], axis=1)
    return mesh, np.array([side[1] - side[0] for side in sides])


def _power(beam: NDArray[np.complex64]) -> NDArray[np.float32]:
    return beam.real**2 + beam.imag**2


def _newton_step(beam: NDArray[np.complex128], axes: int, limit: FloatArray) -> FloatArray:
    """One step towards the maximum of log |b(u)|^2, shape (n_points, axes); where it is not concave, along the gradient.

    The logarithm of a main lobe is closer to a parabola than the lobe itself, which saves a step.
    """
    b = beam[:, :1].conj()
    first = beam[:, 1 : 1 + axes]
    gradient = (b * first).real
    second = (b * beam[:, 1 + axes :]).real
    power = np.maximum((b * beam[:, :1]).real, np.finfo(np.float64).tiny)
    slope = 2 * gradient / power
    if axes == 1:
        curvature = second[:, :1] + np.abs(first) ** 2 - gradient * slope
        concave = curvature < 0
        newton = -gradient / np.where(concave, curvature, 1.0)
    else:
        yy = second[:, 0] + np.abs(first[:, 0]) ** 2 - gradient[:, 0] * slope[:, 0]
        yz = second[:, 1] + (first[:, 0].conj() * first[:, 1]).real - gradient[:, 0] * slope[:, 1]
        zz = second[:, 2] + np.abs(first[:, 1]) ** 2 - gradient[:, 1] * slope[:, 1]
        determinant = yy * zz - yz**2
        concave = ((yy < 0) & (determinant > 0))[:, None]
        adjugate = np.stack([yz * gradient[:, 1] - zz * gradient[:, 0], yz * gradient[:, 0] - yy * gradient[:, 1]], axis=1)
        newton = adjugate / np.where(concave, determinant[:, None], 1.0)
    return np.clip(np.where(concave, newton, np.sign(gradient) * limit / 2), -limit, limit)
