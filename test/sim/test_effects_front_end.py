"""Coupling, the high-pass filter, mixer and converter, each against its own physics."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from receivers import a_setting, decibel, echoes_at, empty, samples, tone
from scipy import signal as scipy_signal

from radar_core import SPEED_OF_LIGHT, Waveform, known_symbols
from radar_sim.effects import config, echo, receiver, transmitter
from radar_sim.effects.base import Moment, Signal

# Coupling and the high-pass filter


def test_coupling_level_and_phase():
    """Leaked power is the transmitted 12 dBm less the level; its phase is 2 pi (f_min tau + slope tau t - slope tau^2 / 2)."""
    setting = a_setting()
    signal = empty(setting)
    transmitter.Coupling(config.CouplingConfig(level=-55.0, distance=0.3), setting).process(signal, Moment(0, 0.0))
    np.testing.assert_allclose(np.abs(signal.cube) ** 2 / 50, 1e-3 * 10 ** (1.2 - 5.5), rtol=1e-5)
    w, tau = setting.info.waveform, 2 * 0.3 / SPEED_OF_LIGHT
    turns = (w.carrier - w.bandwidth / 2) * tau + w.slope * tau * np.arange(64) / 64 * 66e-6 - w.slope * tau**2 / 2
    unit = signal.cube / np.abs(signal.cube)
    np.testing.assert_allclose(unit, np.broadcast_to(np.exp(2j * np.pi * turns), unit.shape), atol=2e-6)


def test_coupling_adds_to_what_is_there():
    """Echoes go through it as they were."""
    setting = a_setting()
    alone, both = empty(setting), samples(setting)
    effect = transmitter.Coupling(config.CouplingConfig(), setting)
    effect.process(alone, Moment(0, 0.0))
    effect.process(both, Moment(0, 0.0))
    np.testing.assert_array_equal(both.cube, samples(setting).cube + alone.cube)


def test_coupling_of_a_tone_has_the_carrier_phase():
    """A tone leaks with its carrier's phase, constant over time."""
    setting, signal = a_setting(Waveform(modulation="cw")), empty(a_setting())
    transmitter.Coupling(config.CouplingConfig(distance=0.03), setting).process(signal, Moment(0, 0.0))
    expected = np.exp(2j * np.pi * 76.75e9 * 0.06 / SPEED_OF_LIGHT)
    np.testing.assert_allclose(signal.cube / np.abs(signal.cube), expected, atol=1e-5)


def test_coupling_of_ofdm_symbols():
    """Each symbol leaks with what it carries: divided by it, the carriers turn by 2 pi f_k tau; the power is as said."""
    n, duration = 64, 64 / 1.5e9
    setting = a_setting(Waveform(modulation="ofdm", chirp_duration=duration, bandwidth=1.5e9))
    signal = empty(setting)
    transmitter.Coupling(config.CouplingConfig(level=-60.0, distance=0.5), setting).process(signal, Moment(0, 0.0))
    assert (np.abs(signal.cube) ** 2).mean() / 50 == pytest.approx(1e-3 * 10 ** (1.2 - 6.0), rel=1e-5)
    carriers = np.fft.ifft(signal.cube, norm="ortho") * known_symbols(setting.info.waveform)[:, :, None, :]
    frequency = 76.75e9 - 0.75e9 + np.arange(n) / duration
    expected = np.exp(2j * np.pi * frequency / SPEED_OF_LIGHT)
    np.testing.assert_allclose(carriers / np.abs(carriers), np.broadcast_to(expected, carriers.shape), atol=1e-4)


@pytest.mark.parametrize("order", [1, 2, 3, 8])
def test_high_pass_is_the_butterworth_filter(order):
    """Its response is scipy's analogue filter, 3 dB down at the corner, 20 dB per decade and order below."""
    cfg = config.HighPassConfig(corner=150e3, order=order)
    frequency = np.geomspace(1e3, 1e7, 50)
    zeros, poles, gain = scipy_signal.butter(order, 2 * math.pi * 150e3, "highpass", analog=True, output="zpk")
    expected = scipy_signal.freqs_zpk(zeros, poles, gain, 2 * math.pi * frequency)[1]
    np.testing.assert_allclose(echo.response(cfg, frequency), expected, rtol=1e-9)
    corner, low, lower = np.abs(echo.response(cfg, np.array([150e3, 1500.0, 150.0])))
    assert decibel(corner**2) == pytest.approx(-3.01, abs=0.01)
    assert decibel(low**2 / lower**2) == pytest.approx(20 * order, abs=0.01)
    assert echo.response(cfg, 0.0) == 0


def test_high_pass_on_echoes():
    """At the range that beats at the corner an echo is 3 dB weaker and 45 degrees ahead; a far one is nearly as it was."""
    setting = a_setting()
    at_corner = 100e3 * SPEED_OF_LIGHT / (2 * setting.info.waveform.slope)
    before = echoes_at((at_corner, 0, 0), (6.0, 0, 0))
    after = echo.HighPass(config.HighPassConfig(corner=100e3), setting).process(before, Moment(0, 0.0))
    near, far = after.strength / before.strength
    assert near == pytest.approx((1 + 1j) / 2, abs=1e-9)
    assert abs(far) == pytest.approx(1.0, abs=0.01)
    assert after.out is before.out


def test_high_pass_holds_coupling_down():
    """Coupling at 3 cm beats at 4.5 kHz: 100 kHz of corner take 27 dB off it."""
    cfg, frequency = config.CouplingConfig(distance=0.03), 1.5e9 / 66e-6 * 0.06 / SPEED_OF_LIGHT
    cubes = []
    for effects in (config.Effects(), config.Effects(high_pass=config.HighPassConfig(corner=100e3))):
        signal = empty(a_setting())
        transmitter.Coupling(cfg, a_setting(effects=effects)).process(signal, Moment(0, 0.0))
        cubes.append(signal.cube)
    ratio = cubes[1] / cubes[0]
    np.testing.assert_allclose(ratio, 1 / (1 + 100e3 / (1j * frequency)), rtol=1e-4)


# Mixer and converter


@pytest.mark.parametrize(("gain", "phase"), [(0.5, 0.0), (0.0, 0.05), (-1.5, -0.2), (3.0, 1.0)])
def test_iq_image(gain, phase):
    """An echo at +f gets an image at -f, of the level that gain and phase predict: |1 - g e^-jp|^2 / |1 + g e^jp|^2."""
    setting, signal = a_setting(), tone(a_setting(), 10.0)
    receiver.IqImbalance(config.IqImbalanceConfig(gain=gain, phase=phase), setting).process(signal, Moment(0, 0.0))
    bins = np.abs(np.fft.fft(signal.cube)[0, 0, 0] / 64)
    g = 10 ** (gain / 20)
    image = (1 + g**2 - 2 * g * math.cos(phase)) / (1 + g**2 + 2 * g * math.cos(phase))
    assert bins[54] ** 2 / bins[10] ** 2 == pytest.approx(image, rel=1e-4)
    assert np.delete(bins, [10, 54]).max() < 1e-6
    assert receiver.image(config.IqImbalanceConfig(gain=gain, phase=phase)) ** 2 == pytest.approx(image)


def test_iq_arms():
    """I stays; Q is g (Q cos p + I sin p); the offset comes on both."""
    setting, signal = a_setting(), samples(a_setting(), rms=1.0)
    before = signal.cube.astype(np.complex128)
    receiver.IqImbalance(config.IqImbalanceConfig(gain=2.0, phase=0.3, offset=0.25), setting).process(signal, Moment(0, 0.0))
    g = 10**0.1
    np.testing.assert_allclose(signal.cube.real, before.real + 0.25, atol=1e-6)
    np.testing.assert_allclose(signal.cube.imag, g * (before.imag * math.cos(0.3) + before.real * math.sin(0.3)) + 0.25, atol=2e-6)


def test_balanced_mixer_changes_nothing():
    """No gain, no phase, no offset: bit for bit."""
    signal = samples(a_setting())
    receiver.IqImbalance(config.IqImbalanceConfig(gain=0.0, phase=0.0, offset=0.0), a_setting()).process(signal, Moment(0, 0.0))
    np.testing.assert_array_equal(signal.cube, samples(a_setting()).cube)


def counts(bits, volts, limit=1.0):
    signal = Signal(np.asarray(volts, np.complex64).reshape(1, 1, 1, -1).copy(), np.empty(0, np.uint32))
    receiver.Converter(config.ConverterConfig(bits=bits, full_scale=limit), a_setting()).process(signal, Moment(0, 0.0))
    return signal.cube.reshape(-1)


def test_quantisation_noise():
    """Rounding adds q^2 / 12 to each component when the signal covers many counts: 65,536 errors give it to 0.35 %."""
    signal = samples(a_setting(), rms=0.2)
    before = signal.cube.astype(np.complex128)
    receiver.Converter(config.ConverterConfig(bits=10, full_scale=1.0), a_setting()).process(signal, Moment(0, 0.0))
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
    assert receiver.full_scale(config.ConverterConfig(bits=4)) == 7
    assert receiver.full_scale(config.ConverterConfig(bits=12)) == 2047


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
