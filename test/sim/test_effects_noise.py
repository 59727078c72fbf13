"""Thermal noise and phase noise, against k T F B and the skirt that the delay leaves."""

import math

import numpy as np
import pytest
from receivers import BOLTZMANN, RNG, a_setting, decibel, empty, samples, skirt, tone
from scipy import stats

from radar_core import SPEED_OF_LIGHT, ConfigError, Waveform
from radar_sim.effects import config, noise, phase_noise
from radar_sim.effects.base import Moment, Signal


def noise_of(setting, cfg, sequences=(0,), name_radar=0):
    effect = noise.Noise(cfg, setting)
    frames = []
    for k in sequences:
        signal = empty(setting)
        effect.process(signal, Moment(k, 0.02 * k, 5, name_radar))
        frames.append(signal.cube)
    return np.stack(frames)


@pytest.mark.parametrize("modulation", ["fmcw", "cw"])
def test_noise_is_k_t_f_b(modulation):
    """Power k T F B on 50 ohm; 131,072 samples of exponential power give a mean good to 0.3 %."""
    setting = a_setting(Waveform(modulation=modulation))
    cfg = config.NoiseConfig(noise_figure=9.0, temperature=310.0)
    power = (np.abs(noise_of(setting, cfg, range(4))) ** 2).mean() / 50
    assert power == pytest.approx(BOLTZMANN * 310.0 * 10**0.9 * 64 / 66e-6, rel=0.015)


def test_noise_is_gaussian_circular_and_white():
    """Real parts are normal (Kolmogorov-Smirnov), z^2 averages to nothing, and no two samples, channels or chirps go together."""
    cube = noise_of(a_setting(), config.NoiseConfig(), (3,))[0].astype(np.complex128)
    cube /= np.sqrt((np.abs(cube) ** 2).mean())
    for part in (cube.real, cube.imag):
        assert stats.kstest(part.ravel() * math.sqrt(2), "norm").pvalue > 1e-3
    # An average of 32,768 products of unit power is 0.0055 by chance; 5 of those.
    for other in (np.conj(cube), np.roll(cube, 1, 3), np.roll(cube, 1, 2), np.roll(cube, 1, 1), np.roll(cube, 1, 0)):
        assert abs((cube * np.conj(other)).mean()) < 0.028


def test_noise_tails():
    """Powers beyond 8 times the mean are as rare as exp(-8): 220 of 655,360, 15 by chance."""
    power = np.abs(noise_of(a_setting(), config.NoiseConfig(), range(20))) ** 2
    assert (power > 8 * power.mean()).sum() == pytest.approx(655_360 * math.exp(-8), abs=75)


def test_noise_differs_from_frame_to_frame_and_radar_to_radar():
    """Frames and radars of a scene have independent noise; the same frame has the same."""
    setting, cfg = a_setting(), config.NoiseConfig()
    one, again, later = (noise_of(setting, cfg, (k,))[0] for k in (1, 1, 2))
    other = noise_of(setting, cfg, (1,), name_radar=1)[0]
    np.testing.assert_array_equal(one, again)
    for two in (later, other):
        assert abs(np.vdot(one, two)) / np.linalg.norm(one) ** 2 < 0.03


def test_amplifier_amplifies_echoes_and_noise():
    """With 40 dB of gain everything is 100 times what it was: volts at the converter."""
    setting, moment = a_setting(), Moment(0, 0.0, 5)
    plain, loud = samples(setting), samples(setting)
    noise.Noise(config.NoiseConfig(), setting).process(plain, moment)
    noise.Noise(config.NoiseConfig(gain=40.0), setting).process(loud, moment)
    np.testing.assert_allclose(loud.cube, 100 * plain.cube, rtol=1e-6)
    only = samples(setting)
    noise.Noise(config.NoiseConfig(temperature=0.0, gain=40.0), setting).process(only, moment)
    np.testing.assert_allclose(only.cube, 100 * samples(setting).cube, rtol=1e-6)


def add_noise_reference(raw, volts, gain, cube):
    uniform = ((raw[::2].view(np.uint32) >> 1) + 0.5) / 2**31
    return gain * (cube + volts * np.sqrt(-np.log(uniform)) * np.exp(2j * np.pi * raw[1::2] / 2**32))


def test_compiled_noise_is_the_reference():
    """The kernel's logarithm and sines are those of numpy, to what single precision leaves of a power near zero."""
    raw = RNG(1).integers(-(2**31), 2**31, 20_000).astype(np.int32)
    cube = samples(a_setting(), rms=1.0).cube.reshape(-1)[:10_000].copy()
    expected = add_noise_reference(raw, 0.5, 3.0, cube.astype(np.complex128))
    noise.add_noise(raw, np.float32(0.5), np.float32(3.0), cube.view(np.float32))
    np.testing.assert_allclose(cube, expected, atol=2e-3)
    assert np.abs(cube - expected).mean() < 2e-6


def level(cfg, offset):
    """Single-sideband level as the configuration says: flat, 20 dB per decade, flat."""
    sloped = cfg.level - 20 * np.log10(np.maximum(np.abs(offset), cfg.corner) / cfg.offset)
    return 10 ** (np.maximum(sloped, cfg.floor) / 10)


@pytest.mark.parametrize("distance", [0.35, 1.03, 2.96, 5.07])
@pytest.mark.parametrize("floor", [-130.0, -82.0])
def test_phase_noise_skirt(distance, floor):
    """The skirt at the offset f is L(f) 4 sin^2(pi f tau) below the echo: 1,024 windowed spectra, 0.2 dB by chance."""
    setting, cfg = a_setting(), config.PhaseNoiseConfig(level=-90.0, offset=1e6, corner=1e5, floor=floor)
    w, window = setting.info.waveform, np.hanning(64)
    added = skirt(setting, cfg, distance / w.range_resolution, 8)
    spectrum = (np.abs(np.fft.fft(added * window)) ** 2).mean((0, 1, 2)) / (window**2).sum() * (w.chirp_duration / 64)
    offset = np.fft.fftfreq(64, w.chirp_duration / 64)
    expected = level(cfg, offset) * 4 * np.sin(np.pi * offset * 2 * distance / SPEED_OF_LIGHT) ** 2
    far = (np.abs(offset) > 60e3) & (np.abs(offset) < 440e3)  # beside the echo itself, within the band
    error = decibel(spectrum[far] / expected[far])
    assert np.abs(error).max() < 1.0
    assert abs(error.mean()) < 0.2


def test_phase_noise_is_continuous_from_chirp_to_chirp():
    """Without pauses the frame is one record, in the order of the transmitters: offsets below the chirp rate have their level too."""
    setting = a_setting(Waveform(chirp_pause=0.0))
    cfg = config.PhaseNoiseConfig(corner=3e4, floor=-200.0)
    bins = 20.5
    added = skirt(setting, cfg, bins, 16).transpose(0, 2, 1, 3).reshape(16, -1)
    step, window = 66e-6 / 64, np.hanning(added.shape[1])
    spectrum = (np.abs(np.fft.fft(added * window)) ** 2).mean(0) / (window**2).sum() * step
    offset = np.fft.fftfreq(added.shape[1], step)
    tau = 2 * bins * setting.info.waveform.range_resolution / SPEED_OF_LIGHT
    slow = (np.abs(offset) > 5e3) & (np.abs(offset) < 12e3)  # chirps come at 15 kHz; 118 bins x 16 frames: 0.1 dB by chance
    ratio = spectrum[slow] / (level(cfg, offset[slow]) * 4 * np.sin(np.pi * offset[slow] * tau) ** 2)
    assert abs(decibel(ratio.mean())) < 1.0


def test_near_echoes_keep_less_phase_noise():
    """In one frame, the skirts of two echoes differ by the square of their delays, and a frame with both has both."""
    setting, cfg, moment = a_setting(), config.PhaseNoiseConfig(), Moment(4, 0.0, 1)
    effect = phase_noise.PhaseNoise(cfg, setting)
    added = []
    for bins in ((2.5,), (40.0,), (2.5, 40.0)):
        signal = Signal(sum(tone(setting, b).cube for b in bins), np.empty(0, np.uint32))
        effect.process(signal, moment)
        added.append(signal.cube - sum(tone(setting, b).cube for b in bins))
    near, far, both = added
    ratio = np.linalg.norm(far) / np.linalg.norm(near)
    assert 20 * math.log10(ratio) == pytest.approx(20 * math.log10(16), abs=0.3)
    np.testing.assert_allclose(both, near + far, atol=1e-5 * np.abs(both).max() + 1e-6)


@pytest.mark.parametrize(("n", "limit"), [(16, 0.7), (64, 0.9), (96, 0.9), (200, 0.9), (1024, 0.9)])
def test_delay_weight(n, limit):
    """Echoes between bins, at any range from 2 cm on, are weighted by their delay: within 0.6 dB of power up to 90 % of the range."""
    w = Waveform(n_sample=n)
    weight = phase_noise.DelayWeight(w)
    share = np.concatenate([np.linspace(0.003, 0.1, 23), np.linspace(0.1, limit, 41)])
    tones = np.exp(2j * np.pi * share[:, None] * np.arange(n)).astype(np.complex64)
    tau = 2 * share * w.max_range / SPEED_OF_LIGHT
    power = (np.abs(weight.process(tones)) ** 2).mean(1) / tau**2
    assert np.abs(decibel(power)).max() < 0.6
    inner = share < min(0.7, limit)
    assert np.abs(decibel(power[inner])).max() < 0.4


def test_phase_noise_refuses_what_it_cannot_model():
    """Too strong for small phases, or no sweep: refused with the reason."""
    with pytest.raises(ConfigError, match=r"rad rms .* lower its level"):
        phase_noise.PhaseNoise(config.PhaseNoiseConfig(level=-20.0), a_setting())
