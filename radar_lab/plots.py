"""Plots of what a radar sees, with units and colours that colour-blind people tell apart; for notebooks, reports and `handwave show`."""

from __future__ import annotations

from collections.abc import Iterable
from itertools import pairwise
from typing import TYPE_CHECKING, Final

import numpy as np
from numpy.typing import NDArray

from radar_core import ConfigError, DataError, PointCloud, RadarFrame, RadarInfo
from radar_core.types import Float64Array
from radar_lab.spectra import Observer, Scale, scale_of

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.image import AxesImage

PEOPLE: Final[tuple[str, ...]] = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9")
"""Colours of people, one after the other and again from the first (Okabe and Ito, 2008); a number beside them says the same."""

HEAT: Final = "magma"
"""Colours of levels: ever brighter, for everybody."""

_SOME: Final = 9  # maps that the colours are found from
_WEAKEST: Final = 5.0  # dB: of points; what is weaker is hardly a point
_GAP: Final = 5  # times the usual interval between frames; over a longer one nothing is drawn


def plot_range_doppler(frame: RadarFrame, info: RadarInfo | None = None, ax: Axes | None = None) -> Axes:
    """Plot the range-Doppler map of one frame: power over distance and range rate, all channels added without phase.

    Parameters
    ----------
    frame : RadarFrame
        Raw samples of one frame.
    info : RadarInfo or None
        Radar that measured it; None: the default one, if the frame has its shape.
    ax : matplotlib.axes.Axes or None
        Where to draw; None: into a new figure.

    Returns
    -------
    matplotlib.axes.Axes
        Range [m] across, range rate [m/s] up (positive: going away), power [dB] as colour. Its figure is saved with
        ``ax.figure.savefig("map.png")``.

    Raises
    ------
    ConfigError
        When the frame has another shape than the radar's frames.
    """
    radar = _radar(frame, info)
    observer = Observer(radar)
    level = observer.process(frame)
    ax = ax if ax is not None else _axes()
    image = _show(ax, level, observer.extent, scale_of([level], observer))
    ax.set(title=f"range-Doppler map of frame {frame.sequence}", xlabel="range [m]", ylabel="range rate [m/s], positive: going away")
    _bar(ax, image, "power [dB]")
    return ax


def plot_micro_doppler(measured: Iterable[RadarFrame | PointCloud], info: RadarInfo | None = None, ax: Axes | None = None) -> Axes:
    """Plot the micro-Doppler: for every moment and range rate the strongest range (thesis, section 4.2).

    Parameters
    ----------
    measured : iterable of RadarFrame or of PointCloud
        Raw frames, or points that were detected in them, in the order of time.
    info : RadarInfo or None
        Radar that measured them; None: the default one.
    ax : matplotlib.axes.Axes or None
        Where to draw; None: into a new figure.

    Returns
    -------
    matplotlib.axes.Axes
        Time since the first one [s] across, range rate [m/s] up (positive: going away); as colour the power [dB], of points their SNR [dB].

    Raises
    ------
    ConfigError
        When frames have another shape than the radar's.
    DataError
        When there is nothing to plot.
    """
    items: list[RadarFrame | PointCloud] = list(measured)
    if not items:
        raise DataError("there are no frames and no clouds to plot")
    times = np.array([item.stamp_ns - items[0].stamp_ns for item in items], np.float64) * 1e-9
    ax = ax if ax is not None else _axes()
    frames = [item for item in items if isinstance(item, RadarFrame)]
    if frames:
        observer = Observer(_radar(frames[0], info))
        levels, scale = _strongest(frames, observer)
        extent, name = observer.extent[2:], "power [dB]"
    else:
        clouds = [item for item in items if isinstance(item, PointCloud)]
        levels, extent = _gates(clouds, info or RadarInfo())
        top = float(np.nanmax(levels)) if np.isfinite(levels).any() else _WEAKEST
        scale, name = Scale(_WEAKEST, max(top, _WEAKEST + 1.0)), "SNR of points [dB]"
    step = float(np.median(np.diff(times))) if len(times) > 1 else 1.0
    grid = _evenly(levels, times, step)
    image = _show(ax, grid, (0.0, grid.shape[1] * step, *extent), scale)
    ax.set(title="micro-Doppler", xlabel="time [s]", ylabel="range rate [m/s], positive: going away")
    _bar(ax, image, name)
    return ax


def _radar(frame: RadarFrame, info: RadarInfo | None) -> RadarInfo:
    radar = info or RadarInfo()
    if frame.cube.shape != radar.cube_shape:
        whose = "the radar's" if info else "those of the default radar; give its RadarInfo"
        raise ConfigError(f"the frame has the shape {frame.cube.shape}, {whose} {radar.cube_shape}")
    return radar


def _strongest(frames: list[RadarFrame], observer: Observer) -> tuple[Float64Array, Scale]:
    """Keep of every frame the strongest range for each range rate, shape (n_speed, n_frames); and find the colours."""
    some = set(np.unique(np.linspace(0, len(frames) - 1, _SOME).astype(int)).tolist())
    columns, maps = [], []
    for k, frame in enumerate(frames):
        level = observer.process(frame)
        columns.append(observer.echoes(level).max(axis=1))
        if k in some:
            maps.append(level)
    return np.stack(columns, axis=1).astype(np.float64), scale_of(maps, observer)


def _gates(clouds: list[PointCloud], info: RadarInfo) -> tuple[Float64Array, tuple[float, float]]:
    """Put points into the cells of range rate that the radar has; NaN where there is none."""
    w = info.waveform
    edges = np.linspace(-w.max_speed, w.max_speed, max(w.n_chirp, 2) + 1)
    levels = np.full((len(edges) - 1, len(clouds)), np.nan)
    for k, cloud in enumerate(clouds):
        snr = np.where(np.isfinite(cloud.snr), cloud.snr, _WEAKEST).astype(np.float64)
        cells = np.digitize(cloud.radial_speed, edges) - 1
        for cell, value in zip(cells.tolist(), snr.tolist(), strict=True):
            if 0 <= cell < len(levels):
                levels[cell, k] = np.fmax(levels[cell, k], value)
    return levels, (float(edges[0]), float(edges[-1]))


def _evenly(levels: Float64Array, times: Float64Array, step: float) -> Float64Array:
    """Put columns where they belong in time; each lasts until the next one, unless something is missing between them."""
    if not step > 0:
        return levels
    starts = np.round(times / step).astype(int)
    grid = np.full((levels.shape[0], int(starts[-1]) + 1), np.nan)
    for k, (begin, end) in enumerate(pairwise([*starts.tolist(), int(starts[-1]) + 1])):
        grid[:, begin : end if end - begin < _GAP else begin + 1] = levels[:, [k]]
    return grid


def _axes() -> Axes:
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(8.0, 4.5), dpi=120, layout="constrained")
    FigureCanvasAgg(figure)
    return figure.add_subplot()


def _show(ax: Axes, level: NDArray[np.floating], extent: tuple[float, float, float, float], scale: Scale) -> AxesImage:
    image = ax.imshow(
        level, extent=extent, vmin=scale.low, vmax=scale.high, origin="lower", aspect="auto", interpolation="nearest", cmap=HEAT
    )
    ax.set_facecolor("black")
    return image


def _bar(ax: Axes, image: AxesImage, name: str) -> None:
    figure = ax.get_figure()
    if figure is not None:
        figure.colorbar(image, ax=ax, label=name)
