"""The radar equation: from transmitted watts to volts at the receiver (thesis, section 2.1.3)."""

from __future__ import annotations

import math

import numpy as np

from radar_core import RadarInfo
from radar_sim.scatterers import Float64Array

IMPEDANCE = 50.0
"""Ohm: what turns watts into volts. A sample z carries the power abs(z)^2 / IMPEDANCE at the receiver's input."""


def strength(info: RadarInfo, rcs: Float64Array) -> Float64Array:
    """Amplitude of an echo times the square of its range, by the radar equation (2.4) on the boresight.

    Parameters
    ----------
    info : RadarInfo
        Transmit power and gain.
    rcs : ndarray, shape (n,)
        Radar cross-sections [m^2].

    Returns
    -------
    ndarray of float64, shape (n,)
        Strength [V m^2].
    """
    array, wavelength = info.array, info.waveform.wavelength
    power = 1e-3 * 10 ** ((array.tx_power + 2 * array.gain) / 10) * wavelength**2 / (4 * math.pi) ** 3
    return np.sqrt(power * IMPEDANCE * rcs)
