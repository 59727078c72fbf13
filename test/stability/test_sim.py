"""Hard cases of the simulator: nothing there, everything there, at the radar, far away, fast, long."""

import dataclasses
import math
import tracemalloc

import numpy as np
import pytest

from radar_core import Pose, RadarInfo, Waveform
from radar_sim import (
    Action,
    CouplingConfig,
    Draw,
    Effects,
    Fidelity,
    NoiseConfig,
    PatternConfig,
    Person,
    Point,
    Scene,
    SceneRadar,
    Simulator,
    Variation,
    Walk,
)

INFO = RadarInfo(mount=Pose(z=0.0))
RADARS = (SceneRadar.of(INFO),)
MODELS = pytest.mark.parametrize("model", ["separable", "nufft", "blocks", "exact", "reference"])


def cube_of(*points: Point, model="separable", effects=None, info=INFO, k=0) -> np.ndarray:
    radars, fidelity = (SceneRadar.of(info),), Fidelity(model=model, blocks=min(4, info.waveform.n_chirp))
    scene = Scene(duration=100.0, radars=radars, points=points, fidelity=fidelity, effects=effects or Effects())
    return Simulator(scene).process(k).frame.cube


@MODELS
@pytest.mark.parametrize("position", [(0.0, 0.0, 0.0), (1e-12, 0.0, 0.0), (0.01, 0.0, 0.0), (0.0, 3.0, 0.0), (1e-9, 2.0, 1.0)])
def test_at_the_radar_and_in_the_array_plane(model, position):
    """No division by a range of zero: amplitudes stop rising at 5 cm, and what lies in or behind the array's plane is not seen."""
    cube = cube_of(Point(position=position), model=model, effects=Effects(pattern=PatternConfig()))
    assert np.isfinite(cube).all()
    assert np.abs(cube).max() <= np.abs(cube_of(Point(position=(0.05, 0.0, 0.0)))).max() * 1.01


@MODELS
def test_through_the_radar(model):
    """A target that flies through the radar leaves finite frames before, at, and silent ones after."""
    simulator = Simulator(
        Scene(
            duration=1.0,
            radars=RADARS,
            points=(Point(position=(1.0, 0.0, 0.0), velocity=(-2.0, 0.0, 0.0)),),
            fidelity=Fidelity(model=model),
        )
    )
    power = [float((np.abs(simulator.process(k).frame.cube) ** 2).mean()) for k in (0, 24, 25, 26)]
    assert np.isfinite(power).all()
    assert power[0] > 0
    assert power[-1] == 0.0


@MODELS
def test_beyond_the_sampled_band_and_behind(model):
    """Beats above the sample rate are filtered, not folded: 6.5 m does not appear at 0.1 m; nothing comes from behind."""
    for position in ((6.5, 0.0, 0.0), (1e4, 0.0, 0.0), (-2.0, 0.3, 0.0)):
        assert not cube_of(Point(position=position), model=model).any()


@pytest.mark.parametrize(("rate", "folded"), [(4.3, 4.3 - 8.42), (-4.3, 8.42 - 4.3), (8.42, 0.0)])
def test_ambiguous_speeds_fold(rate, folded):
    """Doppler beyond +-4.2 m/s folds as in a real radar."""
    w = INFO.waveform
    # At 64 chirps a fast target crosses range bins: look at the phase from chirp to chirp instead of a spectrum.
    cube = cube_of(Point(position=(3.0, 0.0, 0.0), velocity=(rate, 0.0, 0.0)))
    turn = np.angle((cube[0, 1:, 0] * cube[0, :-1, 0].conj()).sum())
    assert turn / math.pi * w.max_speed == pytest.approx(folded, abs=0.02)


def test_extreme_strengths():
    """From nothing to a wall: amplitudes are proportional to the root of the cross-section over 20 decades."""
    reference = np.abs(cube_of(Point(position=(3.0, 0.0, 0.0), rcs=1.0))).mean()
    for rcs in (1e-14, 1e6):
        assert np.abs(cube_of(Point(position=(3.0, 0.0, 0.0), rcs=rcs))).mean() == pytest.approx(reference * math.sqrt(rcs), rel=1e-5)
    assert not cube_of(Point(position=(3.0, 0.0, 0.0), rcs=0.0)).any()


def test_empty_scene():
    """Nobody there: silent frames, and a truth of no people with the right shapes."""
    result = Simulator(Scene(duration=1.0)).process(0)
    assert not result.frame.cube.any()
    assert result.truth.position.shape == result.truth.hand_velocity.shape == (0, 3)
    assert result.truth.gesture.dtype == np.uint8
    assert Simulator(Scene(duration=0.0)).n_frames == 0


def test_phase_stays_exact_far_into_a_long_run():
    """After 27 hours a still target is the same to the last bits, a stamp is still whole, and noise is still noise."""
    scene = Scene(duration=1e5, radars=RADARS, points=(Point(position=(3.0, 0.2, 0.1)),))
    simulator = Simulator(scene)
    np.testing.assert_array_equal(simulator.process(simulator.n_frames - 1).frame.cube, simulator.process(0).frame.cube)
    assert simulator.n_frames == 5_000_000
    assert simulator.process(4_999_999).frame.stamp_ns == 4_999_999 * 20_000_000
    noisy = Simulator(dataclasses.replace(scene, points=(), effects=Effects(noise=NoiseConfig())))
    power = [float((np.abs(noisy.process(k).frame.cube) ** 2).mean()) for k in (0, 4_999_999)]
    assert power[0] == pytest.approx(power[1], rel=0.05)


def test_moving_target_far_into_a_long_run():
    """float64 seconds lose nothing that matters: at 1e5 s, 1.5e-11 s, a creeping target's phase step is still right."""
    velocity = 2e-5
    simulator = Simulator(Scene(duration=1e5, radars=RADARS, points=(Point(position=(1.0, 0.0, 0.0), velocity=(velocity, 0.0, 0.0)),)))
    one, two = (simulator.process(k).frame.cube for k in (4_999_000, 4_999_500))
    turn = np.angle((two * one.conj()).sum())
    expected = 4 * math.pi * velocity * 10.0 / INFO.waveform.wavelength
    assert turn == pytest.approx(math.remainder(expected, 2 * math.pi), abs=2e-3)


def test_thousand_points_add_up():
    """float32 sums of 1,000 echoes agree with float64 to 1e-5 of the strongest sample."""
    rng = np.random.default_rng(0)
    places = np.column_stack([rng.uniform(1, 5, 1000), rng.uniform(-2, 2, 1000), rng.uniform(-1, 1, 1000)])
    points = [Point(position=tuple(p)) for p in places.tolist()]
    whole = cube_of(*points)
    parts = sum(cube_of(*points[i::10]).astype(np.complex128) for i in range(10))
    assert np.abs(whole - parts).max() < 1e-5 * np.abs(whole).max()


@pytest.mark.parametrize("height", [0.8, 2.3])
@pytest.mark.parametrize("arm", ["right", "left"])
def test_small_and_tall_people(height, arm):
    """Children and giants do everything without a NaN, at every corner of the knobs."""
    script = [
        Action(gesture=g, size=s, duration=d, tilt=t)
        for g in ("push", "rotate", "random")
        for s, d, t in ((1.2, 0.2, 1.6), (0.4, 3.0, -1.6))
    ]
    script += [
        Action(draw=Draw(size=0.35, speed=3.0, duration=0.5)),
        Action(walk=Walk(to=(2.5, 0.0))),
        Action(walk=Walk(to=(2.5, 1e-9), speed=4.0)),
    ]
    person = Person(
        height=height,
        arm=arm,
        position=(2.5, 0.0),
        variation=Variation(path=0.1, pace=0.5, size=0.3, start=1.0, sway=3.0),
        script=tuple(script),
    )
    simulator = Simulator(Scene(duration=60.0, people=(person,)))
    for k in range(0, simulator.n_frames, 20):
        result = simulator.process(k)
        assert np.isfinite(result.frame.cube).all()
        assert np.isfinite(result.truth.hand_velocity).all()


def test_person_on_top_of_the_radar():
    """Standing under the radar, facing nowhere in particular, is a poor idea but no error."""
    person = Person(position=(0.0, 0.0), script=(Action(gesture="push"),))
    simulator = Simulator(Scene(duration=3.0, people=(person,)))
    assert all(np.isfinite(simulator.process(k).frame.cube).all() for k in range(0, 150, 10))


def test_one_chirp_one_sample_one_channel():
    """The smallest radar there can be."""
    info = RadarInfo(
        waveform=Waveform(n_tx=1, n_chirp=1, n_sample=1),
        array=dataclasses.replace(INFO.array, tx=((0.0, 0.0),), rx=((0.0, 0.0),)),
        mount=Pose(z=0.0),
    )
    for model in ("separable", "nufft", "blocks", "exact", "reference"):
        assert cube_of(Point(position=(0.05, 0.0, 0.0)), info=info, model=model).shape == (1, 1, 1, 1)


def test_memory_stays_flat():
    """Random access keeps nothing: 150 frames leave less behind than one cube takes (256 KiB)."""
    simulator = Simulator(Scene(duration=100.0, people=(Person(),), effects=Effects(noise=NoiseConfig(), coupling=CouplingConfig())))
    simulator.process(0)
    tracemalloc.start()
    before = tracemalloc.get_traced_memory()[0]
    for k in range(150):
        simulator.process(k)
    grown = tracemalloc.get_traced_memory()[0] - before
    tracemalloc.stop()
    assert grown < 256 * 1024
