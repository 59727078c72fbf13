"""Hard cases of the effects of transmitter, receiver and converter: nothing there, one of everything, limits of numbers."""

import math

import numpy as np
import pytest

from radar_core import AntennaArray, Pose, Waveform
from radar_sim.effects import config, echo, interference, noise, receiver, transmitter
from radar_sim.effects import phase_noise as phase
from radar_sim.effects.base import Moment, Setting, Signal
from radar_sim.effects.transmitter import AmplitudeModulation, Together
from radar_sim.scatterers import Echoes, Motion
from radar_sim.scene import Scene, SceneRadar, Transmitter

ONE = AntennaArray(tx=((0.0, 0.0),), rx=((0.0, 0.0),))


def a_setting(waveform=None, array=None) -> Setting:
    radar = SceneRadar(waveform=waveform or Waveform(), array=array or AntennaArray(), mount=Pose(z=0.0))
    return Setting(Scene(radars=(radar,)), radar, 0)


def filled(setting: Setting, value=0.0) -> Signal:
    return Signal(np.full(setting.info.cube_shape, value, np.complex64), np.empty(0, np.uint32))


def echoes_at(*places) -> Echoes:
    motion, n = Motion.still(np.array(places, np.float64).reshape(-1, 3)), len(places)
    return Echoes(motion, motion, np.ones(n, np.complex128), np.zeros(n, np.int32), np.arange(n, dtype=np.int32))


ALL = [
    lambda s: noise.Noise(config.NoiseConfig(gain=150.0, noise_figure=60.0, temperature=1e4), s),
    lambda s: transmitter.Coupling(config.CouplingConfig(level=0.0, distance=0.0), s),
    lambda s: phase.PhaseNoise(config.PhaseNoiseConfig(corner=0.0), s),
    lambda s: receiver.IqImbalance(config.IqImbalanceConfig(gain=20.0, phase=1.5, offset=10.0), s),
    lambda s: receiver.Converter(config.ConverterConfig(bits=24, full_scale=1e-12), s),
    lambda s: receiver.ChannelErrors(config.ChannelErrorsConfig(gain=30.0, phase=math.pi), s),
    lambda s: receiver.ChirpFaults(config.ChirpFaultsConfig(dropped=1.0), s),
    lambda s: interference.Interference(config.InterferenceConfig(), s),
    lambda s: AmplitudeModulation(Transmitter(amplitude="intra"), s),
    lambda s: AmplitudeModulation(Transmitter(amplitude="inter"), s),
]


@pytest.mark.parametrize("make", ALL)
@pytest.mark.parametrize(
    "waveform",
    [
        Waveform(n_tx=1, n_chirp=1, n_sample=1),
        Waveform(n_tx=1, n_chirp=1, n_sample=2),
        Waveform(n_tx=1, n_chirp=3, n_sample=129),
        Waveform(n_tx=1, n_chirp=2, n_sample=64, chirp_pause=1.0, frame_interval=100.0),
        Waveform(n_tx=1, n_chirp=200, n_sample=3, chirp_pause=0.0),
    ],
)
def test_small_and_odd_cubes(make, waveform):
    """One sample, one chirp, odd lengths, pauses of a second: finite samples of the right kind."""
    setting = a_setting(waveform, ONE)
    signal = filled(setting, 1e-6)
    make(setting).process(signal, Moment(0, 0.0))
    assert signal.cube.shape == setting.info.cube_shape
    assert signal.cube.dtype == np.complex64
    assert np.isfinite(signal.cube).all()


@pytest.mark.parametrize("make", ALL)
def test_far_in_time(make):
    """A million seconds into a scene, as frame fifty million."""
    setting = a_setting()
    signal = filled(setting, 1e-6)
    make(setting).process(signal, Moment(50_000_000, 1e6, 1 << 60))
    assert np.isfinite(signal.cube).all()


@pytest.mark.parametrize("echoes", [Echoes.none(), echoes_at((0, 0, 0)), echoes_at((1e-300, 0, 0)), echoes_at((-2, 0, 0), (1e3, 1e3, 0))])
def test_filters_of_echoes(echoes):
    """No echo, echoes at the radar itself, behind it and far away keep finite strengths."""
    together = Together(Transmitter(together=((0.0, 0.0), (0.01, 0.0))), a_setting(Waveform(n_tx=1), ONE))
    for effect in (echo.HighPass(config.HighPassConfig(order=8, corner=1e9), a_setting()), together):
        after = effect.process(echoes, Moment(0, 0.0))
        assert len(after) == len(echoes)
        assert np.isfinite(after.strength).all()


@pytest.mark.parametrize("bits", [1, 2, 12, 24])
@pytest.mark.parametrize("volts", [0.0, 1e-45, 3e38, -3e38, complex(3e38, -3e38), complex(np.inf, -np.inf)])
def test_converter_at_the_limits_of_numbers(bits, volts):
    """Nothing overflows; what is beyond the range becomes its ends."""
    signal = filled(a_setting(), volts)
    receiver.Converter(config.ConverterConfig(bits=bits, full_scale=1e-12), a_setting()).process(signal, Moment(0, 0.0))
    parts = signal.cube.view(np.float32)
    assert parts.min() >= -(2 ** (bits - 1))
    assert parts.max() <= 2 ** (bits - 1) - 1


def test_noise_on_a_view():
    """A cube that does not lie in one piece gets its noise too."""
    setting = a_setting()
    whole = np.zeros((2, 64, 4, 128), np.complex64)
    signal = Signal(whole[..., ::2], np.empty(0, np.uint32))
    noise.Noise(config.NoiseConfig(), setting).process(signal, Moment(0, 0.0))
    assert np.abs(signal.cube).min() > 0


@pytest.mark.parametrize("place", [(0.0, 0.0, 0.0), (1e-9, 0.0, 0.0), (0.0, 3.0, 0.0), (1e4, 1e4, 1e4)])
def test_interference_from_strange_places(place):
    """At the radar itself, beside it in the array's plane, kilometres away."""
    setting = a_setting()
    signal = filled(setting)
    effect = interference.Interference(config.InterferenceConfig(position=place, power=100.0), setting)
    effect.process(signal, Moment(0, 0.0))
    assert np.isfinite(signal.cube).all()
    assert interference.Interference(config.InterferenceConfig(position=place), setting).size(Echoes.none())


@pytest.mark.parametrize("offset", [0.3e6, -0.3e6])
def test_sweeps_in_parallel(offset):
    """Sweeps of one slope differ by a constant: a tone of full amplitude through the whole chirp, or nothing."""
    w = Waveform(n_tx=1, n_chirp=1)
    # It lags by the way from there, 1 m.
    cfg = config.InterferenceConfig(
        position=(1.0, 0.0, 0.0), carrier=w.carrier - offset, bandwidth=1.5e9, duration=66e-6, pause=50e-6, drift=0.0, power=0.0
    )
    setting = a_setting(w, ONE)
    signal = filled(setting)
    interference.Interference(cfg, setting).process(signal, Moment(0, 0.0))
    frequency = offset + w.slope / 299_792_458.0
    if frequency < 0:
        assert not signal.cube.any()
        return
    amplitude = math.sqrt(interference.received(cfg, setting) * 50)
    on = signal.cube[0, 0, 0][1:]  # the first sample is before its sweep arrives
    np.testing.assert_allclose(np.abs(on), amplitude, rtol=1e-3)
    turned = np.angle(on[1:] / on[:-1]) / (2 * np.pi) % 1.0
    np.testing.assert_allclose(turned, frequency * 66e-6 / 64, atol=1e-3)


@pytest.mark.parametrize(
    "cfg",
    [
        config.InterferenceConfig(duration=1e-7, pause=0.0),
        config.InterferenceConfig(duration=1.0, pause=1.0, bandwidth=0.0),
        config.InterferenceConfig(bandwidth=1e11, duration=1e-7, drift=-1e-2),
        config.InterferenceConfig(duration=66e-6, bandwidth=1.5e9, pause=0.0, drift=1e-2),
    ],
)
def test_strange_sweeps(cfg):
    """Sweeps far shorter, longer and steeper than ours: finite, and never above the carrier's amplitude but for ripple."""
    setting = a_setting()
    signal = filled(setting)
    interference.Interference(cfg, setting).process(signal, Moment(0, 0.3))
    assert np.isfinite(signal.cube).all()
    # A Fresnel integral overshoots by 17 %, two ends of a band by less than 40 %.
    assert np.abs(signal.cube).max() <= 1.4 * math.sqrt(interference.received(cfg, setting) * 50)
    assert 0.0 <= interference.share(cfg, setting.info.waveform) <= 1.0


def test_all_chirps_lost():
    """Every chirp may be lost: all zeros, all listed."""
    signal = filled(a_setting(), 1.0)
    receiver.ChirpFaults(config.ChirpFaultsConfig(dropped=1.0), a_setting()).process(signal, Moment(0, 0.0))
    np.testing.assert_array_equal(signal.missing, np.arange(128))
    assert not signal.cube.any()


@pytest.mark.parametrize(
    "cfg", [config.PhaseNoiseConfig(level=-250.0, floor=-300.0), config.PhaseNoiseConfig(corner=1e9), config.PhaseNoiseConfig(offset=1.0)]
)
def test_phase_noise_of_any_size(cfg):
    """Hardly any, flat throughout, or given at 1 Hz: finite, and small."""
    signal = filled(a_setting(), 1.0)
    phase.PhaseNoise(cfg, a_setting()).process(signal, Moment(0, 0.0))
    assert np.isfinite(signal.cube).all()
    assert np.abs(signal.cube - 1).max() < 0.5
