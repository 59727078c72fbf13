"""Chirps of other radars, against an ideal filter and the floor that is foretold."""

import math

import numpy as np
import pytest
from receivers import a_setting, decibel, empty, samples
from scipy import special

from radar_core import SPEED_OF_LIGHT, AntennaArray, Waveform
from radar_sim.effects import config, interference, noise
from radar_sim.effects.base import Moment
from radar_sim.scatterers import Echoes


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
    cfg = config.InterferenceConfig(bandwidth=bandwidth, duration=duration)
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
    cfg = config.InterferenceConfig(bandwidth=1.4e9, duration=66e-6, pause=0.0, drift=0.0, carrier=76.75e9)
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
        cfg = config.InterferenceConfig(position=(2.0, 0.0, 0.0), carrier=carrier, bandwidth=0.75e9, duration=66e-6, pause=50e-6, drift=0.0)
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
        noise.Noise(config.NoiseConfig(), setting).process(signal, Moment(k, 0.02 * k, 1))
        before = (np.abs(signal.cube) ** 2).mean()
        effect.process(signal, Moment(k, 0.02 * k, 1))
        total.append((before, (np.abs(signal.cube) ** 2).mean()))
    before, after = np.mean(total, 0)
    return decibel(after / before)


@pytest.mark.parametrize(
    "cfg",
    [
        config.InterferenceConfig(),
        config.InterferenceConfig(bandwidth=0.0, pause=0.0, power=30.0),
        config.InterferenceConfig(bandwidth=0.3e9, duration=17e-6, pause=6.1e-6, carrier=76.3e9),
        config.InterferenceConfig(bandwidth=1.2e9, duration=63e-6, pause=4.7e-6, drift=1e-4),
        config.InterferenceConfig(bandwidth=2.0e9, duration=21e-6, pause=3.3e-6, carrier=77.4e9, power=30.0),
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
    predicted = decibel(1 + friis * in_band / noise.power(config.NoiseConfig(), setting.info))
    assert predicted > 1.0
    assert rise(cfg, 150, setting) == pytest.approx(predicted, abs=0.5)


@pytest.mark.parametrize("carrier", [74.0e9, 80.0e9])
def test_interference_out_of_band(carrier):
    """A band that does not overlap ours leaves every sample as it was, bit for bit."""
    setting, cfg = a_setting(), config.InterferenceConfig(carrier=carrier)
    effect = interference.Interference(cfg, setting)
    for k in range(5):
        signal = samples(setting)
        effect.process(signal, Moment(k, 0.02 * k))
        np.testing.assert_array_equal(signal.cube, samples(setting).cube)
    assert interference.share(cfg, Waveform()) == 0.0
    assert interference.Interference(cfg, setting).size(Echoes.none()).startswith("floor raised by 0.0 dB")


def test_interference_comes_as_a_plane_wave():
    """Between receivers it turns by -2 pi p.u / lambda; from behind the array nothing comes."""
    setting, cfg = a_setting(), config.InterferenceConfig(position=(3.0, 1.5, 0.5))
    signal = empty(setting)
    interference.Interference(cfg, setting).process(signal, Moment(0, 0.0))
    direction = np.array([3.0, 1.5, 0.5]) / np.linalg.norm([3.0, 1.5, 0.5])
    expected = np.exp(-2j * np.pi / setting.info.waveform.wavelength * np.asarray(setting.array.rx) @ direction[1:])
    hit = np.abs(signal.cube[:, :, 0]) > 0.1 * np.abs(signal.cube).max()
    for j in range(4):
        np.testing.assert_allclose(signal.cube[:, :, j][hit] / signal.cube[:, :, 0][hit], expected[j] / expected[0], atol=1e-5)
    behind = empty(setting)
    interference.Interference(config.InterferenceConfig(position=(-3.0, 1.5, 0.5)), setting).process(behind, Moment(0, 0.0))
    assert not behind.cube.any()


def test_interference_runs_on_between_frames():
    """Bursts of a frame depend on scene time only: one frame that begins where another's second half does has the same bursts."""
    setting, cfg = a_setting(Waveform(n_chirp=32, frame_interval=0.01)), config.InterferenceConfig()
    w, effect = setting.info.waveform, interference.Interference(cfg, setting)
    one, two = empty(setting), empty(setting)
    effect.process(one, Moment(0, 1.0))
    effect.process(two, Moment(7, 1.0 + 16 * w.slow_interval))
    assert np.abs(one.cube[:, 16:]).max() > 0
    # Times of 1 s are known to 1e-16, phases of 77 GHz to 2e-5 turns; where a sweep's end falls on a sample it may be in or out.
    np.testing.assert_allclose(one.cube[:, 16:], two.cube[:, :16], atol=1e-2 * np.abs(one.cube).max())
