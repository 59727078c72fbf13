"""Effects of transmitter, receiver and converter, each against its own physics, on the classes themselves."""

import dataclasses
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import signal as scipy_signal
from scipy import special, stats

from radar_core import SPEED_OF_LIGHT, AntennaArray, ConfigError, Waveform, known_symbols
from radar_core.pose import Pose
from radar_sim.effects import (
    channel_errors,
    chirp_faults,
    config,
    converter,
    coupling,
    high_pass,
    interference,
    iq_imbalance,
    noise,
    phase_noise,
    transmitter,
)
from radar_sim.effects.base import Moment, Setting, Signal
from radar_sim.scatterers import Echoes, Motion
from radar_sim.scene import Scene, SceneRadar, Transmitter

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


# Noise


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
    cfg = config.Noise(noise_figure=9.0, temperature=310.0)
    power = (np.abs(noise_of(setting, cfg, range(4))) ** 2).mean() / 50
    assert power == pytest.approx(BOLTZMANN * 310.0 * 10**0.9 * 64 / 66e-6, rel=0.015)


def test_noise_is_gaussian_circular_and_white():
    """Real parts are normal (Kolmogorov-Smirnov), z^2 averages to nothing, and no two samples, channels or chirps go together."""
    cube = noise_of(a_setting(), config.Noise(), (3,))[0].astype(np.complex128)
    cube /= np.sqrt((np.abs(cube) ** 2).mean())
    for part in (cube.real, cube.imag):
        assert stats.kstest(part.ravel() * math.sqrt(2), "norm").pvalue > 1e-3
    # An average of 32,768 products of unit power is 0.0055 by chance; 5 of those.
    for other in (np.conj(cube), np.roll(cube, 1, 3), np.roll(cube, 1, 2), np.roll(cube, 1, 1), np.roll(cube, 1, 0)):
        assert abs((cube * np.conj(other)).mean()) < 0.028


def test_noise_tails():
    """Powers beyond 8 times the mean are as rare as exp(-8): 220 of 655,360, 15 by chance."""
    power = np.abs(noise_of(a_setting(), config.Noise(), range(20))) ** 2
    assert (power > 8 * power.mean()).sum() == pytest.approx(655_360 * math.exp(-8), abs=75)


def test_noise_differs_from_frame_to_frame_and_radar_to_radar():
    """Frames and radars of a scene have independent noise; the same frame has the same."""
    setting, cfg = a_setting(), config.Noise()
    one, again, later = (noise_of(setting, cfg, (k,))[0] for k in (1, 1, 2))
    other = noise_of(setting, cfg, (1,), name_radar=1)[0]
    np.testing.assert_array_equal(one, again)
    for two in (later, other):
        assert abs(np.vdot(one, two)) / np.linalg.norm(one) ** 2 < 0.03


def test_amplifier_amplifies_echoes_and_noise():
    """With 40 dB of gain everything is 100 times what it was: volts at the converter."""
    setting, moment = a_setting(), Moment(0, 0.0, 5)
    plain, loud = samples(setting), samples(setting)
    noise.Noise(config.Noise(), setting).process(plain, moment)
    noise.Noise(config.Noise(gain=40.0), setting).process(loud, moment)
    np.testing.assert_allclose(loud.cube, 100 * plain.cube, rtol=1e-6)
    only = samples(setting)
    noise.Noise(config.Noise(temperature=0.0, gain=40.0), setting).process(only, moment)
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


# Coupling and the high-pass filter


def test_coupling_level_and_phase():
    """Leaked power is the transmitted 12 dBm less the level; its phase is 2 pi (f_min tau + slope tau t - slope tau^2 / 2)."""
    setting = a_setting()
    signal = empty(setting)
    coupling.Coupling(config.Coupling(level=-55.0, distance=0.3), setting).process(signal, Moment(0, 0.0))
    np.testing.assert_allclose(np.abs(signal.cube) ** 2 / 50, 1e-3 * 10 ** (1.2 - 5.5), rtol=1e-5)
    w, tau = setting.info.waveform, 2 * 0.3 / SPEED_OF_LIGHT
    turns = (w.carrier - w.bandwidth / 2) * tau + w.slope * tau * np.arange(64) / 64 * 66e-6 - w.slope * tau**2 / 2
    unit = signal.cube / np.abs(signal.cube)
    np.testing.assert_allclose(unit, np.broadcast_to(np.exp(2j * np.pi * turns), unit.shape), atol=2e-6)


def test_coupling_adds_to_what_is_there():
    """Echoes go through it as they were."""
    setting = a_setting()
    alone, both = empty(setting), samples(setting)
    effect = coupling.Coupling(config.Coupling(), setting)
    effect.process(alone, Moment(0, 0.0))
    effect.process(both, Moment(0, 0.0))
    np.testing.assert_array_equal(both.cube, samples(setting).cube + alone.cube)


def test_coupling_of_a_tone_has_the_carrier_phase():
    """A tone leaks with its carrier's phase, constant over time."""
    setting, signal = a_setting(Waveform(modulation="cw")), empty(a_setting())
    coupling.Coupling(config.Coupling(distance=0.03), setting).process(signal, Moment(0, 0.0))
    expected = np.exp(2j * np.pi * 76.75e9 * 0.06 / SPEED_OF_LIGHT)
    np.testing.assert_allclose(signal.cube / np.abs(signal.cube), expected, atol=1e-5)


def test_coupling_of_ofdm_symbols():
    """Each symbol leaks with what it carries: divided by it, the carriers turn by 2 pi f_k tau; the power is as said."""
    n, duration = 64, 64 / 1.5e9
    setting = a_setting(Waveform(modulation="ofdm", chirp_duration=duration, bandwidth=1.5e9))
    signal = empty(setting)
    coupling.Coupling(config.Coupling(level=-60.0, distance=0.5), setting).process(signal, Moment(0, 0.0))
    assert (np.abs(signal.cube) ** 2).mean() / 50 == pytest.approx(1e-3 * 10 ** (1.2 - 6.0), rel=1e-5)
    carriers = np.fft.ifft(signal.cube, norm="ortho") * known_symbols(setting.info.waveform)[:, :, None, :]
    frequency = 76.75e9 - 0.75e9 + np.arange(n) / duration
    expected = np.exp(2j * np.pi * frequency / SPEED_OF_LIGHT)
    np.testing.assert_allclose(carriers / np.abs(carriers), np.broadcast_to(expected, carriers.shape), atol=1e-4)


@pytest.mark.parametrize("order", [1, 2, 3, 8])
def test_high_pass_is_the_butterworth_filter(order):
    """Its response is scipy's analogue filter, 3 dB down at the corner, 20 dB per decade and order below."""
    cfg = config.HighPass(corner=150e3, order=order)
    frequency = np.geomspace(1e3, 1e7, 50)
    zeros, poles, gain = scipy_signal.butter(order, 2 * math.pi * 150e3, "highpass", analog=True, output="zpk")
    expected = scipy_signal.freqs_zpk(zeros, poles, gain, 2 * math.pi * frequency)[1]
    np.testing.assert_allclose(high_pass.response(cfg, frequency), expected, rtol=1e-9)
    corner, low, lower = np.abs(high_pass.response(cfg, np.array([150e3, 1500.0, 150.0])))
    assert decibel(corner**2) == pytest.approx(-3.01, abs=0.01)
    assert decibel(low**2 / lower**2) == pytest.approx(20 * order, abs=0.01)
    assert high_pass.response(cfg, 0.0) == 0


def test_high_pass_on_echoes():
    """At the range that beats at the corner an echo is 3 dB weaker and 45 degrees ahead; a far one is nearly as it was."""
    setting = a_setting()
    at_corner = 100e3 * SPEED_OF_LIGHT / (2 * setting.info.waveform.slope)
    before = echoes_at((at_corner, 0, 0), (6.0, 0, 0))
    after = high_pass.HighPass(config.HighPass(corner=100e3), setting).process(before, Moment(0, 0.0))
    near, far = after.strength / before.strength
    assert near == pytest.approx((1 + 1j) / 2, abs=1e-9)
    assert abs(far) == pytest.approx(1.0, abs=0.01)
    assert after.out is before.out


def test_high_pass_holds_coupling_down():
    """Coupling at 3 cm beats at 4.5 kHz: 100 kHz of corner take 27 dB off it."""
    cfg, frequency = config.Coupling(distance=0.03), 1.5e9 / 66e-6 * 0.06 / SPEED_OF_LIGHT
    cubes = []
    for effects in (config.Effects(), config.Effects(high_pass=config.HighPass(corner=100e3))):
        signal = empty(a_setting())
        coupling.Coupling(cfg, a_setting(effects=effects)).process(signal, Moment(0, 0.0))
        cubes.append(signal.cube)
    ratio = cubes[1] / cubes[0]
    np.testing.assert_allclose(ratio, 1 / (1 + 100e3 / (1j * frequency)), rtol=1e-4)


# Phase noise


def skirt(setting, cfg, bins, frames):
    """What phase noise adds to an echo, relative to the echo, shape (frame, tx, chirp, sample)."""
    effect, echo, result = phase_noise.PhaseNoise(cfg, setting), tone(setting, bins), []
    for k in range(frames):
        signal = tone(setting, bins)
        effect.process(signal, Moment(k, 0.0, 1))
        np.testing.assert_array_equal(signal.cube[:, :, 0], signal.cube[:, :, -1])  # one oscillator for all receivers
        result.append(((signal.cube - echo.cube).astype(np.complex128) * echo.cube.conj())[:, :, 0])
    return np.stack(result)


def level(cfg, offset):
    """Single-sideband level as the configuration says: flat, 20 dB per decade, flat."""
    sloped = cfg.level - 20 * np.log10(np.maximum(np.abs(offset), cfg.corner) / cfg.offset)
    return 10 ** (np.maximum(sloped, cfg.floor) / 10)


@pytest.mark.parametrize("distance", [0.35, 1.03, 2.96, 5.07])
@pytest.mark.parametrize("floor", [-130.0, -82.0])
def test_phase_noise_skirt(distance, floor):
    """The skirt at the offset f is L(f) 4 sin^2(pi f tau) below the echo: 1,024 windowed spectra, 0.2 dB by chance."""
    setting, cfg = a_setting(), config.PhaseNoise(level=-90.0, offset=1e6, corner=1e5, floor=floor)
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
    cfg = config.PhaseNoise(corner=3e4, floor=-200.0)
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
    setting, cfg, moment = a_setting(), config.PhaseNoise(), Moment(4, 0.0, 1)
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
        phase_noise.PhaseNoise(config.PhaseNoise(level=-20.0), a_setting())


@pytest.mark.parametrize(
    ("make", "name"),
    [
        (lambda s: high_pass.HighPass(config.HighPass(), s), "high_pass"),
        (lambda s: phase_noise.PhaseNoise(config.PhaseNoise(), s), "phase_noise"),
        (lambda s: interference.Interference(config.Interference(), s), "interference"),
    ],
)
@pytest.mark.parametrize("waveform", [Waveform(modulation="cw"), Waveform(modulation="ofdm", bandwidth=1.5e9, chirp_duration=64 / 1.5e9)])
def test_effects_of_sweeps_refuse_other_radars(make, name, waveform):
    """The error names effect, radar and modulation, and says why."""
    with pytest.raises(ConfigError, match=rf"effects.{name} .*'radar'.* {waveform.modulation}: .*; leave it out") as caught:
        make(a_setting(waveform))
    assert caught.value.key == ("effects", name)


# Mixer and converter


@pytest.mark.parametrize(("gain", "phase"), [(0.5, 0.0), (0.0, 0.05), (-1.5, -0.2), (3.0, 1.0)])
def test_iq_image(gain, phase):
    """An echo at +f gets an image at -f, of the level that gain and phase predict: |1 - g e^-jp|^2 / |1 + g e^jp|^2."""
    setting, signal = a_setting(), tone(a_setting(), 10.0)
    iq_imbalance.IqImbalance(config.IqImbalance(gain=gain, phase=phase), setting).process(signal, Moment(0, 0.0))
    bins = np.abs(np.fft.fft(signal.cube)[0, 0, 0] / 64)
    g = 10 ** (gain / 20)
    image = (1 + g**2 - 2 * g * math.cos(phase)) / (1 + g**2 + 2 * g * math.cos(phase))
    assert bins[54] ** 2 / bins[10] ** 2 == pytest.approx(image, rel=1e-4)
    assert np.delete(bins, [10, 54]).max() < 1e-6
    assert iq_imbalance.image(config.IqImbalance(gain=gain, phase=phase)) ** 2 == pytest.approx(image)


def test_iq_arms():
    """I stays; Q is g (Q cos p + I sin p); the offset comes on both."""
    setting, signal = a_setting(), samples(a_setting(), rms=1.0)
    before = signal.cube.astype(np.complex128)
    iq_imbalance.IqImbalance(config.IqImbalance(gain=2.0, phase=0.3, offset=0.25), setting).process(signal, Moment(0, 0.0))
    g = 10**0.1
    np.testing.assert_allclose(signal.cube.real, before.real + 0.25, atol=1e-6)
    np.testing.assert_allclose(signal.cube.imag, g * (before.imag * math.cos(0.3) + before.real * math.sin(0.3)) + 0.25, atol=2e-6)


def test_balanced_mixer_changes_nothing():
    """No gain, no phase, no offset: bit for bit."""
    signal = samples(a_setting())
    iq_imbalance.IqImbalance(config.IqImbalance(gain=0.0, phase=0.0, offset=0.0), a_setting()).process(signal, Moment(0, 0.0))
    np.testing.assert_array_equal(signal.cube, samples(a_setting()).cube)


def counts(bits, volts, limit=1.0):
    signal = Signal(np.asarray(volts, np.complex64).reshape(1, 1, 1, -1).copy(), np.empty(0, np.uint32))
    converter.Converter(config.Converter(bits=bits, full_scale=limit), a_setting()).process(signal, Moment(0, 0.0))
    return signal.cube.reshape(-1)


def test_quantisation_noise():
    """Rounding adds q^2 / 12 to each component when the signal covers many counts: 65,536 errors give it to 0.35 %."""
    signal = samples(a_setting(), rms=0.2)
    before = signal.cube.astype(np.complex128)
    converter.Converter(config.Converter(bits=10, full_scale=1.0), a_setting()).process(signal, Moment(0, 0.0))
    inside = (np.abs(before.real) < 0.99) & (np.abs(before.imag) < 0.99)
    error = (signal.cube.astype(np.complex128) / 512 - before)[inside]
    for part in (error.real, error.imag):
        assert (part**2).mean() == pytest.approx((1 / 512) ** 2 / 12, rel=0.02)
        assert abs(part.mean()) < 1e-5


def test_rounding_and_clipping():
    """Halves go to even; beyond full scale are -2^(bits-1) and 2^(bits-1) - 1."""
    lsb = 1 / 8
    given_volts = [0.5 * lsb, 1.5 * lsb, 2.5 * lsb, -0.5 * lsb, -1.5 * lsb, 5.0, -5.0, 0.99, 1j * 7.4 * lsb, -1j]
    np.testing.assert_array_equal(counts(4, given_volts), [0, 2, 2, 0, -2, 7, -8, 7, 7j, -8j])
    assert converter.full_scale(config.Converter(bits=4)) == 7
    assert converter.full_scale(config.Converter(bits=12)) == 2047


def test_one_bit():
    """One bit has two counts."""
    np.testing.assert_array_equal(counts(1, [1.0, 0.2, -0.2, -0.7, -9.0, 9j, -9j]), [0, 0, 0, -1, -1, 0, -1j])


@settings(max_examples=50, deadline=None)
@given(bits=st.integers(1, 24), volts=st.floats(-(2.0**100), 2.0**100, width=32), limit=st.floats(2.0**-39, 1e6))
def test_counts_are_whole_numbers_in_range(bits, volts, limit):
    """Whatever comes in, what comes out is a count."""
    (count,) = counts(bits, [volts], limit)
    assert count.real == round(float(count.real))
    assert -(2 ** (bits - 1)) <= count.real <= 2 ** (bits - 1) - 1


# Channels and chirps


def test_channel_errors_have_the_size_they_say():
    """256 channels: rms gain and phase within 15 % (4.4 % by chance), factors on the cube channel by channel."""
    array = AntennaArray(tx=((0.0, 0.0),) * 16, rx=((0.0, 0.0),) * 16)
    setting = a_setting(Waveform(n_tx=16, n_chirp=4, n_sample=8), array)
    cfg = config.ChannelErrors(gain=1.5, phase=0.2, shift=1e-4)
    factor = channel_errors.factors(cfg, setting)
    assert np.std(20 * np.log10(np.abs(factor))) == pytest.approx(1.5, rel=0.15)
    assert np.std(np.angle(factor)) == pytest.approx(0.2, rel=0.15)
    signal = samples(setting)
    channel_errors.ChannelErrors(cfg, setting).process(signal, Moment(0, 0.0))
    expected = samples(setting).cube * factor.reshape(16, 1, 16, 1)
    np.testing.assert_allclose(signal.cube, expected, rtol=1e-5)


def test_element_places():
    """Places are off by the shift in y and z, virtual ones by both their elements' errors; without shift they are as drawn."""
    array = AntennaArray(tx=((0.0, 0.01),) * 40, rx=((0.02, 0.0),) * 40)
    setting = a_setting(Waveform(n_tx=40, n_chirp=1), array)
    tx, rx = channel_errors.elements(config.ChannelErrors(shift=2e-4), setting)
    for real, drawn in ((tx, (0.0, 0.01)), (rx, (0.02, 0.0))):
        assert real.shape == (40, 2)
        assert np.std(real - drawn) == pytest.approx(2e-4, rel=0.3)
    np.testing.assert_array_equal(channel_errors.elements(config.ChannelErrors(shift=0.0), setting)[0], np.asarray(array.tx))


def test_channel_errors_belong_to_the_radar():
    """The scene's seed and the frame do not change them; their own seed and another radar do; each kind is drawn on its own."""
    setting, cfg = a_setting(), config.ChannelErrors(seed=3)
    other_scene = dataclasses.replace(setting, scene=dataclasses.replace(setting.scene, seed=9))
    np.testing.assert_array_equal(channel_errors.factors(cfg, setting), channel_errors.factors(cfg, other_scene))
    for other_cfg, other_setting in ((config.ChannelErrors(seed=4), setting), (cfg, a_setting(frame_id="left/radar"))):
        assert not np.allclose(channel_errors.factors(cfg, setting), channel_errors.factors(other_cfg, other_setting))
    flat = channel_errors.factors(dataclasses.replace(cfg, gain=0.0), setting)
    np.testing.assert_allclose(flat, np.exp(1j * np.angle(channel_errors.factors(cfg, setting))), atol=1e-12)


def test_dropped_chirps():
    """Lost chirps hold zeros and are listed in order; the share is as said: 3,840 chirps, 14 by chance."""
    setting, lost = a_setting(), 0
    effect = chirp_faults.ChirpFaults(config.ChirpFaults(dropped=0.05), setting)
    for k in range(30):
        signal = samples(setting)
        effect.process(signal, Moment(k, 0.0, 2))
        assert signal.missing.dtype == np.uint32
        expected = samples(setting).cube
        for number in signal.missing:
            chirp, tx = divmod(int(number), 2)
            expected[tx, chirp] = 0
        np.testing.assert_array_equal(signal.cube, expected)
        assert np.all(np.diff(signal.missing.astype(int)) > 0)
        lost += len(signal.missing)
    assert lost == pytest.approx(0.05 * 3840, abs=55)


def test_lateness():
    """The share of late chirps and their delays are as said, and have nothing to do with which are dropped."""
    setting, moments = a_setting(), [Moment(k, 0.0, 2) for k in range(30)]
    effect = chirp_faults.ChirpFaults(config.ChirpFaults(dropped=0.3, late=0.4, delay=20e-6), setting)
    late = np.stack([effect.late(m) for m in moments])
    assert late.shape == (30, 64, 2)
    assert (late > 0).mean() == pytest.approx(0.4, abs=0.04)  # 0.008 by chance
    assert stats.kstest(late[late > 0], "uniform", (0, 20e-6)).pvalue > 1e-3
    missing = []
    for m in moments:
        signal = empty(setting)
        effect.process(signal, m)
        missing.append(np.isin(np.arange(128), signal.missing).reshape(64, 2))
    assert abs(np.corrcoef(np.stack(missing).ravel(), (late > 0).ravel())[0, 1]) < 0.08  # 0.016 by chance
    assert chirp_faults.ChirpFaults(config.ChirpFaults(dropped=0.3), setting).late(moments[0]) is None


def test_lateness_within_the_pause():
    """Later than the pause is refused with both numbers; a delay that never happens is not."""
    setting = a_setting(Waveform(chirp_pause=8e-6))
    with pytest.raises(ConfigError, match=r"10 us.* 8 us"):
        chirp_faults.ChirpFaults(config.ChirpFaults(late=0.1, delay=10e-6), setting)
    chirp_faults.ChirpFaults(config.ChirpFaults(late=0.0, delay=10e-6), setting)


# Interference


def crossing_reference(starts, ours, theirs, n):
    """`cross` in numpy, with scipy's Fresnel integrals."""
    f0, slope, duration, rate = ours
    f1, slope1, duration1, interval1, turns1 = theirs
    bursts, t = np.zeros((len(starts), n), complex), np.arange(n) / rate
    alpha = slope - slope1
    for k, start in enumerate(starts):
        q = np.floor((start + t) / interval1)
        since = start + t - q * interval1
        difference = f0 + slope * t - f1 - slope1 * since
        turns = f0 * t + slope * t**2 / 2 - f1 * since - slope1 * since**2 / 2 - q * turns1
        integral = 0
        for sign, edge in ((1, rate), (-1, 0.0)):
            s, c = special.fresnel((edge - difference) * math.sqrt(2 / abs(alpha)))
            integral = integral + sign * (c - 1j * np.sign(alpha) * s)
        wave = (1 + 1j * np.sign(alpha)) / 2 * integral * np.exp(2j * np.pi * turns)
        on = since < duration1
        for number in np.unique(q):  # sweeps that do not come through leave nothing
            mine = on & (q == number)
            begin = number * interval1 - start
            ends = [(f0 + slope * x - f1 - slope1 * (x - begin)) for x in (max(begin, 0.0), min(begin + duration1, duration))]
            if mine.any() and max(ends) >= 0 and min(ends) < rate:
                bursts[k, mine] = wave[mine]
    return bursts


@pytest.mark.parametrize(("bandwidth", "duration"), [(1.0e9, 40e-6), (1.45e9, 66e-6), (0.0, 50e-6), (3e9, 70e-6)])
def test_compiled_crossings_are_the_reference(bandwidth, duration):
    """The kernel equals numpy with exact Fresnel integrals: its own are good to 2e-3 each, four of them to 6e-3."""
    cfg = config.Interference(bandwidth=bandwidth, duration=duration)
    w = Waveform()
    ours, theirs = interference._ours(w), interference._theirs(cfg)
    starts = 0.02 + np.arange(128) * w.chirp_interval
    bursts = np.zeros((128, 64), np.complex64)
    assert interference.cross(starts, ours, theirs, bursts) > 2
    expected = crossing_reference(starts, ours, theirs, 64)
    assert np.abs(expected).max() > 0.15
    np.testing.assert_allclose(bursts, expected, atol=6e-3)


def test_burst_is_what_an_ideal_filter_leaves():
    """Mixing both sweeps at 2,000 times the rate and cutting the band out of the spectrum gives the same burst.

    The cut record repeats itself and begins and ends sharply, which leaves tails of some percent; the burst is at its middle.
    """
    w = Waveform()
    cfg = config.Interference(bandwidth=1.4e9, duration=66e-6, pause=0.0, drift=0.0, carrier=76.75e9)
    f0, slope, duration, rate = interference._ours(w)
    f1, slope1, *_ = interference._theirs(cfg)
    start = 0.0
    fine = 4096 * 64
    t = np.arange(fine) / fine * duration
    difference = (f0 - f1) * t + (slope - slope1) * t**2 / 2
    spectrum = np.fft.fft(np.exp(2j * np.pi * difference))
    spectrum[64:] = 0  # 64 bins of 1 / duration are the band [0, rate)
    expected = np.fft.ifft(spectrum)[:: fine // 64]
    bursts = np.zeros((1, 64), np.complex64)
    assert interference.cross(np.array([start]), interference._ours(w), interference._theirs(cfg), bursts) == 1
    at = int(np.argmax(np.abs(expected)))
    assert abs(at / rate - (f1 - f0) / (slope - slope1)) < 2 / rate
    window = slice(at - 3, at + 4)
    assert np.abs(expected[window]).max() > 0.3
    np.testing.assert_allclose(bursts[0, window], expected[window], atol=0.05)


def test_crossing_where_computed():
    """The burst is at the sample where both sweeps meet, and nowhere else."""
    w = Waveform(n_tx=1, n_chirp=1)
    setting = a_setting(w, AntennaArray(tx=((0.0, 0.0),)))
    for carrier in (76.5e9, 76.75e9, 77.0e9):
        # It starts its sweeps with ours, at half the slope: they meet where our head start is made up for.
        cfg = config.Interference(position=(2.0, 0.0, 0.0), carrier=carrier, bandwidth=0.75e9, duration=66e-6, pause=50e-6, drift=0.0)
        signal = empty(setting)
        interference.Interference(cfg, setting).process(signal, Moment(0, 0.0))
        meet = (carrier - 0.375e9 - 76.0e9) / (w.slope / 2) * 64 / 66e-6
        power = np.abs(signal.cube[0, 0, 0]) ** 2
        if 0 <= meet < 64:
            assert abs(int(np.argmax(power)) - meet) <= 1.0
            assert power[max(int(meet) - 2, 0) : int(meet) + 4].sum() > 0.8 * power.sum()
        else:
            assert not power.any()


def rise(cfg, frames, setting):
    effect, total = interference.Interference(cfg, setting), []
    for k in range(frames):
        signal = empty(setting)
        noise.Noise(config.Noise(), setting).process(signal, Moment(k, 0.02 * k, 1))
        before = (np.abs(signal.cube) ** 2).mean()
        effect.process(signal, Moment(k, 0.02 * k, 1))
        total.append((before, (np.abs(signal.cube) ** 2).mean()))
    before, after = np.mean(total, 0)
    return decibel(after / before)


@pytest.mark.parametrize(
    "cfg",
    [
        config.Interference(),
        config.Interference(bandwidth=0.0, pause=0.0, power=30.0),
        config.Interference(bandwidth=0.3e9, duration=17e-6, pause=6.1e-6, carrier=76.3e9),
        config.Interference(bandwidth=1.2e9, duration=63e-6, pause=4.7e-6, drift=1e-4),
        config.Interference(bandwidth=2.0e9, duration=21e-6, pause=3.3e-6, carrier=77.4e9, power=30.0),
    ],
)
def test_interference_raises_the_floor_as_predicted(cfg):
    """Friis power times the share of time in band, averaged over 150 frames, is the rise of the floor, within 0.5 dB."""
    setting = a_setting()
    distance = np.linalg.norm(cfg.position)
    friis = 1e-3 * 10 ** ((cfg.power + 10.0) / 10) * (SPEED_OF_LIGHT / 76.75e9 / (4 * np.pi * distance)) ** 2
    # Wherever it is in its sweep, we are in band for one receiver's width of ours.
    theirs = cfg.carrier + cfg.bandwidth * ((np.arange(3000) + 0.5) / 3000 - 0.5)
    width = np.minimum(theirs + 64 / 66e-6, 77.5e9) - np.maximum(theirs, 76.0e9)
    in_band = np.maximum(width, 0).mean() / 1.5e9 * cfg.duration / (cfg.duration + cfg.pause)
    assert interference.share(cfg, Waveform()) == pytest.approx(in_band, rel=2e-3)
    assert interference.mean_power(cfg, setting) == pytest.approx(friis * in_band, rel=2e-3)
    predicted = decibel(1 + friis * in_band / noise.power(config.Noise(), setting.info))
    assert predicted > 1.0
    assert rise(cfg, 150, setting) == pytest.approx(predicted, abs=0.5)


@pytest.mark.parametrize("carrier", [74.0e9, 80.0e9])
def test_interference_out_of_band(carrier):
    """A band that does not overlap ours leaves every sample as it was, bit for bit."""
    setting, cfg = a_setting(), config.Interference(carrier=carrier)
    effect = interference.Interference(cfg, setting)
    for k in range(5):
        signal = samples(setting)
        effect.process(signal, Moment(k, 0.02 * k))
        np.testing.assert_array_equal(signal.cube, samples(setting).cube)
    assert interference.share(cfg, Waveform()) == 0.0
    assert interference.size(cfg, setting, Echoes.none()).startswith("floor raised by 0.0 dB")


def test_interference_comes_as_a_plane_wave():
    """Between receivers it turns by -2 pi p.u / lambda; from behind the array nothing comes."""
    setting, cfg = a_setting(), config.Interference(position=(3.0, 1.5, 0.5))
    signal = empty(setting)
    interference.Interference(cfg, setting).process(signal, Moment(0, 0.0))
    direction = np.array([3.0, 1.5, 0.5]) / np.linalg.norm([3.0, 1.5, 0.5])
    expected = np.exp(-2j * np.pi / setting.info.waveform.wavelength * np.asarray(setting.array.rx) @ direction[1:])
    hit = np.abs(signal.cube[:, :, 0]) > 0.1 * np.abs(signal.cube).max()
    for j in range(4):
        np.testing.assert_allclose(signal.cube[:, :, j][hit] / signal.cube[:, :, 0][hit], expected[j] / expected[0], atol=1e-5)
    behind = empty(setting)
    interference.Interference(config.Interference(position=(-3.0, 1.5, 0.5)), setting).process(behind, Moment(0, 0.0))
    assert not behind.cube.any()


def test_interference_runs_on_between_frames():
    """Bursts of a frame depend on scene time only: one frame that begins where another's second half does has the same bursts."""
    setting, cfg = a_setting(Waveform(n_chirp=32, frame_interval=0.01)), config.Interference()
    w, effect = setting.info.waveform, interference.Interference(cfg, setting)
    one, two = empty(setting), empty(setting)
    effect.process(one, Moment(0, 1.0))
    effect.process(two, Moment(7, 1.0 + 16 * w.slow_interval))
    assert np.abs(one.cube[:, 16:]).max() > 0
    # Times of 1 s are known to 1e-16, phases of 77 GHz to 2e-5 turns; where a sweep's end falls on a sample it may be in or out.
    np.testing.assert_allclose(one.cube[:, 16:], two.cube[:, :16], atol=1e-2 * np.abs(one.cube).max())


# Transmitters


def tapered(kind, taper, setting=None):
    setting = setting or a_setting()
    signal = samples(setting)
    transmitter.AmplitudeModulation(Transmitter(amplitude=kind, taper=taper), setting).process(signal, Moment(0, 0.0))
    return signal.cube, samples(setting).cube


def test_intra_tapers_each_chirp():
    """Every chirp has the same taper over its samples, 1 at its peak."""
    after, before = tapered("intra", "chebwin:60")
    expected = scipy_signal.get_window(("chebwin", 60.0), 64)
    np.testing.assert_allclose(after, before * (expected / expected.max()), rtol=1e-5, atol=1e-12)


def test_inter_tapers_from_chirp_to_chirp():
    """Within a chirp the amplitude is constant, equal for all transmitters and receivers."""
    after, before = tapered("inter", "hamming")
    expected = scipy_signal.get_window("hamming", 64)[:, None, None]
    np.testing.assert_allclose(after, before * expected, rtol=1e-5)
    odd = tapered("inter", "hann", a_setting(Waveform(n_chirp=5)))
    assert np.abs(odd[0] / odd[1]).max() == pytest.approx(1.0)


def test_constant_amplitude_changes_nothing():
    """Bit for bit."""
    after, before = tapered("constant", "hann")
    np.testing.assert_array_equal(after, before)


@pytest.mark.parametrize("taper", ["hannn", "chebwin", "chebwin:x", "kaiser:1:2"])
def test_unknown_tapers(taper):
    """Names and parameters that scipy does not know are refused with a remedy."""
    with pytest.raises(ConfigError, match=r"transmitter\.taper: .* use a name of scipy"):
        tapered("intra", taper)


def test_elements_that_send_together():
    """Four half-wave elements: four times the power ahead, nothing where they cancel, half the power of two from the side."""
    half = SPEED_OF_LIGHT / 76.75e9 / 2
    setting = a_setting(Waveform(n_tx=1), AntennaArray(tx=((0.0, 0.0),)))
    cfg = Transmitter(together=tuple((k * half, 0.0) for k in range(4)))
    null = math.asin(0.5)  # 4 elements: first null at sin = 2 / 4
    echoes = echoes_at((2, 0, 0), (3 * math.cos(null), 3 * math.sin(null), 0), (2, 0, 1.0), (1, 2, 0.5))
    after = transmitter.Together(cfg, setting).process(echoes, Moment(0, 0.0))
    factor = after.strength / echoes.strength
    np.testing.assert_allclose(np.abs(factor[:3]) ** 2, [4.0, 0.0, 4.0], atol=1e-9)
    side = 2 / math.sqrt(1 + 4 + 0.25)
    assert factor[3] == pytest.approx(sum(np.exp(-1j * np.pi * k * side) for k in range(4)) / 2)


def test_one_element_alone_is_itself():
    """One element where the transmitter stands changes nothing; elsewhere it turns phases only."""
    setting = a_setting(Waveform(n_tx=1), AntennaArray(tx=((0.001, 0.0),)))
    echoes = echoes_at((2, 1, 0.3), (4, -1, 0))
    same = transmitter.Together(Transmitter(together=((0.001, 0.0),)), setting).process(echoes, Moment(0, 0.0))
    np.testing.assert_array_equal(same.strength, echoes.strength)
    moved = transmitter.Together(Transmitter(together=((0.002, 0.0),)), setting).process(echoes, Moment(0, 0.0))
    np.testing.assert_allclose(np.abs(moved.strength), np.abs(echoes.strength))


def test_two_beams_radiate_what_one_does():
    """Power is shared, not made: over all directions in a plane, elements far apart send as much as one does."""
    setting = a_setting(Waveform(n_tx=1), AntennaArray(tx=((0.0, 0.0),)))
    angle = np.linspace(-np.pi, np.pi, 4001)[:-1]
    echoes = echoes_at(*np.stack([np.cos(angle), np.sin(angle), 0 * angle], -1))
    after = transmitter.Together(Transmitter(together=((-0.1, 0.0), (0.1, 0.0))), setting).process(echoes, Moment(0, 0.0))
    # The mean of the cross term is the Bessel function J0(2 pi 0.2 / lambda): 0.04 here.
    assert (np.abs(after.strength / echoes.strength) ** 2).mean() == pytest.approx(1.0, abs=0.05)


@pytest.mark.parametrize(
    "make",
    [
        lambda s: noise.Noise(config.Noise(temperature=0.0), s),
        lambda s: channel_errors.ChannelErrors(config.ChannelErrors(gain=0.0, phase=0.0), s),
        lambda s: chirp_faults.ChirpFaults(config.ChirpFaults(dropped=0.0, late=0.5), s),
        lambda s: coupling.Coupling(config.Coupling(level=-300.0), s),
        lambda s: transmitter.AmplitudeModulation(Transmitter(amplitude="intra", taper="boxcar"), s),
    ],
)
def test_effects_of_no_size_change_nothing(make):
    """An effect turned down to nothing leaves samples bit for bit."""
    setting, signal = a_setting(), samples(a_setting(), rms=1e-3)
    make(setting).process(signal, Moment(0, 0.0))
    np.testing.assert_array_equal(signal.cube, samples(setting, rms=1e-3).cube)
    assert not len(signal.missing)


# What `explain` says


def sizes(echoes, setting):
    return {
        "noise": noise.size(config.Noise(), setting, echoes),
        "coupling": coupling.size(config.Coupling(), setting, echoes),
        "high_pass": high_pass.size(config.HighPass(), setting, echoes),
        "phase_noise": phase_noise.size(config.PhaseNoise(), setting, echoes),
        "iq_imbalance": iq_imbalance.size(config.IqImbalance(), setting, echoes),
        "converter": converter.size(config.Converter(), setting, echoes),
        "channel_errors": channel_errors.size(config.ChannelErrors(), setting, echoes),
        "chirp_faults": chirp_faults.size(config.ChirpFaults(), setting, echoes),
        "interference": interference.size(config.Interference(), setting, echoes),
    }


def test_sizes_are_right():
    """The figures are those of the closed forms, for an echo of 1 uV at 2 m."""
    said = sizes(echoes_at((2.0, 0, 0), strength=4e-6), a_setting())
    snr = decibel(1e-12 / 50 / (BOLTZMANN * 290 * 10**1.2 * 64 / 66e-6) * 64 * 64)
    assert said["noise"].startswith("noise -102.1 dBm")
    assert f" {snr:.0f} dB" in said["noise"]
    assert said["coupling"] == f"-48.0 dBm, {decibel(1e-3 * 10**-4.8 * 50 / 1e-12):+.1f} dB against the strongest echo"
    beat = 1.5e9 / 66e-6 * 4 / SPEED_OF_LIGHT
    assert said["high_pass"].startswith(f"{-decibel(1 + (1e5 / beat) ** 2):.1f} dB at the nearest echo (2.00 m)")
    assert said["iq_imbalance"].startswith("image 28")
    assert said["converter"] == "1 LSB = 977 nV, at most 0.05 % of full scale"
    assert said["chirp_faults"].startswith("1.28 of 128 chirps lost, 0 late")
    assert "dB, " in said["channel_errors"]
    assert said["interference"].startswith("floor raised by ")


def test_sizes_of_phase_noise():
    """The skirt below an echo, in a cell of range and Doppler, is what a frame of one echo shows."""
    setting, cfg = a_setting(), config.PhaseNoise()
    w, distance = setting.info.waveform, 2.5 * setting.info.waveform.range_resolution * 10
    added = skirt(setting, cfg, 25.0, 8)
    measured = -decibel((np.abs(added) ** 2).mean() / (w.n_sample * w.n_chirp))
    said = phase_noise.size(cfg, setting, echoes_at((distance, 0, 0)))
    assert float(said.split()[1]) == pytest.approx(measured, abs=0.8)  # rounded to 1 dB


@pytest.mark.parametrize(
    "waveform", [Waveform(), Waveform(modulation="cw"), Waveform(modulation="ofdm", bandwidth=1.5e9, chirp_duration=64 / 1.5e9)]
)
@pytest.mark.parametrize("echoes", [Echoes.none(), echoes_at((0, 0, 0), (3, 0, 0), strength=0.0)])
def test_sizes_without_echoes(waveform, echoes):
    """No echo, or none with any power, is no reason to fail; each says one line, whatever the modulation."""
    for line in sizes(echoes, a_setting(waveform)).values():
        assert line
        assert "\n" not in line
