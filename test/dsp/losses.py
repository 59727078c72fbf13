"""Small radars, echoes of constant speed, and losses: for tests of lost chirps."""

import numpy as np

from radar_core import AntennaArray, RadarInfo, Waveform


def radar(n_tx: int = 2, n_chirp: int = 64, **waveform) -> RadarInfo:
    """A small radar with so many transmitters and chirps."""
    interval = 116e-6 * n_tx * n_chirp
    wave = Waveform(**{"n_tx": n_tx, "n_chirp": n_chirp, "n_sample": 16, "frame_interval": max(2 * interval, 20e-3), **waveform})
    tx = tuple((2e-3 * t, 0.0) for t in range(n_tx))
    rx = ((0.0, 0.0), (2e-3, 2e-3), (4e-3, 0.0))
    return RadarInfo(waveform=wave, array=AntennaArray(tx=tx, rx=rx))


def tones(info: RadarInfo, rng: np.random.Generator, n: int = 3) -> np.ndarray:
    """A few echoes of constant speed in one range cell and others, exact from chirp to chirp."""
    n_tx, n_chirp, n_rx, n_sample = info.cube_shape
    cube = np.zeros(info.cube_shape, complex)
    for _ in range(n):
        slow, fast = rng.uniform(-0.5, 0.5), rng.uniform(0.1, 0.9)
        phase = np.exp(2j * np.pi * (slow * np.arange(n_chirp)[:, None, None] + fast * np.arange(n_sample)))
        cube += np.exp(2j * np.pi * rng.random((n_tx, 1, n_rx, 1))) * phase * rng.uniform(0.3, 1.0)
    return cube.astype(np.complex64)


def draw(info: RadarInfo, rng: np.random.Generator, share: float) -> np.ndarray:
    """Which chirps are lost, shape (n_tx, n_chirp); at least one."""
    n_tx, n_chirp = info.cube_shape[:2]
    lost = rng.random((n_tx, n_chirp)) < share
    lost[rng.integers(n_tx), rng.integers(n_chirp)] = True
    return lost


def numbers(lost: np.ndarray) -> np.ndarray:
    return np.flatnonzero(lost.T).astype(np.uint32)
