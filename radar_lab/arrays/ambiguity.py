"""Ambiguity function of an array (thesis, 3.2, figures 3.4 and 3.5): unambiguous field of view and beamwidth."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from radar_core import AntennaArray, ConfigError
from radar_core.config import config, knob
from radar_core.types import BoolArray, Float64Array
from radar_lab.figures import new_figure, save_figure
from radar_sim.turntable import AXES


@config
class AmbiguityConfig:
    """Grid and limits of the ambiguity function."""

    extent: float = knob(np.radians(90.0), unit="rad", low=0.02, high=np.pi / 2, doc="directions from minus to plus this")
    n_angle: int = knob(361, low=21, high=4001, doc="points of the grid; odd: the boresight is one of them")
    threshold: float = knob(0.9, low=0.05, high=1.0, doc="a side lobe that reaches this share of the main lobe's amplitude is ambiguous")

    def validate(self) -> None:
        """Raise `ConfigError` when the grid misses the boresight."""
        if self.n_angle % 2 == 0:
            raise ConfigError(f"AmbiguityConfig.n_angle is {self.n_angle}; make it odd, so that 0 is on the grid")


@dataclass(frozen=True, eq=False)
class Ambiguity:
    """Ambiguity function along one axis, the other angle being 0."""

    axis: str  # ``azimuth`` or ``elevation``
    angle: Float64Array  # grid, ascending, shape (n_angle,) [rad]
    chi: Float64Array  # abs(chi) of (3.2), 0 to 1; symmetric; shape (n_angle, n_angle)
    # Half width of the largest symmetric interval in which no side lobe reaches the threshold [rad]; 0: the array does not measure this
    # angle
    unambiguous: float
    side_lobe: float  # highest side lobe between directions of the array's field of view; 0: none
    beamwidth: float  # width of abs(chi)^2 = 1/2 around the boresight [rad] (3 dB); NaN where it does not fall that far within the grid


def ambiguity(array: AntennaArray, wavelength: float, axis: str, config: AmbiguityConfig | None = None) -> Ambiguity:
    """Compute the ambiguity function of an array, calibration included.

    Parameters
    ----------
    array : AntennaArray
        The array.
    wavelength : float
        Wavelength [m].
    axis : str
        ``azimuth`` (at elevation 0) or ``elevation`` (at azimuth 0); another raises `ConfigError`.
    config : AmbiguityConfig or None
        Grid and threshold.
    """
    if axis not in AXES:
        raise ConfigError(f"ambiguity has no axis {axis!r}; choose one of {', '.join(AXES)}")
    config = config or AmbiguityConfig()
    angle = np.linspace(-config.extent, config.extent, config.n_angle)
    angle[config.n_angle // 2] = 0.0
    zero = np.zeros_like(angle)
    vectors = array.steering(angle, zero, wavelength) if axis == "azimuth" else array.steering(zero, angle, wavelength)
    vectors = vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)
    chi = np.abs(vectors.conj() @ vectors.T)
    side = np.where(_main_lobe(chi), 0.0, chi)
    view = (array.fov_azimuth if axis == "azimuth" else array.fov_elevation) / 2
    inside = np.abs(angle) <= view + 1e-9
    side_lobe = float(side[np.ix_(inside, inside)].max())
    flat = float(chi.min()) > 1 - 1e-9
    unambiguous = 0.0 if flat else _unambiguous(angle, side, config.threshold)
    return Ambiguity(axis, angle, chi, unambiguous, side_lobe, _beamwidth(angle, chi))


def _main_lobe(chi: Float64Array) -> BoolArray:
    """Cells between the first minima on both sides of the diagonal; rows are directions."""
    n = len(chi)
    lobe = np.eye(n, dtype=bool)
    for sign in (1, -1):
        # Column k of `away` is the cell k steps from the diagonal; beyond the grid nothing rises.
        columns = np.arange(n)[:, None] + sign * np.arange(n)[None, :]
        exists = (columns >= 0) & (columns < n)
        away = np.where(exists, np.take_along_axis(chi, np.clip(columns, 0, n - 1), axis=1), -1.0)
        rises = np.diff(away, axis=1) > 1e-9
        falling = exists & (np.cumsum(np.pad(rises, ((0, 0), (1, 0))), axis=1) == 0)
        rows, steps = np.nonzero(falling)
        lobe[rows, rows + sign * steps] = True
    return lobe


def _unambiguous(angle: Float64Array, side: Float64Array, threshold: float) -> float:
    """Largest a such that no pair of directions within [-a, a] has a side lobe at the threshold."""
    reach = np.maximum(np.abs(angle)[:, None], np.abs(angle)[None, :])
    bad = reach[side >= threshold * (1 - 1e-9)]
    levels = np.abs(angle)
    good = levels if len(bad) == 0 else levels[levels < bad.min() - 1e-12]
    return float(good.max()) if len(good) else 0.0


def _beamwidth(angle: Float64Array, chi: Float64Array) -> float:
    """Width at half power around the boresight, interpolated between grid points."""
    middle = len(angle) // 2
    width = 0.0
    for power, side in ((chi[middle, middle:] ** 2, angle[middle:]), (chi[middle, middle::-1] ** 2, angle[middle::-1])):
        below = np.flatnonzero(power < 0.5)
        if len(below) == 0:
            return float("nan")
        i = int(below[0])
        share = (power[i - 1] - 0.5) / (power[i - 1] - power[i])
        width += float(abs(side[i - 1] + share * (side[i] - side[i - 1])))
    return width


def plot(array: AntennaArray, wavelength: float, path: str | Path, config: AmbiguityConfig | None = None) -> tuple[Ambiguity, Ambiguity]:
    """Draw the ambiguity functions in azimuth and elevation, which are returned, side by side, like figures 3.4 and 3.5.

    Parameters
    ----------
    array, wavelength, config
        See `ambiguity`.
    path : str or Path
        Picture; the ending says which kind, e.g. .png or .pdf. `DataError` is raised when it cannot be written.
    """
    config = config or AmbiguityConfig()
    both = ambiguity(array, wavelength, "azimuth", config), ambiguity(array, wavelength, "elevation", config)
    figure = new_figure(11.0, 4.6, 120)
    for ax, item in zip(figure.subplots(1, 2), both, strict=True):
        degrees = np.degrees(item.angle)
        extent = (degrees[0], degrees[-1]) * 2
        image = ax.imshow(item.chi, origin="lower", extent=extent, vmin=0, vmax=1, cmap="viridis")
        limit = np.degrees(item.unambiguous)
        ax.plot([-limit, limit, limit, -limit, -limit], [-limit, -limit, limit, limit, -limit], color="white", linewidth=1, linestyle="--")
        ax.set(xlabel=f"{item.axis} j (degrees)", ylabel=f"{item.axis} i (degrees)")
        width = "no 3 dB beamwidth" if np.isnan(item.beamwidth) else f"3 dB beamwidth {np.degrees(item.beamwidth):.1f}°"
        ax.set_title(f"{item.axis}: side lobes below {config.threshold:g} within ±{limit:.0f}°, {width}", fontsize=9)
        figure.colorbar(image, ax=ax, label="|χ|")
    save_figure(figure, path)
    return both
