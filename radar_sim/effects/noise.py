"""Thermal noise of the receivers, and the gain of their amplifiers."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from radar_core import RadarInfo
from radar_sim.effects.base import BOLTZMANN, Moment, Setting, Signal
from radar_sim.effects.config import NoiseConfig
from radar_sim.effects.physics import amplitudes
from radar_sim.propagation.base import IMPEDANCE
from radar_sim.propagation.kernels import cosine, jit, sine
from radar_sim.scatterers import Echoes


def _fit_logarithm() -> NDArray[np.float32]:
    """Fit ln(1 + x) / x from 1/sqrt(2) to sqrt(2), through Chebyshev points; the logarithm is then good to 3e-9, before rounding."""
    low, high = math.sqrt(0.5) - 1.0, math.sqrt(2.0) - 1.0
    x = (low + high) / 2 + (high - low) / 2 * np.cos(np.pi * (np.arange(10) + 0.5) / 10)
    return np.asarray(np.polynomial.polynomial.polyfit(x, np.log1p(x) / x, 9), np.float32)


_L0, _L1, _L2, _L3, _L4, _L5, _L6, _L7, _L8, _L9 = _fit_logarithm()
_LN2, _LN_RANGE, _ROOT2 = np.float32(math.log(2)), np.float32(31 * math.log(2)), np.float32(math.sqrt(2))


class Noise:
    """Add k T F B in every channel, white and circular, then amplify everything.

    B is the rate of the complex samples. Noise of two channels, chirps or samples is independent.
    """

    def __init__(self, config: NoiseConfig, setting: Setting) -> None:
        self._waveform, self._power = setting.info.waveform, power(config, setting.info)
        self._volts = np.float32(math.sqrt(self._power * IMPEDANCE))
        self._gain = np.float32(10 ** (config.gain / 20))

    def process(self, signal: Signal, moment: Moment) -> None:
        """Add noise and amplify."""
        signal.cube = np.ascontiguousarray(signal.cube)
        raw = np.asarray(moment.rng("noise").bit_generator.random_raw(signal.cube.size), np.uint64)
        add_noise(raw.view(np.int32), self._volts, self._gain, signal.cube.reshape(-1).view(np.float32))

    def size(self, echoes: Echoes) -> str:
        """Level of the noise, and the SNR of the strongest echo."""
        w, noise = self._waveform, self._power
        level = f"noise {10 * math.log10(max(noise, 1e-30) * 1e3):.1f} dBm"
        if not len(echoes) or noise == 0.0:
            return level
        ratio = float(amplitudes(echoes).max()) ** 2 / IMPEDANCE / noise * w.n_sample * w.n_chirp
        return f"{level}, SNR of the strongest echo {10 * math.log10(max(ratio, 1e-30)):.0f} dB after integration over samples and chirps"


def power(config: NoiseConfig, info: RadarInfo) -> float:
    """Noise power k T F B at the receiver's input, before the gain [W]."""
    w = info.waveform
    return BOLTZMANN * config.temperature * 10 ** (config.noise_figure / 10) * w.n_sample / w.chirp_duration


@jit
def add_noise(raw: Any, volts: Any, gain: Any, parts: Any) -> None:
    """Add circular Gaussian noise to samples, then amplify them; `add_noise_reference` in the tests says the same in numpy.

    By Box and Muller (1958): a sample's power is exponentially distributed, its phase evenly. Numpy's own normal numbers take four times
    as long. Powers end at 22 times the mean, which one sample in 4e9 would exceed.

    Parameters
    ----------
    raw : ndarray of int32, shape (2 n,)
        Random bits.
    volts : float32
        Rms amplitude of the noise.
    gain : float32
        Factor of the amplitude.
    parts : ndarray of float32, shape (2 n,)
        Real and imaginary parts in turn; changed.
    """
    even = np.empty(len(raw) // 2, np.float32)
    for i in range(len(even)):
        even[i] = np.float32((raw[2 * i] >> 1) & 0x7FFFFFFF) + np.float32(0.5)
    bits = even.view(np.int32)
    for i in range(len(even)):
        exponent = (bits[i] >> 23) - 127
        bits[i] = (bits[i] & 0x007FFFFF) | 0x3F800000
        mantissa = even[i]
        upper = mantissa > _ROOT2
        x = (mantissa * np.float32(0.5) if upper else mantissa) - np.float32(1.0)
        whole = np.float32(exponent) + (np.float32(1.0) if upper else np.float32(0.0))
        log = x * (_L0 + x * (_L1 + x * (_L2 + x * (_L3 + x * (_L4 + x * (_L5 + x * (_L6 + x * (_L7 + x * (_L8 + x * _L9)))))))))
        radius = volts * np.sqrt(max(_LN_RANGE - whole * _LN2 - log, np.float32(0.0)))
        turns = np.float32(raw[2 * i + 1]) * np.float32(2.0**-32)
        parts[2 * i] = gain * (parts[2 * i] + radius * cosine(turns))
        parts[2 * i + 1] = gain * (parts[2 * i + 1] + radius * sine(turns))
