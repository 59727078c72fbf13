"""Errors of channels and chirps, tapers and beams of transmitters, each against its own physics."""

import dataclasses
import math

import numpy as np
import pytest
from receivers import a_setting, echoes_at, empty, samples
from scipy import signal as scipy_signal
from scipy import stats

from radar_core import SPEED_OF_LIGHT, AntennaArray, ConfigError, Waveform
from radar_sim.effects import chain, config, receiver, transmitter
from radar_sim.effects.base import Moment
from radar_sim.scene import Transmitter


def test_channel_errors_have_the_size_they_say():
    """256 channels: rms gain and phase within 15 % (4.4 % by chance), factors on the cube channel by channel."""
    array = AntennaArray(tx=((0.0, 0.0),) * 16, rx=((0.0, 0.0),) * 16)
    setting = a_setting(Waveform(n_tx=16, n_chirp=4, n_sample=8), array)
    cfg = config.ChannelErrorsConfig(gain=1.5, phase=0.2, shift=1e-4)
    factor = receiver.factors(cfg, setting)
    assert np.std(20 * np.log10(np.abs(factor))) == pytest.approx(1.5, rel=0.15)
    assert np.std(np.angle(factor)) == pytest.approx(0.2, rel=0.15)
    signal = samples(setting)
    receiver.ChannelErrors(cfg, setting).process(signal, Moment(0, 0.0))
    expected = samples(setting).cube * factor.reshape(16, 1, 16, 1)
    np.testing.assert_allclose(signal.cube, expected, rtol=1e-5)


def test_element_places():
    """Places are off by the shift in y and z, virtual ones by both their elements' errors; without shift they are as drawn."""
    array = AntennaArray(tx=((0.0, 0.01),) * 30, rx=((0.02, 0.0),) * 30)
    setting = a_setting(Waveform(n_tx=30, n_chirp=1), array)
    tx, rx = receiver.elements(config.ChannelErrorsConfig(shift=2e-4), setting)
    for real, drawn in ((tx, (0.0, 0.01)), (rx, (0.02, 0.0))):
        assert real.shape == (30, 2)
        assert np.std(real - drawn) == pytest.approx(2e-4, rel=0.3)
    np.testing.assert_array_equal(receiver.elements(config.ChannelErrorsConfig(shift=0.0), setting)[0], np.asarray(array.tx))


def test_channel_errors_belong_to_the_radar():
    """The scene's seed and the frame do not change them; their own seed and another radar do; each kind is drawn on its own."""
    setting, cfg = a_setting(), config.ChannelErrorsConfig(seed=3)
    other_scene = dataclasses.replace(setting, scene=dataclasses.replace(setting.scene, seed=9))
    np.testing.assert_array_equal(receiver.factors(cfg, setting), receiver.factors(cfg, other_scene))
    for other_cfg, other_setting in ((config.ChannelErrorsConfig(seed=4), setting), (cfg, a_setting(frame_id="left/radar"))):
        assert not np.allclose(receiver.factors(cfg, setting), receiver.factors(other_cfg, other_setting))
    flat = receiver.factors(dataclasses.replace(cfg, gain=0.0), setting)
    np.testing.assert_allclose(flat, np.exp(1j * np.angle(receiver.factors(cfg, setting))), atol=1e-12)


def test_dropped_chirps():
    """Lost chirps hold zeros and are listed in order; the share is as said: 3,840 chirps, 14 by chance."""
    setting, lost = a_setting(), 0
    effect = receiver.ChirpFaults(config.ChirpFaultsConfig(dropped=0.05), setting)
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
    effect = receiver.ChirpFaults(config.ChirpFaultsConfig(dropped=0.3, late=0.4, delay=20e-6), setting)
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
    assert receiver.ChirpFaults(config.ChirpFaultsConfig(dropped=0.3), setting).late(moments[0]) is None


def test_lateness_within_the_pause():
    """Later than the pause is refused with both numbers; a delay that never happens is not."""
    setting = a_setting(Waveform(chirp_pause=8e-6))
    with pytest.raises(ConfigError, match=r"10 us.* 8 us"):
        receiver.ChirpFaults(config.ChirpFaultsConfig(late=0.1, delay=10e-6), setting)
    receiver.ChirpFaults(config.ChirpFaultsConfig(late=0.0, delay=10e-6), setting)


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


def test_constant_amplitude_costs_nothing():
    """Nothing is made of it."""
    assert chain.make_chain(a_setting()).signal == ()


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
