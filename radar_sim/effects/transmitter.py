"""Effects of the transmitters: coupling, tapered amplitudes, elements that send at once (thesis, figures A.25 and A.26)."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from radar_core import SPEED_OF_LIGHT, ConfigError, RadarInfo, known_symbols
from radar_core.windows import window_shape
from radar_sim.effects.base import Moment, Setting, Signal
from radar_sim.effects.config import CouplingConfig
from radar_sim.effects.echo import response
from radar_sim.effects.physics import amplitudes
from radar_sim.propagation.base import IMPEDANCE
from radar_sim.propagation.reference import frequencies
from radar_sim.scatterers import Echoes
from radar_sim.scene import Transmitter


class Coupling:
    """Add what leaks into the receivers: a still echo with the same amplitude and phase in every channel and chirp.

    Its power is the transmitted one weakened by ``level``; a high-pass filter that the scene names weakens it more, by its response at the
    beat frequency of ``distance``. An OFDM symbol leaks with the symbols that it carries.
    """

    def __init__(self, config: CouplingConfig, setting: Setting) -> None:
        w, delay = setting.info.waveform, 2 * config.distance / SPEED_OF_LIGHT
        leak = _leak(delay, leaked(config, setting.info), setting.info)
        filters = setting.scene.effects.high_pass
        if filters is not None:
            leak *= response(filters, w.slope * delay)
        self._leak = leak.astype(np.complex64)

    def process(self, signal: Signal, moment: Moment) -> None:
        """Add the leakage."""
        signal.cube += self._leak

    def size(self, echoes: Echoes) -> str:
        """Level of the leakage, and against the strongest echo."""
        leak = float(np.sqrt((np.abs(self._leak) ** 2).mean()))
        level = f"{_decibel(leak / math.sqrt(1e-3 * IMPEDANCE)):.1f} dBm"
        strongest = float(amplitudes(echoes).max()) if len(echoes) else 0.0
        return level if strongest == 0.0 else f"{level}, {_decibel(leak / strongest):+.1f} dB against the strongest echo"


def leaked(config: CouplingConfig, info: RadarInfo) -> float:
    """Amplitude of the leakage at the receivers' inputs [V]."""
    return math.sqrt(1e-3 * 10 ** ((info.array.tx_power + config.level) / 10) * IMPEDANCE)


def _leak(delay: float, volts: float, info: RadarInfo) -> NDArray[np.complex128]:
    """Make the samples of the leakage, shape (1, 1, 1, sample), for OFDM (tx, chirp, 1, sample) [V]."""
    w = info.waveform
    if w.modulation == "ofdm":
        turned = known_symbols(w).conj() * np.exp(2j * math.pi * (delay * frequencies(w)))
        return np.asarray(volts * np.fft.fft(turned, norm="ortho"))[:, :, None, :]
    # About the middle of the chirp, as in propagation.base; a tone has no slope.
    fast = (np.arange(w.n_sample) / w.n_sample - 0.5) * w.chirp_duration
    turns = w.carrier * delay + w.slope * delay * fast - w.slope * delay**2 / 2
    return np.asarray(volts * np.exp(2j * math.pi * turns))[None, None, None, :]


def _decibel(ratio: float) -> float:
    return 20 * math.log10(max(ratio, 1e-30))


class AmplitudeModulation:
    """Taper everything that was transmitted, coupling too: over each chirp (intra) or from chirp to chirp (inter).

    The taper peaks at 1, so ``tx_power`` is the largest power. Between chirps it follows the chirps of each transmitter, so transmitters
    that take turns keep equal amplitudes.

    Raises
    ------
    ConfigError
        When scipy does not know the taper or its parameters, or nothing would be transmitted.
    """

    def __init__(self, config: Transmitter, setting: Setting) -> None:
        w, inter = setting.info.waveform, config.amplitude == "inter"
        try:
            shape = window_shape(config.taper, w.n_chirp if inter else w.n_sample)
        except ConfigError as error:
            raise ConfigError(f"transmitter.taper: {error}", key=("transmitter", "taper")) from None
        taper = (shape / np.abs(shape).max()).astype(np.float32)
        self._taper = taper[:, None, None] if inter else taper

    def process(self, signal: Signal, moment: Moment) -> None:
        """Multiply the samples by the taper."""
        signal.cube *= self._taper


class Together:
    """Let elements send every chirp at once: an echo's amplitude depends on the direction that it leaves for.

    Each of the M elements at p_m sends 1 / M of the power. Towards u their sum is that of one element at p_tx, the radar's one transmitter,
    which stands for them, times

        sum_m exp(-j 2 pi (p_m - p_tx).u / lambda) / sqrt(M),

    plane waves and narrow band: a gain of M at the most.
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
