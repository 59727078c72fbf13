"""Imbalance of the two arms of the mixer: a mirror image at the opposite beat frequency, and an offset."""

from __future__ import annotations

import cmath
import math

import numpy as np

from radar_sim.effects.base import Moment, Setting, Signal
from radar_sim.effects.config import IqImbalanceConfig
from radar_sim.scatterers import Echoes


class IqImbalance:
    """Let the quadrature arm have another gain g, and be phi short of 90 degrees.

    Samples I + jQ become I + jg (Q cos phi + I sin phi) + offset (1 + j), which is z (1 + g exp(j phi)) / 2 + z* (1 - g exp(-j phi)) / 2
    and the offset: an echo at the frequency f gets an image at -f.

    Parameters
    ----------
    config : IqImbalanceConfig
        Gain, phase and offset.
    setting : Setting
        Not used: all radars alike.
    """

    def __init__(self, config: IqImbalanceConfig, setting: Setting) -> None:
        gain = 10 ** (config.gain / 20)
        self._straight, self._crossed = np.float32(gain * math.cos(config.phase)), np.float32(gain * math.sin(config.phase))
        self._offset = np.complex64(complex(config.offset, config.offset))

    def process(self, signal: Signal, moment: Moment) -> None:
        """Change the imaginary parts, and add the offset."""
        in_phase, quadrature = signal.cube.real, signal.cube.imag
        quadrature *= self._straight
        quadrature += self._crossed * in_phase
        if self._offset:
            signal.cube += self._offset


def image(config: IqImbalanceConfig) -> float:
    """Amplitude of the image over that of the echo."""
    gain = 10 ** (config.gain / 20)
    turn = cmath.exp(1j * config.phase)
    return abs(1 - gain / turn) / abs(1 + gain * turn)


def size(config: IqImbalanceConfig, setting: Setting, echoes: Echoes) -> str:
    """Say how large the effect is, whatever the echoes."""
    ratio = image(config)
    level = f"image {-20 * math.log10(ratio):.1f} dB below the echo" if ratio > 0.0 else "no image"
    return f"{level}, offset {config.offset:g} V" if config.offset else level
