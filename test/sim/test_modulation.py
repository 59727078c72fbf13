"""Simulated echoes of a tone and of OFDM against the physics written out, and through the spectrum that belongs to them."""

import math

import numpy as np
import pytest

from radar_core import SPEED_OF_LIGHT, RadarInfo, Waveform, known_symbols
from radar_core.geometry import spherical_to_cartesian
from radar_dsp import spectrum
from radar_dsp.config import SpectrumConfig
from radar_sim.propagation.base import Physics, Sampling
from radar_sim.propagation.choose import make_propagator
from radar_sim.propagation.exact import Exact
from radar_sim.propagation.reference import Ofdm
from radar_sim.scatterers import THING, Echoes, Motion
from radar_sim.scene import Fidelity

CW = RadarInfo(waveform=Waveform(modulation="cw", chirp_duration=16e-6, chirp_pause=100e-6))
OFDM = RadarInfo(waveform=Waveform(modulation="ofdm", chirp_duration=64 / 1.5e9, chirp_pause=116e-6, code_seed=11))
SLOW_OFDM = RadarInfo(waveform=Waveform(modulation="ofdm", n_sample=16, n_chirp=8, chirp_duration=16e-6, bandwidth=1e6, chirp_pause=50e-6))


def sampling(info: RadarInfo) -> Sampling:
    return Sampling(info, np.asarray(info.array.tx, np.float64), np.asarray(info.array.rx, np.float64))


def point(position, velocity=(0.0, 0.0, 0.0), acceleration=(0.0, 0.0, 0.0), strength=1.0) -> Echoes:
    motion = Motion(*(np.array([x], np.float64) for x in (position, velocity, acceleration)))
    number = np.full(1, THING, np.int32)
    return Echoes(motion, motion, np.array([strength], np.complex128), number, number)


def cube_of(info: RadarInfo, echoes: Echoes, late=None) -> np.ndarray:
    return make_propagator(Fidelity(), Physics(), sampling(info), 0.02).process(echoes, late)


def true_paths(info: RadarInfo, echoes: Echoes, late=0.0) -> tuple[np.ndarray, np.ndarray]:
    """Delay of every channel at every sample [s], and distance of the middle of every chirp [m]; shapes (tx, chirp, rx, sample or 1)."""
    w = info.waveform
    t, chirp = np.arange(w.n_tx), np.arange(w.n_chirp)
    fast = np.arange(w.n_sample) * w.chirp_duration / w.n_sample
    start = (chirp[None, :] * w.n_tx + t[:, None]) * w.chirp_interval - w.acquisition_time / 2 + late

    def place(time: np.ndarray) -> np.ndarray:
        time = time[..., None]
        return echoes.out.position[0] + time * (echoes.out.velocity[0] + time / 2 * echoes.out.acceleration[0])

    delays = np.empty(info.cube_shape)
    where = place(start[..., None] + fast)
    for i, (ty, tz) in enumerate(info.array.tx):
        for j, (ry, rz) in enumerate(info.array.rx):
            out = np.linalg.norm(where[i] - [0.0, ty, tz], axis=-1)
            delays[i, :, j] = (out + np.linalg.norm(where[i] - [0.0, ry, rz], axis=-1)) / SPEED_OF_LIGHT
    return delays, np.linalg.norm(place(start + w.chirp_duration / 2), axis=-1)[:, :, None, None]


MOTIONS = [((0.0, 0.0, 0.0), (0.0, 0.0, 0.0)), ((-2.0, 1.0, 0.5), (0.0, 0.0, 0.0)), ((2.0, 1.0, -0.5), (15.0, -10.0, 8.0))]


@pytest.mark.parametrize(("velocity", "acceleration"), MOTIONS)
@pytest.mark.parametrize("lateness", [0.0, 40e-6])
def test_a_tone_is_the_formula(velocity, acceleration, lateness):
    """Phase +2 pi f_c tau at every sample, amplitude over the square of each chirp's distance; float32's recurrence leaves 2e-5."""
    echoes = point((1.4, 0.6, -0.3), velocity, acceleration, strength=2.0)
    late = np.random.default_rng(3).uniform(0, 1, (64, 2)) * lateness
    tau, distance = true_paths(CW, echoes, late.T)
    expected = 2.0 / distance**2 * np.exp(2j * np.pi * CW.waveform.carrier * tau)
    np.testing.assert_allclose(cube_of(CW, echoes, late), expected, atol=3e-5 * np.abs(expected).max())


@pytest.mark.parametrize("info", [OFDM, SLOW_OFDM])
@pytest.mark.parametrize(("velocity", "acceleration"), MOTIONS)
def test_ofdm_is_a_delayed_signal_on_every_carrier(info, velocity, acceleration):
    """The conjugate of what a receiver samples when each carrier comes back late by the delay of that very sample; no transform here.

    The model lets all carriers turn within a symbol by the Doppler frequency of the middle one. What that leaves out is below 1e-5 rad.
    """
    w, echoes = info.waveform, point((2.4, 0.6, -0.3), velocity, acceleration)
    tau, distance = true_paths(info, echoes)
    fast = np.arange(w.n_sample) / w.n_sample * w.chirp_duration
    sampled = np.zeros(info.cube_shape, np.complex128)
    for k, sent in enumerate(np.moveaxis(known_symbols(w), -1, 0)):
        f = w.carrier - w.bandwidth / 2 + k / w.chirp_duration
        sampled += sent[:, :, None, None] * np.exp(2j * np.pi * (k / w.chirp_duration * fast - f * tau))
    expected = sampled.conj() / (distance**2 * math.sqrt(w.n_sample))
    np.testing.assert_allclose(cube_of(info, echoes), expected, atol=3e-5 * np.abs(expected).max())


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
    result = spectrum.make_spectrum(SpectrumConfig(), info).process(cube_of(info, point(5.0 * direction, rate * direction)))
    power = (np.abs(result) ** 2).sum(axis=(0, 2))
    speed, distance = np.unravel_index(np.argmax(power), power.shape)
    assert (speed + 32) % 64 - 32 == round(rate / w.speed_resolution)
    assert distance == (0 if w.modulation == "cw" else round(5.0 / w.range_resolution))
    snapshot = result[:, speed, :, distance] * np.exp(-4j * np.pi * rate * w.chirp_interval / w.wavelength * np.arange(2))[:, None]
    expected = info.array.steering(azimuth, elevation, w.wavelength)
    fit = np.vdot(expected, snapshot.ravel()) / (np.linalg.norm(expected) * np.linalg.norm(snapshot))
    assert abs(fit) > 0.9995


def test_far_ofdm_echoes_fold_back():
    """An echo beyond the unambiguous range appears in the first period, with the power that its distance gives."""
    cube = cube_of(OFDM, point((8.0, 0.0, 0.0)))
    assert np.sqrt(np.mean(np.abs(cube) ** 2)) == pytest.approx(1 / 64, rel=1e-3)
    power = np.abs(spectrum.make_spectrum(SpectrumConfig(), OFDM).process(cube)[0, :, 0]) ** 2
    folded = round((8.0 - OFDM.waveform.max_range) / OFDM.waveform.range_resolution)
    assert np.unravel_index(np.argmax(power), power.shape) == (0, folded)


@pytest.mark.parametrize("info", [CW, OFDM])
def test_envelope_late_chirps_and_legs(info):
    """Echoes add up, chirp by chirp with their amplitude; a mirrored leg back turns receivers only; nothing echoes to nothing."""
    rng = np.random.default_rng(5)
    one, other = point((2.0, 0.4, 0.1), (1.0, 0.0, 0.0)), point((3.0, -0.8, 0.0), (0.0, 1.0, 0.0), strength=1j)
    envelope = rng.uniform(0, 2, (64, 2, 2)).astype(np.float32)
    motion, number = Motion.join([one.out, other.out]), np.full(2, THING, np.int32)
    late = rng.uniform(0, 20e-6, (64, 2))
    both = Echoes(motion, motion, np.array([1, 1j]), number, number, envelope)
    parts = [cube_of(info, e, late) * envelope[:, :, k].T[:, :, None, None] for k, e in enumerate((one, other))]
    whole = cube_of(info, both, late)
    np.testing.assert_allclose(whole, sum(parts), atol=1e-5 * np.abs(whole).max())
    mirrored = Echoes(one.out, other.out, one.strength, one.owner, one.source)
    cube = cube_of(info, mirrored)
    steer = [
        np.exp(-2j * np.pi * sampling(info).rx @ leg.position[0, 1:] / np.linalg.norm(leg.position) / info.waveform.wavelength)
        for leg in (other.out,)
    ]
    turn = (cube * cube[:, :, :1].conj()).sum(axis=(0, 1, 3))
    np.testing.assert_allclose(turn / np.abs(turn), steer[0] / steer[0][0], atol=0.03)  # a sphere at 3 m: 0.02 rad
    assert not cube_of(info, Echoes.none()).any()


def test_waveforms_choose_their_own_models():
    """Fidelity is FMCW's: a tone and OFDM always follow the true path."""
    for model in ("auto", "separable", "reference"):
        assert isinstance(make_propagator(Fidelity(model=model), Physics.all(), sampling(CW), 0.02), Exact)
        assert isinstance(make_propagator(Fidelity(model=model), Physics.all(), sampling(OFDM), 0.02), Ofdm)
