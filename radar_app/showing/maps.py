"""Maps over time of what a bag measured: range rate and range of every frame, or of every cloud's points."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Final

import numpy as np
from numpy.typing import NDArray

from radar_app.showing.results import Results
from radar_core import PointCloud, RadarFrame, RadarInfo
from radar_core.types import Float64Array
from radar_lab.spectra import Observer, Scale, scale_of

_COLUMNS: Final = 1200  # about the pixels that a map is wide
_SOME: Final = 9  # frames that the colours are found from
_HOLE: Final = 3  # columns; a longer gap stays empty
_WEAKEST: Final = 5.0  # dB SNR


@dataclass(frozen=True, eq=False)
class TimeMap:
    """Values over time, rows upwards.

    Attributes
    ----------
    values : ndarray of float64, shape (n_rows, n_columns)
        Levels [dB]; NaN where nothing was measured.
    extent : tuple of float
        First and last time [s], lowest and highest value of the rows.
    """

    values: Float64Array
    extent: tuple[float, float, float, float]


@dataclass(frozen=True, eq=False)
class Maps:
    """Micro-Doppler [m/s] and range [m] over time, what their colours mean, and of which radar they are."""

    micro_doppler: TimeMap
    distance: TimeMap
    scale: Scale
    level: str
    info: RadarInfo


def time_maps(results: Results) -> Maps | None:
    """Make the maps of a bag: of its raw frames, else of its clouds; None: it has neither."""
    source = results.first("radar/frame") or results.first("radar/points")
    if not source:
        return None
    info = results.info(source)
    observer = Observer(info) if results.first("radar/frame") else None
    w = info.waveform
    times, rates, ranges, some = [], [], [], []
    pick = max(results.topics[source] // _SOME, 1)
    for k, item in enumerate(results.measured(source)):
        times.append((item.stamp_ns - results.start_ns) * 1e-9)
        if observer is not None and isinstance(item, RadarFrame):
            level = observer.process(item)
            rates.append(observer.echoes(level).max(axis=1))
            ranges.append(level.max(axis=0))
            if k % pick == 0:
                some.append(level)
        elif isinstance(item, PointCloud):
            rates.append(_cells(item.radial_speed, item.snr, -w.max_speed, w.max_speed, max(w.n_chirp, 2)))
            ranges.append(_cells(item.range, item.snr, 0.0, w.max_range, max(w.n_sample, 2)))
    if not times:
        return None
    if observer is not None:
        near, far, slow, fast = observer.extent
        scale, level_name = scale_of(some, observer), "power [dB]"
    else:
        near, far, slow, fast = 0.0, w.max_range, -w.max_speed, w.max_speed
        top = np.nanmax([np.nanmax(row, initial=_WEAKEST) for row in ranges])
        scale, level_name = Scale(_WEAKEST, max(float(top), _WEAKEST + 1.0)), "SNR of points [dB]"
    return Maps(_map(times, rates, slow, fast), _map(times, ranges, near, far), scale, level_name, info)


def _cells(values: NDArray[np.floating], snr: NDArray[np.floating], low: float, high: float, n: int) -> NDArray[np.floating]:
    """Keep the strongest point of every cell; NaN: none."""
    cells = np.floor((values - low) / (high - low) * n)
    result = np.full(n, np.nan)
    for cell, level in zip(cells.tolist(), np.where(np.isfinite(snr), snr, _WEAKEST).tolist(), strict=True):
        if 0 <= cell < n:  # NaN is neither
            result[int(cell)] = np.fmax(result[int(cell)], level)
    return result


def _map(times: Sequence[float], rows: Sequence[NDArray[np.floating]], low: float, high: float) -> TimeMap:
    """Put rows into columns by their time; the strongest of a column counts, and small holes take what was before."""
    begin, end = times[0], max(times[-1], times[0] + 1e-3)
    n = min(max(len(times) * 2 // 3, 1), _COLUMNS)
    columns = np.minimum(((np.array(times) - begin) / (end - begin) * n).astype(int), n - 1)
    values = np.full((len(rows[0]), n), np.nan)
    for column, row in zip(columns.tolist(), rows, strict=True):
        values[:, column] = np.fmax(values[:, column], row)
    for left, right in pairwise(np.unique(columns).tolist()):
        if right - left <= _HOLE:
            values[:, left + 1 : right] = values[:, [left]]
    return TimeMap(values, (begin, end, low, high))
