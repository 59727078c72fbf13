"""High-pass filter of the intermediate frequency: what is near beats slowly, and is held down."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from radar_core import SPEED_OF_LIGHT
from radar_sim.effects.base import Moment, Setting
from radar_sim.effects.config import HighPassConfig
from radar_sim.effects.fmcw import require_fmcw, without_sweep
from radar_sim.scatterers import Echoes


class HighPass:
    """Weaken and turn each echo by the filter's response at its beat frequency, slope tau (2.7).

    The filter has settled when sampling begins: its transient lasts about 1 / (2 pi corner). The shift of the beat frequency by motion
    within a chirp (2 kHz at 4 m/s) is left out. Coupling is filtered alike, by `Coupling`. Noise is not: the noise figure of `Noise` is
    that of the whole receiver. At low frequencies what the filter takes from the noise ahead of it is small beside flicker noise and the
    noise of the stages behind it. Nor is phase noise, which acts on what the filter leaves, or interference, whose bursts are too wide.

    Parameters
    ----------
    config : HighPassConfig
        Corner and order.
    setting : Setting
        The radar.

    Raises
    ------
    ConfigError
        When the radar does not sweep.
    """

    def __init__(self, config: HighPassConfig, setting: Setting) -> None:
        require_fmcw("high_pass", setting, "without a sweep ranges have no beat frequency to filter by")
        self._config, self._slope = config, setting.info.waveform.slope

    def process(self, echoes: Echoes, moment: Moment) -> Echoes:
        """Filter echoes."""
        return echoes.weakened(response(self._config, beat(self._slope, echoes)))


def beat(slope: float, echoes: Echoes) -> NDArray[np.float64]:
    """Beat frequencies in the middle of the frame, shape (n,) [Hz]."""
    frequency: NDArray[np.float64] = 2 * slope / SPEED_OF_LIGHT * echoes.range
    return frequency


def response(config: HighPassConfig, frequency: ArrayLike) -> NDArray[np.complex128]:
    """Frequency response of the analogue Butterworth filter: 1 far above its corner, -3 dB at it (Butterworth 1930).

    Parameters
    ----------
    config : HighPassConfig
        Corner and order.
    frequency : array_like, shape (...)
        [Hz]; 0 gives 0.

    Returns
    -------
    ndarray of complex128, shape (...)
        Factor of amplitude and phase.
    """
    s = 1j * np.asarray(frequency, np.float64) / config.corner
    result = np.ones(s.shape, np.complex128)
    for k in range(config.order):
        pole = np.exp(1j * math.pi * (2 * k + config.order + 1) / (2 * config.order))
        result *= s / (1.0 - s * pole)  # the low-pass 1 / (1/s - pole) with s turned into 1/s
    return result


def size(config: HighPassConfig, setting: Setting, echoes: Echoes) -> str:
    """Say how large the effect is for these echoes."""
    if not len(echoes) or without_sweep(setting):
        return without_sweep(setting) or "no echoes"
    ends = np.array([echoes.range.min(), echoes.range.max()])
    near, far = 20 * np.log10(np.abs(response(config, 2 * setting.info.waveform.slope / SPEED_OF_LIGHT * ends)) + 1e-15)
    return f"{near:.1f} dB at the nearest echo ({ends[0]:.2f} m), {far:.1f} dB at the farthest ({ends[1]:.2f} m)"
