"""Coupling: what leaks from the transmitters into the receivers."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from radar_core import SPEED_OF_LIGHT, RadarInfo, known_symbols
from radar_sim.effects import high_pass
from radar_sim.effects.base import Moment, Setting, Signal
from radar_sim.effects.config import CouplingConfig
from radar_sim.effects.physics import amplitudes
from radar_sim.link import IMPEDANCE
from radar_sim.scatterers import Echoes


class Coupling:
    """Add a still echo with the same amplitude and phase in every channel and chirp.

    Its power is the transmitted one weakened by ``level``; a high-pass filter that the scene names weakens it more, by its response at the
    beat frequency of ``distance``. An OFDM symbol leaks with the symbols that it carries.

    Parameters
    ----------
    config : CouplingConfig
        How much, from how far.
    setting : Setting
        The radar, and whether it has a high-pass filter.
    """

    def __init__(self, config: CouplingConfig, setting: Setting) -> None:
        leak = leakage(config, setting.info)
        filters = setting.scene.effects.high_pass
        if filters is not None:
            leak *= high_pass.response(filters, setting.info.waveform.slope * _delay(config))
        self._leak = leak.astype(np.complex64)

    def process(self, signal: Signal, moment: Moment) -> None:
        """Add the leakage."""
        signal.cube += self._leak


def leakage(config: CouplingConfig, info: RadarInfo) -> NDArray[np.complex128]:
    """Leakage at the receivers' inputs.

    Parameters
    ----------
    config : CouplingConfig
        How much, from how far.
    info : RadarInfo
        The radar.

    Returns
    -------
    ndarray of complex128, shape (1, 1, 1, sample), for OFDM (tx, chirp, 1, sample)
        Samples [V].
    """
    w, delay = info.waveform, _delay(config)
    volts = amplitude(config, info)
    if w.modulation == "ofdm":
        carriers = w.carrier - w.bandwidth / 2 + np.arange(w.n_sample) / w.chirp_duration
        turned = known_symbols(w).conj() * np.exp(2j * math.pi * (delay * carriers))
        return np.asarray(volts * np.fft.fft(turned, norm="ortho"))[:, :, None, :]
    # About the middle of the chirp, as in propagation.base; a tone has no slope.
    fast = (np.arange(w.n_sample) / w.n_sample - 0.5) * w.chirp_duration
    turns = w.carrier * delay + w.slope * delay * fast - w.slope * delay**2 / 2
    return np.asarray(volts * np.exp(2j * math.pi * turns))[None, None, None, :]


def amplitude(config: CouplingConfig, info: RadarInfo) -> float:
    """Amplitude of the leakage [V]."""
    return math.sqrt(1e-3 * 10 ** ((info.array.tx_power + config.level) / 10) * IMPEDANCE)


def size(config: CouplingConfig, setting: Setting, echoes: Echoes) -> str:
    """Say how large the effect is for these echoes."""
    leak = float(np.sqrt((np.abs(Coupling(config, setting)._leak) ** 2).mean()))
    level = f"{_decibel(leak / math.sqrt(1e-3 * IMPEDANCE)):.1f} dBm"
    strongest = float(amplitudes(echoes).max()) if len(echoes) else 0.0
    return level if strongest == 0.0 else f"{level}, {_decibel(leak / strongest):+.1f} dB against the strongest echo"


def _delay(config: CouplingConfig) -> float:
    return 2 * config.distance / SPEED_OF_LIGHT


def _decibel(ratio: float) -> float:
    return 20 * math.log10(max(ratio, 1e-30))
