"""Simulated echoes of a tone and of OFDM against the physics written out, and through the spectrum that belongs to them."""

import dataclasses
import math

import numpy as np
import pytest
from truths import first_cube, point_scene

from radar_core import SPEED_OF_LIGHT, RadarInfo, Waveform, known_symbols
from radar_core.geometry import spherical_to_cartesian
from radar_core.pose import Pose
from radar_dsp import spectrum
from radar_dsp.config import SpectrumConfig
from radar_sim import Coupling, Noise, Simulator
from radar_sim.propagation import strength
from radar_sim.scene import Effects

CW = RadarInfo(mount=Pose(z=0.0), waveform=Waveform(modulation="cw", chirp_duration=16e-6, chirp_pause=100e-6))
OFDM = RadarInfo(mount=Pose(z=0.0), waveform=Waveform(modulation="ofdm", chirp_duration=64 / 1.5e9, chirp_pause=116e-6, code_seed=11))
SLOW_OFDM = RadarInfo(
    mount=Pose(z=0.0), waveform=Waveform(modulation="ofdm", n_sample=16, n_chirp=8, chirp_duration=16e-6, bandwidth=1e6, chirp_pause=50e-6)
)


def true_paths(info: RadarInfo, position, velocity) -> np.ndarray:
    """Delay of every channel at every sample, shape (tx, chirp, rx, sample) [s]."""
    w = info.waveform
    t, chirp, fast = np.arange(w.n_tx), np.arange(w.n_chirp), np.arange(w.n_sample) * w.chirp_duration / w.n_sample
    time = ((chirp[None, :] * w.n_tx + t[:, None]) * w.chirp_interval)[:, :, None] + fast
    place = np.asarray(position) + time[..., None] * np.asarray(velocity)
    delays = np.empty(info.cube_shape)
    for i, (ty, tz) in enumerate(info.array.tx):
        for j, (ry, rz) in enumerate(info.array.rx):
            out = np.linalg.norm(place[i] - [0.0, ty, tz], axis=-1)
            delays[i, :, j] = (out + np.linalg.norm(place[i] - [0.0, ry, rz], axis=-1)) / SPEED_OF_LIGHT
    return delays


def amplitude(info: RadarInfo, distance: float) -> float:
    return float(strength(info, np.array([0.1]))[0]) / distance**2


@pytest.mark.parametrize("velocity", [(0.0, 0.0, 0.0), (2.0, 1.0, -0.5)])
def test_a_tone_is_the_formula(velocity):
    """Phase +2 pi f_c tau at every sample; chords of the path leave 1e-5 rad, complex64 1e-7; the amplitude is that of each chirp."""
    position = (1.4, 0.6, -0.3)
    cube = first_cube(point_scene(position, velocity, radar=CW))
    turned = np.exp(2j * np.pi * CW.waveform.carrier * true_paths(CW, position, velocity))
    np.testing.assert_allclose(cube / np.abs(cube), turned, atol=5e-4)
    assert np.abs(cube[0, 0]).mean() == pytest.approx(amplitude(CW, math.hypot(*position)), rel=2e-3)


@pytest.mark.parametrize("info", [OFDM, SLOW_OFDM])
@pytest.mark.parametrize("velocity", [(0.0, 0.0, 0.0), (-2.0, 1.0, 0.5)])
def test_ofdm_is_a_delayed_signal_on_every_carrier(info, velocity):
    """The conjugate of what a receiver samples when each carrier comes back late by the delay of that very sample; no transform here.

    The model lets all carriers turn within a symbol by the Doppler frequency of the middle one. What that leaves out is below 1e-5 rad.
    """
    w, position = info.waveform, (2.4, 0.6, -0.3)
    cube = first_cube(point_scene(position, velocity, radar=info))
    tau = true_paths(info, position, velocity)
    fast = np.arange(w.n_sample) / w.n_sample * w.chirp_duration
    sampled = np.zeros(info.cube_shape, np.complex128)
    for k, sent in enumerate(np.moveaxis(known_symbols(w), -1, 0)):
        f = w.carrier - w.bandwidth / 2 + k / w.chirp_duration
        sampled += sent[:, :, None, None] * np.exp(2j * np.pi * (k / w.chirp_duration * fast - f * tau))
    expected = sampled.conj() * amplitude(info, math.hypot(*position)) / math.sqrt(w.n_sample)
    # The amplitude follows the range from chirp to chirp (1.3 % over the frame); the phase is what is tested.
    scale = (cube * expected.conj()).sum(axis=3, keepdims=True).real / (np.abs(expected) ** 2).sum(axis=3, keepdims=True)
    np.testing.assert_allclose(scale, 1.0, atol=0.03)
    np.testing.assert_allclose(cube, scale * expected, atol=1e-4 * np.abs(expected).max())


@pytest.mark.parametrize("info", [CW, OFDM])
@pytest.mark.parametrize("rate", [-3.0, 2.5])
@pytest.mark.parametrize(("azimuth", "elevation"), [(0.5, 0.2), (-0.4, -0.25)])
def test_through_the_spectrum(info, rate, azimuth, elevation):
    """Range, sign of the range rate and steering vector of a target come out of the generator that belongs to the modulation.

    The peak is in the nearest cell: half a cell. At 5 m the aperture of 14 mm sees a sphere, 1e-2 rad, and at 30 degrees 7 mm of it turn by
    0.01 rad at the edges of 1.5 GHz, which cancels in the middle; the phases of the two transmitters carry the motion between their turns.
    """
    w = info.waveform
    direction = np.array(spherical_to_cartesian(1.0, azimuth, elevation))
    place, velocity = 5.0 * direction - rate * w.acquisition_time / 2 * direction, rate * direction
    cube = first_cube(point_scene(tuple(place.tolist()), tuple(velocity.tolist()), radar=info))
    result = spectrum.make_spectrum(SpectrumConfig(), info).process(cube)
    power = (np.abs(result) ** 2).sum(axis=(0, 2))
    speed, distance = np.unravel_index(np.argmax(power), power.shape)
    assert (speed + 32) % 64 - 32 == round(rate / w.speed_resolution)
    assert distance == (0 if w.modulation == "cw" else round(5.0 / w.range_resolution))
    snapshot = result[:, speed, :, distance] * np.exp(-4j * np.pi * rate * w.chirp_interval / w.wavelength * np.arange(2))[:, None]
    expected = info.array.steering(azimuth, elevation, w.wavelength)
    fit = np.vdot(expected, snapshot.ravel()) / (np.linalg.norm(expected) * np.linalg.norm(snapshot))
    assert abs(fit) > 0.9995


@pytest.mark.parametrize("info", [CW, OFDM])
def test_far_echoes_are_seen(info):
    """A tone has no largest range; OFDM's echo beyond it folds back into the first period."""
    cube = first_cube(point_scene((8.0, 0.0, 0.0), radar=info))
    assert np.sqrt(np.mean(np.abs(cube) ** 2)) == pytest.approx(amplitude(info, 8.0), rel=1e-3)
    power = np.abs(spectrum.make_spectrum(SpectrumConfig(), info).process(cube)[0, :, 0]) ** 2
    folded = 0 if info is CW else round((8.0 - info.waveform.max_range) / info.waveform.range_resolution)
    assert np.unravel_index(np.argmax(power), power.shape) == (0, folded)


@pytest.mark.parametrize("info", [CW, OFDM])
def test_noise_and_leakage(info):
    """Thermal noise of the sampled band; leakage stands still in range cell 0 with its level, whatever the code."""
    w = info.waveform
    noisy = Simulator(point_scene((3.0, 0.0, 0.0), rcs=0.0, radar=info, effects=Effects(noise=Noise(noise_figure=12.0))))
    cube = np.stack([noisy.process(k).frame.cube for k in range(2)])
    wanted = 1.380649e-23 * 290 * (w.n_sample / w.chirp_duration) * 10**1.2 * 50
    assert np.mean(np.abs(cube) ** 2) == pytest.approx(wanted, rel=0.02)
    leak = first_cube(point_scene((3.0, 0.0, 0.0), rcs=0.0, radar=info, effects=Effects(coupling=Coupling(level=-50.0, distance=0.0))))
    volts = math.sqrt(1e-3 * 10 ** ((12.0 - 50.0) / 10) * 50)
    assert np.sqrt(np.mean(np.abs(leak) ** 2)) == pytest.approx(volts, rel=1e-5)
    power = np.abs(spectrum.make_spectrum(SpectrumConfig(), info).process(leak)[1, :, 2]) ** 2
    assert np.unravel_index(np.argmax(power), power.shape) == (0, 0)
    # Nothing but the two windows' lobes: cells away from them are 80 dB down.
    assert power[20:40, 20:40].max(initial=0.0) < 1e-8 * power.max()


def test_frames_are_random_access():
    """A frame depends on the scene and its number only, and the model knob of FMCW changes nothing."""
    scene = point_scene((3.0, 0.2, 0.0), (1.0, 0.0, 0.0), radar=SLOW_OFDM)
    simulator = Simulator(scene)
    first = simulator.process(2).frame.cube
    simulator.process(0)
    np.testing.assert_array_equal(simulator.process(2).frame.cube, first)
    np.testing.assert_array_equal(Simulator(dataclasses.replace(scene, model="blocks")).process(2).frame.cube, first)
