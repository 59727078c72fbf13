"""What `explain` says of effects of transmitter and receiver; those of no size, and those that a waveform does not have."""

import numpy as np
import pytest
from receivers import BOLTZMANN, a_setting, decibel, echoes_at, samples, skirt

from radar_core import SPEED_OF_LIGHT, ConfigError, Waveform
from radar_sim.effects import chain, config, echo, interference, noise, phase_noise, receiver, transmitter
from radar_sim.effects.base import Moment
from radar_sim.scatterers import Echoes
from radar_sim.scene import Transmitter


def sizes(echoes, setting):
    return {name: chain.size(name, setting, echoes) for name in (*chain.SIGNAL, "high_pass")}


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
    setting, cfg = a_setting(), config.PhaseNoiseConfig()
    w, distance = setting.info.waveform, 2.5 * setting.info.waveform.range_resolution * 10
    added = skirt(setting, cfg, 25.0, 8)
    measured = -decibel((np.abs(added) ** 2).mean() / (w.n_sample * w.n_chirp))
    said = phase_noise.PhaseNoise(cfg, setting).size(echoes_at((distance, 0, 0)))
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


@pytest.mark.parametrize(
    "make",
    [
        lambda s: noise.Noise(config.NoiseConfig(temperature=0.0), s),
        lambda s: receiver.ChannelErrors(config.ChannelErrorsConfig(gain=0.0, phase=0.0), s),
        lambda s: receiver.ChirpFaults(config.ChirpFaultsConfig(dropped=0.0, late=0.5), s),
        lambda s: transmitter.Coupling(config.CouplingConfig(level=-300.0), s),
        lambda s: transmitter.AmplitudeModulation(Transmitter(amplitude="intra", taper="boxcar"), s),
    ],
)
def test_effects_of_no_size_change_nothing(make):
    """An effect turned down to nothing leaves samples bit for bit."""
    setting, signal = a_setting(), samples(a_setting(), rms=1e-3)
    make(setting).process(signal, Moment(0, 0.0))
    np.testing.assert_array_equal(signal.cube, samples(setting, rms=1e-3).cube)
    assert not len(signal.missing)


@pytest.mark.parametrize(
    ("make", "name"),
    [
        (lambda s: echo.HighPass(config.HighPassConfig(), s), "high_pass"),
        (lambda s: phase_noise.PhaseNoise(config.PhaseNoiseConfig(), s), "phase_noise"),
        (lambda s: interference.Interference(config.InterferenceConfig(), s), "interference"),
    ],
)
@pytest.mark.parametrize("waveform", [Waveform(modulation="cw"), Waveform(modulation="ofdm", bandwidth=1.5e9, chirp_duration=64 / 1.5e9)])
def test_effects_of_sweeps_refuse_other_radars(make, name, waveform):
    """The error names effect, radar and modulation, and says why."""
    with pytest.raises(ConfigError, match=rf"effects.{name} .*'radar'.* {waveform.modulation}: .*; leave it out") as caught:
        make(a_setting(waveform))
    assert caught.value.key == ("effects", name)
