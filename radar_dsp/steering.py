"""The calibrated array as the direction finder sees it: phases, grids and bounds in direction cosines."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from radar_core import ConfigError, RadarInfo
from radar_dsp.config import DoaConfig

FloatArray = NDArray[np.float64]
_AXES = {"azimuth_elevation": 0, "azimuth": 1, "elevation": 2}
_APERTURE = 1e-4
"""Least spread of the elements that counts as an aperture [wavelength^2]; a hundredth of a wavelength is mounting tolerance."""
_MARGIN = 0.1
"""The search reaches so far beyond the view in direction cosine: an echo from outside must find its own direction, to be dropped, not the
next best one inside."""
_APART = 0.1  # wavelengths: elements nearer to each other along an axis stand in one place, but for calibrated shifts
_HALF_WAVE = 0.525  # wavelengths: up to this spacing an array tells all directions apart, with some tolerance of how it is made
_STEP, _ALIKE = 0.04, 0.9  # direction cosine: differences that are looked at; amplitude of a lobe from which two directions look alike
_TOLD, _SEARCHED = 0.95, 0.975  # direction cosines up to which such an array is used, and searched: at 1 both ends are the same


def apertures(virtual: FloatArray, wavelength: float) -> tuple[bool, bool, bool]:
    """Whether virtual elements, shape (n_channel, 2) = (y, z) [m], spread over a plane, along y, along z."""
    scatter = np.atleast_2d(np.cov(virtual.T / wavelength, bias=True))
    plane = float(np.linalg.eigvalsh(scatter)[0]) > _APERTURE and len(virtual) >= 3
    return plane, bool(scatter[0, 0] > _APERTURE), bool(scatter[1, 1] > _APERTURE)


def resolve_mode(mode: str, virtual: FloatArray, wavelength: float) -> str:
    """Turn ``auto`` into what the array can measure: ``azimuth_elevation``, ``azimuth``, ``elevation`` or ``void``.

    ``mode`` is one of `DoaConfig`, ``virtual`` the virtual elements, shape (n_channel, 2) = (y, z) [m]. A `ConfigError` says that the mode
    asks for more than the array has elements for.
    """
    able = dict(zip(("azimuth_elevation", "azimuth", "elevation", "void"), (*apertures(virtual, wavelength), True), strict=True))
    best = next(name for name, can in able.items() if can)
    if mode == "auto":
        return best
    if not able[mode]:
        raise ConfigError(f"doa.mode is {mode!r} but the {len(virtual)} virtual elements can only give {best!r}; choose that or 'auto'")
    return mode


class Steering(NamedTuple):
    """Steering vectors a_c(u) = response_c exp(-j phase_c . u) over direction cosines u = (y, z), and the grid to search.

    In direction cosines the phase is linear and the bound is the same everywhere. A mode that measures one axis has its phases and grid in
    row 0 and zeros in row 1.

    Attributes
    ----------
    fold : ndarray of complex128, shape (n_channel,)
        conj(response), scaled to a mean square of 1: folded into a snapshot it leaves pure phases to steer, and |a|^2 = n_channel, so the
        likelihood |a^H v|^2 / |a|^2 has its maximum where |a^H v|^2 has.
    phase : ndarray, shape (2, n_channel)
        2 pi position / wavelength about the mean weighted with the power response, where amplitude and direction do not disturb each other.
    table : ndarray of float32, shape (2, n_channel, n_grid)
        Cosines and sines of phase . grid.
    grid : ndarray, shape (2, n_grid)
        Direction cosines to search, uniform on each axis.
    spacing : ndarray, shape (2,)
        Of the grid; 0 where not measured.
    bound : ndarray, shape (3,)
        Cramer-Rao bound on (uy uy, uy uz, uz uz) times the signal-to-noise ratio per channel; one measured axis: (u u, 0, 0).
    limit : ndarray, shape (2,)
        Half the view in azimuth and elevation [rad], see `half_views`.
    axes : int
        What is measured: 0 azimuth and elevation, 1 azimuth, 2 elevation.
    """

    fold: NDArray[np.complex128]
    phase: FloatArray
    table: NDArray[np.float32]
    grid: FloatArray
    spacing: FloatArray
    bound: FloatArray
    limit: FloatArray
    axes: int

    @property
    def two(self) -> bool:
        """Whether both direction cosines are measured."""
        return self.axes == 0

    @property
    def weight(self) -> FloatArray:
        """Power response of each channel, mean 1, shape (n_channel,)."""
        return np.abs(self.fold) ** 2


def half_views(position: FloatArray, field_of_view: FloatArray) -> FloatArray:
    """How far from the boresight directions are kept in azimuth and elevation, shape (2,) [rad].

    Elements half a wavelength apart tell all directions, nearly to the side. The field of view, which is kept at least, is where an antenna
    is strong, and what is near is strong enough beyond it: the hand of somebody 1 m before a radar high on a wall is 40 degrees below its
    boresight. Of elements farther apart, along an axis or on a lattice, echoes from beyond the field of view would seem to come from within
    a wider one.

    Parameters
    ----------
    position : ndarray, shape (2, n_channel)
        Of the virtual elements along both axes [wavelengths].
    field_of_view : ndarray, shape (2,)
        Full field of view in azimuth and elevation [rad].
    """
    half = field_of_view / 2
    wide = np.maximum(half, [math.asin(_TOLD) if _tells_all(own) else 0.0 for own in position])
    flat = bool((np.ptp(position, axis=1) < _APART).any())  # along one axis, `_tells_all` has said everything
    return half if not flat and (wide > half).any() and _alike(position, np.sin(np.minimum(wide, math.pi / 2))) else wide


def _tells_all(position: FloatArray) -> bool:
    """Whether no two directions look alike to elements at these places along an axis, shape (n_channel,) [wavelengths]."""
    ordered = np.sort(position)
    group = np.cumsum(np.diff(ordered, prepend=ordered[:1]) > _APART)
    places = np.bincount(group, ordered) / np.bincount(group)
    return len(places) > 1 and float(np.diff(places).min()) <= _HALF_WAVE


def _alike(position: FloatArray, limit: FloatArray) -> bool:
    """Whether two directions within limits, shape (2,) in direction cosine, look alike: beside its main lobe the beam has one as high."""
    step = [np.arange(-(n := math.ceil(2 * own / _STEP)), n + 1) * (2 * own / max(n, 1)) for own in limit]
    turn = [np.exp(2j * math.pi * np.outer(own, steps)) for own, steps in zip(position, step, strict=True)]
    beam = np.abs(turn[0].T @ turn[1]) / position.shape[1]
    inner = beam[1:-1, 1:-1]
    around = [beam[1 + i : beam.shape[0] - 1 + i, 1 + k : beam.shape[1] - 1 + k] for i in (-1, 0, 1) for k in (-1, 0, 1)]
    apart = np.hypot(*np.meshgrid(step[0][1:-1], step[1][1:-1], indexing="ij"))
    lobe = (inner >= np.max(around, axis=0) - 1e-9) & (inner > _ALIKE) & (apart > _STEP) & (apart < 2.0)
    return bool(lobe.any())


def _edge(limit: float, field_of_view: float) -> float:
    """Direction cosine up to which an axis is searched for directions that are kept up to ``limit`` [rad]."""
    return _SEARCHED if limit > field_of_view / 2 else min(1.0, math.sin(min(limit, math.pi / 2)) + _MARGIN)


def make_steering(config: DoaConfig, info: RadarInfo, mode: str) -> Steering:
    """Prepare an array, its calibration (shifts, gains, phases) included, for the search in a resolved mode that is not void.

    Before a refinement, the grid of ``config`` gets at least two points per wavelength over aperture, else the refinement would start on
    side lobes; five for two sources, whose likelihood has more ridges than a beam has lobes.
    """
    array = info.array
    response = array.response
    fold = response.conj() / math.sqrt(float(np.mean(np.abs(response) ** 2)))
    weight = np.abs(fold) ** 2
    position = array.virtual.T / info.waveform.wavelength
    phase = 2 * math.pi * (position - (position @ weight / weight.sum())[:, None])
    view = np.array([array.fov_azimuth, array.fov_elevation])
    limit = half_views(position, view)
    used = {"azimuth_elevation": [0, 1], "azimuth": [0], "elevation": [1]}[mode]
    sides = []
    for axis in used:
        edge = _edge(limit[axis], view[axis])
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
    return Steering(fold, np.ascontiguousarray(phase), table, grid, spacing, bound, limit, _AXES[mode])
