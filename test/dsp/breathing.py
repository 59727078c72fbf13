"""Frames of chests that breathe and beat, beside echoes that stand still; truth by construction."""

import numpy as np

from radar_core import AntennaArray, Pose, RadarFrame, RadarInfo, Waveform

INFO = RadarInfo(
    waveform=Waveform(n_tx=1, n_chirp=4, n_sample=32, frame_interval=0.04),
    array=AntennaArray(tx=((0.0, 0.0),), rx=((0.0, 0.0), (0.0, 0.0))),
    mount=Pose(z=1.0),
)
SAMPLES = np.arange(32)


def chest(breath=0.25, heart=1.2, size=4e-3, pulse=3e-4, at=1.5):
    """Way of a chest over time [m]; its breath has harmonics."""
    turn = 2 * np.pi * breath
    return lambda t: at + size * (np.sin(turn * t) + 0.2 * np.sin(2 * turn * t)) + pulse * np.sin(2 * np.pi * heart * t)


def echo(distance, info=INFO):
    """Samples of an echo at a distance [m]."""
    wave = info.waveform
    phase = 4 * np.pi * distance / wave.wavelength + 2 * np.pi * distance / wave.range_resolution * SAMPLES / 32
    return np.exp(1j * phase)


def frames(path, seconds, *, snr=20.0, still=0.0, seed=0, dtype=np.complex64):
    """Frames of noise of unit power, an echo whose distance over time is ``path`` (None: none), and one that stands still at 1.45 m."""
    rng, wave = np.random.default_rng(seed), INFO.waveform
    for k in range(round(seconds / wave.frame_interval)):
        cube = rng.normal(size=(4, 2, 32, 2)) @ [1, 1j] / np.sqrt(2)
        if path is not None:
            cube = cube + 10 ** (snr / 20) * echo(path(k * wave.frame_interval))
        cube = cube + still * echo(1.45)
        yield RadarFrame(cube[None].astype(dtype), 1 + round(k * wave.frame_interval * 1e9), k, "radar")
