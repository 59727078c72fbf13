"""Turntable recordings: truth of the echo against formulas written here anew, errors, order and time."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from radar_core import SPEED_OF_LIGHT, ConfigError, DataError, RadarInfo
from radar_sim.turntable import ChannelErrors, Sweep, Turntable, TurntableSimulator, begins

SHORT = (Sweep(start=-10.0, stop=10.0, step=5.0), Sweep(axis="elevation", start=4.0, stop=-4.0, step=-2.0))


def spectrum(cube: np.ndarray) -> np.ndarray:
    """Boxcar spectrum at zero speed, (channel, range), that leaves white noise its variance."""
    n = math.sqrt(cube.shape[1] * cube.shape[3])
    return np.fft.fft(cube.sum(axis=1).astype(np.complex128), axis=-1).reshape(-1, cube.shape[3]) / n


def test_echo_is_that_of_the_true_path():
    """Every sample has the phase 2 pi (f_min tau + slope tau t) of the path from transmitter to reflector to receiver."""
    simulator = TurntableSimulator(Turntable(errors=None, snr=None, sweeps=SHORT, range=2.0))
    item = simulator.process(1)  # azimuth -5 degrees
    w, a = simulator.info.waveform, simulator.info.array
    azimuth = math.radians(-5.0)
    target = 2.0 * np.array([math.cos(azimuth), math.sin(azimuth), 0.0])
    cube = item.frame.cube
    for tx, rx, sample in ((0, 0, 0), (1, 3, 17), (1, 1, 63)):
        path = np.linalg.norm(target - [0, *a.tx[tx]]) + np.linalg.norm(target - [0, *a.rx[rx]])
        tau, t = path / SPEED_OF_LIGHT, sample / w.n_sample * w.chirp_duration
        phase = 2 * math.pi * ((w.carrier - w.bandwidth / 2) * tau + w.bandwidth / w.chirp_duration * tau * t)
        for chirp in (0, 40):
            sample_value = cube[tx, chirp, rx, sample]
            # complex64 keeps 1e-7 of the amplitude; 6000 rad of phase in float64 keep 1e-12.
            assert abs(sample_value / abs(sample_value) - np.exp(1j * phase)) < 1e-5


def test_errors_turn_the_channels_as_the_true_array_says():
    """Far away the channels relate as `AntennaArray.steering` of the true array; the info stays nominal."""
    simulator = TurntableSimulator(Turntable(snr=None, sweeps=SHORT, range=6.0, errors=ChannelErrors(seed=5)))
    assert simulator.info.array == RadarInfo().array
    assert simulator.array.channel_shift != ()
    for item in simulator:
        values = spectrum(item.frame.cube)[:, round(6.0 / simulator.info.waveform.range_resolution)]
        steering = simulator.array.steering(item.azimuth, item.elevation, simulator.info.waveform.wavelength)
        ratio = values / steering
        # What is left of the spherical wave at 6 m: pi |p|^2 / (lambda R) = 0.006 rad per leg for elements up to 8 mm; a boxcar's line
        # falls by under a hundredth over the elements' different ranges.
        assert np.abs(np.angle(ratio / ratio[0])).max() < 0.02
        assert np.abs(np.abs(ratio / ratio[0]) - 1).max() < 0.02


def test_signal_to_noise_ratio_is_the_one_asked_for():
    """Noise and echo in the reflector's cell behind a boxcar, in an ideal channel."""
    base = {"sweeps": (Sweep(start=0.0, stop=0.0),), "range": 3.0, "errors": None, "frames": 40}
    clean = TurntableSimulator(Turntable(**base, snr=None)).process(0).frame.cube
    noisy = [item.frame.cube - clean for item in TurntableSimulator(Turntable(**base, snr=20.0))]
    signal = float((np.abs(spectrum(clean)) ** 2).max(axis=1).mean())
    noise = np.mean([np.mean(np.abs(cube) ** 2) for cube in noisy])
    # 3 m is a bin's middle but for a millimetre; 1.3 million noise samples: the estimate is good to 0.004 dB.
    assert 10 * math.log10(signal / noise) == pytest.approx(20.0, abs=0.02)


def test_order_times_and_repetition():
    """Frames follow the sweeps, `frames` at each angle, evenly in time; the same number gives the same frame."""
    config = Turntable(sweeps=SHORT, frames=2)
    simulator = TurntableSimulator(config)
    items = list(simulator)
    assert len(items) == simulator.n_frames == 20
    assert [item.sweep for item in items] == [0] * 10 + [1] * 10
    assert np.degrees([item.azimuth for item in items[:10:2]]) == pytest.approx([-10, -5, 0, 5, 10])
    assert np.degrees([item.elevation for item in items[10::2]]) == pytest.approx([4, 2, 0, -2, -4])
    assert np.diff([item.frame.stamp_ns for item in items]).tolist() == [500_000_000] * 19
    assert begins(config.sweeps) == [0.0, 5.0]
    assert np.array_equal(simulator.process(7).frame.cube, items[7].frame.cube)
    assert not np.array_equal(items[6].frame.cube, items[7].frame.cube)
    with pytest.raises(DataError, match="frames 0 to 19"):
        simulator.process(20)


def test_mounting_offset_is_in_the_echo_but_not_in_what_is_said():
    """A table that says 0 and stands at 3 degrees gives the frame of 3 degrees."""
    said = TurntableSimulator(Turntable(errors=None, snr=None, sweeps=(Sweep(start=0.0, stop=0.0),), offset_azimuth=3.0)).process(0)
    true = TurntableSimulator(Turntable(errors=None, snr=None, sweeps=(Sweep(start=3.0, stop=3.0),))).process(0)
    assert said.azimuth == 0.0
    assert np.array_equal(said.frame.cube, true.frame.cube)


def test_errors_have_the_spread_asked_for():
    """Over many draws gain, phase and both shifts have the configured rms."""
    draws = [ChannelErrors(gain=1.5, phase=0.4, shift=3e-4, seed=seed).draw(RadarInfo().array) for seed in range(300)]
    # 2400 numbers each: the rms is good to 1.5 percent, tested at four of these.
    assert np.std([d.channel_gain for d in draws]) == pytest.approx(1.5, rel=0.06)
    assert np.std([d.channel_phase for d in draws]) == pytest.approx(0.4, rel=0.06)
    for axis in range(2):
        assert np.std([np.array(d.channel_shift)[:, axis] for d in draws]) == pytest.approx(3e-4, rel=0.06)


@settings(max_examples=50, deadline=None)
@given(st.floats(-80, 80), st.integers(1, 60), st.floats(0.1, 5))
def test_sweeps_hold_both_ends(start, steps, step):
    """A sweep that is a whole number of steps long holds both its ends, however the step rounds."""
    stop = start + steps * step
    if stop > 89:
        return
    angles = np.degrees(Sweep(start=start, stop=stop, step=step).angles)
    assert len(angles) == steps + 1
    assert angles[[0, -1]] == pytest.approx([start, stop])


@pytest.mark.parametrize(
    ("values", "text"),
    [
        ({"range": 7.0}, "choose less"),
        ({"sweeps": ()}, "at least one sweep"),
        ({"frames": 51}, "do not fit"),
    ],
)
def test_impossible_turntables_are_refused(values, text):
    """The reason names the knob."""
    with pytest.raises(ConfigError, match=text):
        Turntable(**values)


@pytest.mark.parametrize(
    ("values", "text"), [({"step": -1.0}, "lead from"), ({"step": 0.0}, "lead from"), ({"settle": 0.5}, "less than half")]
)
def test_impossible_sweeps_are_refused(values, text):
    """A step the wrong way, none at all, and a dwell that is all settling."""
    with pytest.raises(ConfigError, match=text):
        Sweep(**values)
