"""Analogue-to-digital converter: volts to counts."""

from __future__ import annotations

import math

import numpy as np

from radar_sim.effects import coupling
from radar_sim.effects.base import Moment, Setting, Signal
from radar_sim.effects.config import ConverterConfig
from radar_sim.effects.physics import amplitudes
from radar_sim.scatterers import Echoes


class Converter:
    """Clip I and Q at full scale and round them to whole counts, halves to even.

    A count is ``full_scale / 2^(bits - 1)`` volts; the most positive is one short of full scale. One bit knows the counts -1 and 0.

    Parameters
    ----------
    config : ConverterConfig
        Word length and range.
    setting : Setting
        Not used: all radars alike.
    """

    def __init__(self, config: ConverterConfig, setting: Setting) -> None:
        half = 2.0 ** (config.bits - 1)
        self._limit, self._scale = np.float32(config.full_scale), np.float32(half / config.full_scale)
        self._low, self._high = np.float32(-half), np.float32(half - 1)

    def process(self, signal: Signal, moment: Moment) -> None:
        """Turn volts into counts."""
        parts = signal.cube.view(np.float32)
        # Clipped before they are scaled: nothing overflows, however large. Clipped again after: single precision may round up.
        np.clip(parts, -self._limit, self._limit, out=parts)
        parts *= self._scale
        np.rint(parts, out=parts)
        np.clip(parts, self._low, self._high, out=parts)


def full_scale(config: ConverterConfig) -> float:
    """Largest count, for `RadarInfo.full_scale`; one bit has 0, which there means unknown."""
    return 2.0 ** (config.bits - 1) - 1.0


def lsb(config: ConverterConfig) -> float:
    """One count [V]."""
    return config.full_scale / 2.0 ** (config.bits - 1)


def size(config: ConverterConfig, setting: Setting, echoes: Echoes) -> str:
    """Say how large the effect is: how much of the range these echoes use when all are in phase, with gain and coupling if named."""
    effects = setting.scene.effects
    volts = float(amplitudes(echoes).sum()) if len(echoes) else 0.0
    if effects.coupling is not None:
        volts += coupling.amplitude(effects.coupling, setting.info)
    if effects.noise is not None:
        volts *= 10 ** (effects.noise.gain / 20)
    return f"1 LSB = {_volts(lsb(config))}, at most {100 * volts / config.full_scale:.2g} % of full scale"


def _volts(value: float) -> str:
    power = min(max(math.floor(math.log10(value) / 3), -5), 0)
    return f"{value / 1000.0**power:.3g} {('', 'm', 'u', 'n', 'p', 'f')[-power]}V"
