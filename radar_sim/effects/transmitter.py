"""Transmitters: tapered amplitudes, and elements that send at once (thesis, figures A.25 and A.26)."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from radar_core import ConfigError
from radar_core.windows import window_shape
from radar_sim.effects.base import Moment, Setting, Signal
from radar_sim.scatterers import Echoes
from radar_sim.scene import Transmitter


class AmplitudeModulation:
    """Taper everything that was transmitted, coupling too: over each chirp (intra) or from chirp to chirp (inter).

    The taper peaks at 1, so ``tx_power`` is the largest power. Between chirps it follows the chirps of each transmitter, so transmitters
    that take turns keep equal amplitudes.

    Parameters
    ----------
    config : Transmitter
        Kind and taper.
    setting : Setting
        The radar.

    Raises
    ------
    ConfigError
        When scipy does not know the taper.
    """

    def __init__(self, config: Transmitter, setting: Setting) -> None:
        w = setting.info.waveform
        self._taper: NDArray[np.float32] | None = None
        if config.amplitude == "intra":
            self._taper = make_taper(config.taper, w.n_sample).astype(np.float32)
        elif config.amplitude == "inter":
            self._taper = make_taper(config.taper, w.n_chirp).astype(np.float32)[:, None, None]

    def process(self, signal: Signal, moment: Moment) -> None:
        """Multiply the samples by the taper."""
        if self._taper is not None:
            signal.cube *= self._taper


def make_taper(name: str, n: int) -> NDArray[np.float64]:
    """Make a taper that peaks at 1.

    Parameters
    ----------
    name : str
        A name of `scipy.signal.get_window`; parameters follow after colons, e.g. ``"chebwin:60"``.
    n : int
        Length.

    Returns
    -------
    ndarray of float64, shape (n,)
        Amplitudes.

    Raises
    ------
    ConfigError
        When scipy does not know the name or its parameters, or nothing would be transmitted.
    """
    try:
        shape = window_shape(name, n)
    except ConfigError as error:
        raise ConfigError(f"transmitter.taper: {error}", key=("transmitter", "taper")) from None
    return np.asarray(shape / np.abs(shape).max(), np.float64)


class Together:
    """Let elements send every chirp at once: an echo's amplitude depends on the direction that it leaves for.

    Each of the M elements at p_m sends 1 / M of the power. Towards u their sum is that of one element at p_tx, which stands for them, times

        sum_m exp(-j 2 pi (p_m - p_tx).u / lambda) / sqrt(M),

    plane waves and narrow band: a gain of M at the most.

    Parameters
    ----------
    config : Transmitter
        Places of the elements.
    setting : Setting
        The radar; its one transmitter stands for all.
    """

    def __init__(self, config: Transmitter, setting: Setting) -> None:
        apart = np.asarray(config.together, np.float64).reshape(-1, 2) - np.asarray(setting.array.tx[0], np.float64)
        self._wave_numbers = -2 * math.pi / setting.info.waveform.wavelength * apart
        self._share = 1.0 / math.sqrt(max(len(apart), 1))

    def process(self, echoes: Echoes, moment: Moment) -> Echoes:
        """Multiply each echo by the array factor of its way out."""
        if not len(self._wave_numbers):
            return echoes
        place = echoes.out.position
        aside = place[:, 1:] / np.maximum(np.sqrt((place**2).sum(-1)), 1e-9)[:, None]
        factor = np.zeros(len(echoes), np.complex128)
        for wave_number in self._wave_numbers:
            factor += np.exp(1j * (aside @ wave_number))
        return echoes.weakened(self._share * factor)
