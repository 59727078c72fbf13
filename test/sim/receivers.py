"""A radar, signals and echoes to try single effects of transmitter and receiver on."""

import numpy as np

from radar_core import AntennaArray, Pose, Waveform
from radar_sim.effects import config, phase_noise
from radar_sim.effects.base import Moment, Setting, Signal
from radar_sim.scatterers import Echoes, Motion
from radar_sim.scene import Scene, SceneRadar

BOLTZMANN = 1.380649e-23
RNG = np.random.default_rng


def a_setting(waveform=None, array=None, effects=None, **radar) -> Setting:
    radar = SceneRadar(waveform=waveform or Waveform(), array=array or AntennaArray(), mount=Pose(z=0.0), **radar)
    return Setting(Scene(radars=(radar,), effects=effects or config.Effects()), radar, 0)


def empty(setting: Setting) -> Signal:
    return Signal(np.zeros(setting.info.cube_shape, np.complex64), np.empty(0, np.uint32))


def samples(setting: Setting, seed: int = 0, rms: float = 1e-6) -> Signal:
    parts = RNG(seed).standard_normal((*setting.info.cube_shape, 2)).astype(np.float32) * np.float32(rms)
    return Signal(np.ascontiguousarray(parts).view(np.complex64)[..., 0], np.empty(0, np.uint32))


def echoes_at(*places, strength=1e-6) -> Echoes:
    n = len(places)
    motion = Motion.still(np.array(places, np.float64).reshape(n, 3))
    return Echoes(motion, motion, np.full(n, strength, np.complex128), np.zeros(n, np.int32), np.arange(n, dtype=np.int32))


def tone(setting: Setting, bins: float, amplitude: float = 1.0) -> Signal:
    """An echo that stands still, ``bins`` range bins away, alike in all channels."""
    n = setting.info.waveform.n_sample
    beat = amplitude * np.exp(2j * np.pi * bins * np.arange(n) / n)
    return Signal(np.broadcast_to(beat, setting.info.cube_shape).astype(np.complex64), np.empty(0, np.uint32))


def decibel(ratio):
    return 10 * np.log10(ratio)


def skirt(setting, cfg, bins, frames):
    """What phase noise adds to an echo, relative to the echo, shape (frame, tx, chirp, sample)."""
    effect, echo, result = phase_noise.PhaseNoise(cfg, setting), tone(setting, bins), []
    for k in range(frames):
        signal = tone(setting, bins)
        effect.process(signal, Moment(k, 0.0, 1))
        np.testing.assert_array_equal(signal.cube[:, :, 0], signal.cube[:, :, -1])  # one oscillator for all receivers
        result.append(((signal.cube - echo.cube).astype(np.complex128) * echo.cube.conj())[:, :, 0])
    return np.stack(result)
