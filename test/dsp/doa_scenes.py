"""Arrays, echoes from known directions and their noise, for the tests of direction finding."""

import dataclasses

import numpy as np
from scipy.optimize import brentq

from radar_core import AntennaArray, RadarInfo, Waveform
from radar_dsp import DoaConfig
from radar_dsp.steering import make_steering

INFO = RadarInfo()
LAMBDA = INFO.waveform.wavelength
HALF = LAMBDA / 2
LINE = RadarInfo(array=AntennaArray(tx=((0.0, 0.0), (4 * HALF, 0.0)), rx=tuple((i * HALF, 0.0) for i in range(4))))
UPRIGHT = RadarInfo(array=AntennaArray(tx=((0.0, 0.0), (0.0, 4 * HALF)), rx=tuple((0.0, i * HALF) for i in range(4))))
SINGLE = RadarInfo(waveform=Waveform(n_tx=1), array=AntennaArray(tx=((0.0, 0.0),), rx=((0.0, 0.0),)))
BACKENDS = ("numba", "numpy")


def calibrated(info=INFO):
    """30 degrees rms of phase, 2 dB of gain, 0.2 mm of position per channel."""
    rng = np.random.default_rng(5)
    array = dataclasses.replace(
        info.array,
        channel_gain=tuple(rng.normal(0, 2, 8)),
        channel_phase=tuple(np.radians(rng.normal(0, 30, 8))),
        channel_shift=tuple(map(tuple, rng.normal(0, 2e-4, (8, 2)))),
    )
    return dataclasses.replace(info, array=array)


def echoes(info, azimuth, elevation, snr_db, rng):
    """Steering vectors with random phases, complex128, shape (n, n_channel); noise has unit variance."""
    a = info.array.steering(azimuth, elevation, LAMBDA)
    return a * (10 ** (np.asarray(snr_db) / 20) * np.exp(2j * np.pi * rng.random(len(a))))[:, None]


def noise(shape, rng):
    """Circular noise of unit variance."""
    return rng.normal(scale=0.5**0.5, size=(*shape, 2)) @ [1, 1j]


def measured_snr(v):
    """What the baseband measures where the noise floor is known."""
    return (np.mean(np.abs(v) ** 2, axis=-1) - 1).astype(np.float32)


def directions(n, rng, azimuth=50, elevation=25):
    """Random directions within +- the limits [deg]."""
    return np.radians(rng.uniform(-azimuth, azimuth, n)), np.radians(rng.uniform(-elevation, elevation, n))


def scene(info, n, snr_db, seed):
    """Single echoes for an array: truth, snapshots, measured signal-to-noise ratios."""
    rng = np.random.default_rng(seed)
    azimuth, elevation = directions(n, rng)
    if info is LINE:
        elevation = 0 * elevation
    if info is UPRIGHT:
        azimuth = 0 * azimuth
    v = (echoes(info, azimuth, elevation, snr_db, rng) + noise((n, 8), rng)).astype(np.complex64)
    return azimuth, elevation, v, measured_snr(v)


def beam_width():
    """3 dB width of the default array in direction cosine: 0.223, 12.9 degrees ahead."""
    phase = make_steering(DoaConfig(), INFO, "azimuth_elevation").phase[0]
    return 2 * brentq(lambda u: abs(np.mean(np.exp(1j * phase * u))) ** 2 - 0.5, 1e-3, 0.3)
