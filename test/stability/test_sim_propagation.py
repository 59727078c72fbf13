"""Hard cases of propagation: no echoes, echoes at and behind the radar, far beyond it, very fast, very weak, odd shapes."""

import numpy as np
import pytest

from radar_core import AntennaArray, RadarInfo, Waveform
from radar_sim.propagation.base import Physics, Sampling
from radar_sim.propagation.blocks import Blocks
from radar_sim.propagation.choose import DIAL, Auto, make_step
from radar_sim.propagation.exact import Exact
from radar_sim.propagation.reference import Reference
from radar_sim.scatterers import THING, Echoes, Motion

SIMPLE = Physics(doppler_in_chirp=True)
INFO = RadarInfo(waveform=Waveform(n_chirp=8, n_sample=16))


def sampling(info: RadarInfo = INFO) -> Sampling:
    return Sampling(info, np.asarray(info.array.tx, np.float64), np.asarray(info.array.rx, np.float64))


def echo(position, velocity=(0.0, 0.0, 0.0), strength=1.0) -> Echoes:
    motion = Motion(np.array([position]), np.array([velocity]), np.zeros((1, 3)))
    number = np.full(1, THING, np.int32)
    return Echoes(motion, motion, np.array([strength], np.complex128), number, number)


def models(physics: Physics, info: RadarInfo = INFO):
    return [make_step(step, physics, sampling(info)) for step in DIAL if physics.separable or step.model not in ("separable", "nufft")]


@pytest.mark.parametrize("physics", [SIMPLE, Physics.all()])
def test_no_echoes(physics):
    """Nothing comes back: zeros of the right shape, with and without late chirps, from every model and from auto."""
    for model in (*models(physics), Auto(physics, sampling(), 0.02)):
        for late in (None, np.zeros((8, 2))):
            cube = model.process(Echoes.none(), late)
            assert cube.shape == INFO.cube_shape
            assert not cube.any()


@pytest.mark.parametrize("physics", [SIMPLE, Physics.all()])
@pytest.mark.parametrize(
    ("position", "velocity"),
    [
        ((0.0, 0.0, 0.0), (0.0, 0.0, 0.0)),
        ((0.0, 0.0, 0.0), (1.0, 0.0, 0.0)),
        ((1e-12, 0.0, 0.0), (0.0, 2.0, 0.0)),
        ((-2.0, 0.3, 0.1), (1.0, 0.0, 0.0)),
        ((0.0, 1.5, 0.0), (0.0, -1.0, 0.0)),
        ((500.0, 30.0, 0.0), (1.0, 0.0, 0.0)),
    ],
)
def test_places_that_are_hard(physics, position, velocity):
    """At the radar itself, behind it, in its plane, far beyond the largest range: finite, and the reference's sums.

    An echo that passes the origin turns its direction around within a block, which no parabola of a leg follows: there only finite.
    """
    truth = Reference(physics, sampling()).sums(echo(position, velocity))
    passes = physics.curvature and np.linalg.norm(position) < 1e-6 and any(velocity)
    for model in models(physics):
        cube = model.process(echo(position, velocity))
        assert np.isfinite(cube).all()
        if not passes:
            assert np.linalg.norm(cube - truth) < 2e-3 * np.linalg.norm(truth)


def test_late_by_seconds_and_fast_as_a_bullet():
    """Whole turns are dropped in float64: a million of them leave 1e-3 rad at most."""
    fast, late = echo((300.0, 0.0, 0.0), (900.0, 0.0, 0.0)), np.full((8, 2), 2.0)
    truth = Reference(SIMPLE, sampling()).sums(fast, late)
    for model in models(SIMPLE):
        assert np.linalg.norm(model.process(fast, late) - truth) < 1e-3 * np.linalg.norm(truth)


@pytest.mark.parametrize("strength", [0.0, 1e-30, 1e25])
def test_strengths_at_the_ends_of_float32(strength):
    """Scale changes nothing but the scale."""
    for model in models(SIMPLE):
        plain, scaled = model.process(echo((2.0, 0.5, 0.1))), model.process(echo((2.0, 0.5, 0.1), strength=strength))
        np.testing.assert_allclose(scaled.astype(np.complex128), strength * plain.astype(np.complex128), rtol=1e-3, atol=1e-44)


@pytest.mark.parametrize(
    ("n_tx", "n_rx", "n_chirp", "n_sample"), [(1, 1, 1, 1), (1, 1, 5, 3), (1, 3, 1, 200), (3, 1, 40, 2), (2, 5, 70, 9)]
)
def test_odd_shapes(n_tx, n_rx, n_chirp, n_sample):
    """Any number of transmitters, receivers, chirps and samples, alone or not fitting any chunk."""
    half = 0.00195
    array = AntennaArray(tx=tuple((4 * half * k, 0.0) for k in range(n_tx)), rx=tuple((half * k, 0.0) for k in range(n_rx)))
    info = RadarInfo(array=array, waveform=Waveform(n_tx=n_tx, n_chirp=n_chirp, n_sample=n_sample, frame_interval=0.1))
    one = echo((2.0, 0.7, -0.2), (1.0, 0.5, 0.0))
    truth = Reference(SIMPLE, sampling(info)).sums(one)
    for step in DIAL:
        if step.blocks > n_chirp:
            continue
        cube = make_step(step, SIMPLE, sampling(info)).process(one)
        assert cube.shape == info.cube_shape
        assert np.linalg.norm(cube - truth) < 1e-4 * np.linalg.norm(truth), step


def test_long_chirps_do_not_drift():
    """The float32 recurrence starts anew from float64: 8,192 samples are as good as 64."""
    info = RadarInfo(waveform=Waveform(n_chirp=2, n_sample=8192))
    one = echo((2.0, 0.7, -0.2), (1.0, 0.5, 0.0))
    truth = Reference(Physics.all(), sampling(info)).sums(one)
    assert np.linalg.norm(Exact(Physics.all(), sampling(info)).process(one) - truth) < 2e-5 * np.linalg.norm(truth)
    assert np.linalg.norm(Blocks(Physics.all(), sampling(info), 2, 2).process(one) - truth) < 5e-5 * np.linalg.norm(truth)


def test_tolerance_below_float32_takes_the_reference():
    """Where nothing else is good enough, auto is slow rather than wrong."""
    auto = Auto(Physics.all(), sampling(), 1e-6)
    assert auto.choose(echo((2.0, 0.0, 0.0), (1.0, 0.0, 0.0))).model == "reference"


def test_silent_echoes_do_not_upset_auto():
    """All amplitudes zero: no weight to average with, any model will do."""
    auto = Auto(Physics.all(), sampling(), 0.02)
    assert not auto.process(echo((2.0, 0.0, 0.0), strength=0.0)).any()
