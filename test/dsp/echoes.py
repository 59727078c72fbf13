"""Frames with echoes of known truth, written from the formulas of the design page (no code of the simulator)."""

import math

import numpy as np

from radar_core import SPEED_OF_LIGHT, RadarFrame, RadarInfo


def noise(info: RadarInfo, rng: np.random.Generator, sigma: float = 1.0) -> np.ndarray:
    """White circular noise of variance sigma^2, shape of the cube."""
    return (rng.standard_normal((*info.cube_shape, 2), dtype=np.float32) @ np.array([1, 1j], np.complex64)) * np.float32(
        sigma / math.sqrt(2)
    )


def echo(info: RadarInfo, distance: float, speed: float, azimuth: float, elevation: float, amplitude: complex = 1.0) -> np.ndarray:
    """One point echo in complex128: exact range at every sample; ``distance`` holds at the middle of the acquisition."""
    w = info.waveform
    t, chirp, s = np.arange(w.n_tx), np.arange(w.n_chirp), np.arange(w.n_sample)
    fast = s * w.chirp_duration / w.n_sample
    start = (chirp[None, :] * w.n_tx + t[:, None]) * w.chirp_interval
    since_middle = start[:, :, None] + fast - w.acquisition_time / 2
    tau = 2 * (distance + speed * since_middle) / SPEED_OF_LIGHT
    phase = (w.carrier - w.bandwidth / 2) * tau + w.slope * tau * fast
    u = np.array([math.cos(elevation) * math.sin(azimuth), math.sin(elevation)])
    steering = np.array([[np.exp(-2j * np.pi / w.wavelength * (np.add(p, q) @ u)) for q in info.array.rx] for p in info.array.tx])
    return amplitude * np.exp(2j * np.pi * phase)[:, :, None, :] * steering[:, None, :, None]


def frame(info: RadarInfo, *parts: np.ndarray, stamp_ns: int = 0, sequence: int = 0) -> RadarFrame:
    """Sum of the parts as a frame."""
    return RadarFrame(np.sum(parts, axis=0).astype(np.complex64), stamp_ns, sequence, info.frame_id)


def amplitude_for(snr_db: float, info: RadarInfo) -> float:
    """Amplitude whose cell has this signal-to-noise ratio per channel behind a boxcar window, in unit noise."""
    return math.sqrt(10 ** (snr_db / 10) / (info.waveform.n_chirp * info.waveform.n_sample))
