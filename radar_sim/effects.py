"""Effects beyond ideal echoes. Each acts on its own, so their order does not matter; one that a scene does not name is never called."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from radar_core import SPEED_OF_LIGHT, RadarInfo
from radar_core.geometry import cartesian_to_spherical
from radar_sim.propagation import IMPEDANCE
from radar_sim.scene import Coupling, Noise, Pattern

BOLTZMANN = 1.380649e-23
"""J/K."""


def thermal_noise(noise: Noise, info: RadarInfo, seed: int, sequence: int) -> NDArray[np.complex64]:
    """Thermal noise k T F B of the sampled band, white and circular.

    Parameters
    ----------
    noise : Noise
        Noise figure and temperature.
    info : RadarInfo
        The radar; complex samples at ``n_sample / chirp_duration`` have that bandwidth.
    seed, sequence : int
        Of scene and frame: the same numbers give the same noise, whatever was simulated before.

    Returns
    -------
    ndarray of complex64, shape (tx, chirp, rx, sample)
        Samples [V].
    """
    w = info.waveform
    power = BOLTZMANN * noise.temperature * (w.n_sample / w.chirp_duration) * 10 ** (noise.noise_figure / 10)
    rng = np.random.Generator(np.random.SFC64([seed, sequence, 0x401]))
    parts = rng.standard_normal((*info.cube_shape[:3], 2 * w.n_sample), np.float32)
    parts *= np.float32(math.sqrt(power * IMPEDANCE / 2))
    return parts.view(np.complex64)


def leakage(coupling: Coupling, info: RadarInfo) -> NDArray[np.complex64]:
    """Leakage from the transmitters into the receivers, the same in every chirp and channel, shape (sample,) [V]."""
    w = info.waveform
    power = 1e-3 * 10 ** ((info.array.tx_power + coupling.level) / 10)
    delay = 2 * coupling.distance / SPEED_OF_LIGHT
    t = np.arange(w.n_sample) / w.n_sample * w.chirp_duration
    turns = (w.carrier - w.bandwidth / 2) * delay + w.slope * delay * t
    beat: NDArray[np.complex64] = (math.sqrt(power * IMPEDANCE) * np.exp(2j * np.pi * turns)).astype(np.complex64)
    return beat


def two_way_gain(pattern: Pattern, info: RadarInfo, position: NDArray[np.float64]) -> NDArray[np.float64]:
    """Gain of transmitting and receiving element relative to the boresight, as a factor of the amplitude.

    Parameters
    ----------
    pattern : Pattern
        How far the gain has fallen at half the field of view.
    info : RadarInfo
        The field of view.
    position : ndarray, shape (n, 3)
        In the sensor frame [m].

    Returns
    -------
    ndarray of float64, shape (n,)
        0 to 1: cos(azimuth)^p cos(elevation)^q; both one-way power gains multiply, so their product's root is one of them.
    """
    _, azimuth, elevation = cartesian_to_spherical(position)
    return info.array.element_gain(azimuth, elevation, pattern.edge)
