"""The calibrated array as the direction finder sees it: phases, grids and bounds in direction cosines."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from radar_core import ConfigError, RadarInfo
from radar_dsp.config import DoaConfig

FloatArray = NDArray[np.float64]
AXES = {"azimuth_elevation": 0, "azimuth": 1, "elevation": 2}
_MARGIN = 0.1
"""The search reaches so far beyond the field of view in direction cosine: an echo from outside must find its own direction, to be
dropped, not the next best one inside."""


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
        ``azimuth_elevation``, ``azimuth``, ``elevation`` or ``void``.

    Raises
    ------
    ConfigError
        When the mode asks for more than the array has elements for.
    """
    scatter = np.atleast_2d(np.cov(virtual.T / wavelength, bias=True))
    # A hundredth of a wavelength of spread is mounting tolerance, not an aperture.
    able = {
        "azimuth_elevation": float(np.linalg.eigvalsh(scatter)[0]) > 1e-4 and len(virtual) >= 3,
        "azimuth": bool(scatter[0, 0] > 1e-4),
        "elevation": bool(scatter[1, 1] > 1e-4),
        "void": True,
    }
    best = next(name for name, can in able.items() if can)
    if mode == "auto":
        return best
    if not able[mode]:
        raise ConfigError(f"doa.mode is {mode!r} but the {len(virtual)} virtual elements can only give {best!r}; choose that or 'auto'")
    return mode


@dataclass(frozen=True, eq=False)
class Steering:
    """Steering vectors a_c(u) = response_c exp(-j phase_c . u) over direction cosines u = (y, z), and the grid to search.

    In direction cosines the phase is linear and the bound is the same everywhere. A mode that measures one axis has its phases and
    grid in row 0 and zeros in row 1.

    Attributes
    ----------
    mode : str
        ``azimuth_elevation``, ``azimuth`` or ``elevation``.
    axes : int
        The same as a number: 0, 1 or 2.
    fold : ndarray of complex128, shape (n_channel,)
        conj(response), scaled to a mean square of 1: folded into a snapshot it leaves pure phases to steer, and |a|^2 = n_channel, so
        the likelihood |a^H v|^2 / |a|^2 has its maximum where |a^H v|^2 has.
    phase : ndarray, shape (2, n_channel)
        2 pi position / wavelength about the mean weighted with the power response, where amplitude and direction do not disturb each other.
    grid : ndarray, shape (2, n_grid)
        Direction cosines to search, uniform on each axis.
    spacing : ndarray, shape (2,)
        Of the grid; 0 where not measured.
    table : ndarray of float32, shape (2, n_channel, n_grid)
        Cosines and sines of phase . grid.
    bound : ndarray, shape (3,)
        Cramer-Rao bound on (uy uy, uy uz, uz uz) times the signal-to-noise ratio per channel; one measured axis: (u u, 0, 0).
    limit : ndarray, shape (2,)
        Half the field of view in azimuth and elevation [rad].
    """

    mode: str
    axes: int
    fold: NDArray[np.complex128]
    phase: FloatArray
    grid: FloatArray
    spacing: FloatArray
    table: NDArray[np.float32]
    bound: FloatArray
    limit: FloatArray

    @property
    def two(self) -> bool:
        """Whether both direction cosines are measured."""
        return self.axes == 0

    @property
    def arguments(
        self,
    ) -> tuple[NDArray[np.complex128], FloatArray, NDArray[np.float32], FloatArray, FloatArray, FloatArray, FloatArray, int]:
        """Everything the kernels of `radar_dsp.doa_kernels` need, in their order."""
        return self.fold, self.phase, self.table, self.grid, self.spacing, self.bound, self.limit, self.axes

    @property
    def weight(self) -> FloatArray:
        """Power response of each channel, mean 1, shape (n_channel,)."""
        return np.abs(self.fold) ** 2


def make_steering(config: DoaConfig, info: RadarInfo, mode: str) -> Steering:
    """Prepare an array for the search.

    Parameters
    ----------
    config : DoaConfig
        Method, search and grid. Before a refinement, the grid gets at least two points per wavelength over aperture, else the refinement
        would start on side lobes; five for two sources, whose likelihood has more ridges than a beam has lobes.
    info : RadarInfo
        The radar; the calibration of its array (shifts, gains, phases) is in.
    mode : str
        A resolved mode that is not void.

    Returns
    -------
    Steering
        The model.
    """
    array = info.array
    response = array.response
    fold = response.conj() / math.sqrt(float(np.mean(np.abs(response) ** 2)))
    weight = np.abs(fold) ** 2
    position = array.virtual.T / info.waveform.wavelength
    phase = 2 * math.pi * (position - (position @ weight / weight.sum())[:, None])
    limit = np.array([array.fov_azimuth / 2, array.fov_elevation / 2])
    used = {"azimuth_elevation": [0, 1], "azimuth": [0], "elevation": [1]}[mode]
    sides = []
    for axis in used:
        edge = min(1.0, math.sin(min(limit[axis], math.pi / 2)) + _MARGIN)
        points = (config.grid_azimuth, config.grid_elevation)[axis]
        if config.search == "newton":
            density, least = (10, 7) if config.method == "dml2" else (4, 2)
            points = max(points, least, math.ceil(density * edge * float(np.ptp(position[axis]))) + 1)
        sides.append(np.linspace(-edge, edge, points))
    phase, spacing, bound = phase[used], np.array([side[1] - side[0] for side in sides]), np.zeros(3)
    grid = np.stack([axis.ravel() for axis in np.meshgrid(*sides, indexing="ij")])
    information = 2 * (phase * weight) @ phase.T
    if len(used) == 2:
        bound[:] = np.linalg.inv(information)[[0, 0, 1], [0, 1, 1]]
    else:
        bound[0] = 1 / information[0, 0]
        phase, grid, spacing = (np.concatenate([x, np.zeros_like(x)]) for x in (phase, grid, spacing))
    angle = phase.T @ grid
    table = np.stack([np.cos(angle), np.sin(angle)]).astype(np.float32)
    return Steering(mode, AXES[mode], fold, np.ascontiguousarray(phase), grid, spacing, table, bound, limit)
