"""Where transmitters leak into receivers: cells near zero range and speed, as many as the windows' main lobes have, or were measured."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from radar_core import DataError, RadarFrame, RadarInfo
from radar_dsp.config import BasebandConfig, CouplingConfig
from radar_dsp.spectrum import make_spectrum
from radar_dsp.windows import make_window

FloatArray = NDArray[np.float64]

LOBE_DB: Final = -30.0
"""Down to here a window's main lobe counts [dB]: 2.8 cells to either side for ``nuttall``, 1.9 for ``hann``."""
_STEPS: Final = 100  # per cell
_ABOVE: Final = 10.0  # times the noise of a frame: what is weaker hides nothing and is not detected as leakage
_RISE: Final = 1.26  # times the cell before (1 dB): from there on it is another echo
_FEWEST: Final = 4  # frames that are averaged, at least
_MOST: Final = 0.5  # of the ranges and speeds: leakage is never wider


@dataclass(frozen=True)
class Leakage:
    """What was measured of a radar's own leakage.

    Attributes
    ----------
    config : CouplingConfig
        The region to suppress.
    range_extent, speed_extent : float
        How far the leakage reaches [m], [m/s]; 0: none was found.
    level : float
        Its strongest cell over the noise of a frame [dB]; 0: none.
    n_frame : int
        Frames that it was measured with.
    """

    config: CouplingConfig
    range_extent: float
    speed_extent: float
    level: float
    n_frame: int


def lobe(name: str, n: int) -> float:
    """Half the width of a window's main lobe down to `LOBE_DB`, in cells; 1 where the window is too short to have one."""
    if n < 4:
        return 1.0
    power = np.abs(np.fft.rfft(make_window(name, n), _STEPS * n)) ** 2
    below = np.flatnonzero(power < 10 ** (LOBE_DB / 10) * power[0])
    return float(below[0] / _STEPS) if len(below) else n / 2


def coupling_region(config: BasebandConfig, info: RadarInfo) -> NDArray[np.bool_]:
    """Mask of the cells near zero range and zero speed that are suppressed, shape (n_speed, n_range).

    In range and in speed whichever is more of the configured extent and the main lobe of the window.
    """
    waveform, coupling = info.waveform, config.coupling
    if waveform.modulation == "cw":  # one cell for all ranges: suppressing its slow speeds would take people, not coupling
        return np.zeros((waveform.n_chirp, 1), np.bool_)
    if coupling.range_extent == 0.0:
        return np.zeros((waveform.n_chirp, waveform.n_sample), np.bool_)
    cell = np.arange(waveform.n_sample)
    distance = cell * waveform.range_resolution
    turn = np.abs(np.fft.fftfreq(waveform.n_chirp))
    near = (distance < coupling.range_extent) | (cell < lobe(config.spectrum.range_window, waveform.n_sample))
    slow = (turn * 2 * waveform.max_speed <= coupling.speed_extent) | (
        turn * waveform.n_chirp < lobe(config.spectrum.speed_window, waveform.n_chirp)
    )
    return np.asarray(slow[:, None] & near[None, :])


def measure_leakage(frames: Iterable[RadarFrame], config: BasebandConfig, info: RadarInfo) -> Leakage:
    """Find how far a radar's leakage reaches, from some seconds of a room that is empty nearby.

    Leakage is the same in every frame, so the mean of the frames keeps it and loses noise and what moves. It begins at zero range and falls
    from there: the first cell that rises again, or lies below the noise, is no longer it.

    Parameters
    ----------
    frames : iterable of RadarFrame
        At least four; those with lost chirps do not count.
    config : BasebandConfig
        Windows; ``coupling`` is what the region is at least.
    info : RadarInfo
        The radar.

    Raises
    ------
    DataError
        When there are too few frames, or they are not this radar's.
    """
    spectrum = make_spectrum(config.spectrum, info)
    total, power, count = None, None, 0
    for frame in frames:
        frame.check(info)
        if len(frame.missing):
            continue
        cells = spectrum.process(frame.cube).astype(np.complex128)
        total = cells if total is None else total + cells
        power = np.abs(cells) ** 2 if power is None else power + np.abs(cells) ** 2
        count += 1
    if total is None or power is None or count < _FEWEST:
        raise DataError(
            f"{count} whole frames are too few to measure leakage with; record at least {_FEWEST} of a room that is empty nearby"
        )
    still = (np.abs(total / count) ** 2).mean(axis=(0, 2))
    noise = float(np.median((power / count - np.abs(total / count) ** 2).mean(axis=(0, 2)))) * count / (count - 1)
    n_speed, n_range = still.shape
    along = _reach(still[0], noise, round(_MOST * n_range))
    both = np.maximum(still[: n_speed // 2, 0], still[-np.arange(n_speed // 2) % n_speed, 0])
    across = _reach(both, noise, round(_MOST * n_speed / 2)) if along else 0
    w, given = info.waveform, config.coupling
    width, speed = along * w.range_resolution if np.isfinite(w.range_resolution) else 0.0, max(across - 1, 0) * w.speed_resolution
    chosen = CouplingConfig(
        range_extent=max(given.range_extent, width - 0.5 * w.range_resolution) if along else given.range_extent,
        speed_extent=max(given.speed_extent, speed),
    )
    level = 10 * float(np.log10(still[0, :along].max() / noise)) if along and noise > 0 else 0.0
    return Leakage(chosen, width, speed, level, count)


def _reach(profile: FloatArray, noise: float, most: int) -> int:
    """Count the cells from the first on that are above the noise and do not rise again; the leakage may lie in one of the first two."""
    start = int(profile[:2].argmax())
    if profile[start] <= _ABOVE * noise:
        return 0
    end = start + 1
    while end < most and profile[end] > _ABOVE * noise and profile[end] <= _RISE * profile[end - 1]:
        end += 1
    return end
