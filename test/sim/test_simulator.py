"""Scene to frame: only named effects are made, they act in one order, and frames depend on the scene and their number only."""

import dataclasses
import math
from typing import get_args, get_type_hints

import numpy as np
import pytest
from truths import ALL_PHYSICS, a_scene, first_cube, point_scene

from radar_core import ConfigError, DataError, Pose, RadarInfo
from radar_core.config import load, plain
from radar_sim import (
    ChirpFaultsConfig,
    ConverterConfig,
    CouplingConfig,
    Effects,
    Fidelity,
    LossesConfig,
    NoiseConfig,
    Person,
    Point,
    Scene,
    SceneRadar,
    Simulator,
    Transmitter,
    Wall,
    load_scene,
)
from radar_sim.effects import chain
from radar_sim.effects.chain import NAMES, default, switched
from radar_sim.effects.config import PHYSICS

INFO = RadarInfo(mount=Pose(z=0.0))
TARGET = (2.5, 0.4, 0.2)
NAMED = [name for name in NAMES if name not in PHYSICS]


@pytest.fixture
def made(monkeypatch):
    """Names of the effects that are constructed."""
    names = []
    for kinds in (chain.SCENE, chain.ECHO, chain.SIGNAL):
        for name, kind in list(kinds.items()):

            def counted(*args, name=name, make=kind.make):
                names.append(name)
                return make(*args)

            monkeypatch.setitem(kinds, name, dataclasses.replace(kind, make=counted))
    monkeypatch.setattr(chain, "AmplitudeModulation", lambda *a: names.append("amplitude"))
    monkeypatch.setattr(chain, "Together", lambda *a: names.append("together"))
    return names


def test_every_effect_is_in_the_chain():
    """Whatever a scene can name is made by the chain or followed by the propagation."""
    fields = {field.name for field in dataclasses.fields(Effects)} - {"auto"}
    assert fields == set(NAMES)
    assert len(NAMES) == len(set(NAMES))


def test_effects_that_are_not_named_are_never_made(made):
    """A scene with every effect but one makes all but that one, each once; a scene without effects makes none."""
    Simulator(point_scene(TARGET, radar=INFO)).process(0)
    assert made == []
    everything = Effects()
    for name in NAMED:
        everything = switched(everything, name, True)
    for name in NAMED:
        made.clear()
        Simulator(point_scene(TARGET, radar=INFO, effects=switched(everything, name, False)))
        assert sorted(made) == sorted(set(NAMED) - {name})


@pytest.fixture(scope="module")
def crowded():
    """A scene in which every effect has something to act on: a person behind another, a wall, a moving point."""
    people = (Person(id=1, position=(2.0, 0.0)), Person(id=2, position=(3.0, 0.1)))
    points = (Point(position=(2.5, -0.8, 1.2), velocity=(-2.0, 1.0, 0.0), rcs=0.3), Point(position=(2.0, 5.0, 1.2), rcs=9.0))
    return Scene(duration=1.0, seed=3, people=people, points=points, walls=(Wall(start=(0.5, -1.5), end=(6.0, -1.5)),))


@pytest.mark.parametrize("name", NAMES)
def test_leaving_an_effect_out_changes_nothing(crowded, name):
    """With an effect the samples differ; without it again they are what they were, bit for bit, whatever was simulated in between."""
    bare = Effects(noise=NoiseConfig()) if name != "noise" else Effects()
    effects = switched(bare, name, True)
    if name == "chirp_faults":
        effects = dataclasses.replace(effects, chirp_faults=ChirpFaultsConfig(dropped=0.1))
    model = "exact" if name in PHYSICS else "auto"  # auto leaves out what is below the tolerance
    scene = dataclasses.replace(crowded, effects=bare, fidelity=Fidelity(model=model))
    before = Simulator(scene).process(7)
    with_it = Simulator(dataclasses.replace(scene, effects=effects)).process(7)
    after = Simulator(scene).process(7)
    assert not np.array_equal(with_it.frame.cube, before.frame.cube)
    np.testing.assert_array_equal(after.frame.cube, before.frame.cube)
    assert np.isfinite(with_it.frame.cube).all()


def test_the_order_in_which_effects_are_listed_does_not_matter(crowded):
    """Effects act in the order of a signal chain, whatever the order in the file."""
    names = [name for name in NAMES if name not in ("converter",)]
    text = {name: True if name in PHYSICS else {} for name in names}
    scenes = [
        load(Scene, {**plain(dataclasses.replace(crowded, effects=Effects())), "effects": dict(order)})
        for order in (text.items(), reversed(text.items()), sorted(text.items()))
    ]
    cubes = [Simulator(scene).process(3).frame.cube for scene in scenes]
    for cube in cubes[1:]:
        np.testing.assert_array_equal(cube, cubes[0])


def test_noise_is_the_same_beside_anything():
    """Noise adds to echoes and to leakage as they are: its numbers do not depend on what else is simulated."""
    noise = first_cube(a_scene(INFO, effects=Effects(noise=NoiseConfig())))
    for more in ({"coupling": CouplingConfig()}, {"losses": LossesConfig()}, ALL_PHYSICS):
        with_noise = first_cube(point_scene(TARGET, radar=INFO, effects=Effects(noise=NoiseConfig(), **more)))
        without = first_cube(point_scene(TARGET, radar=INFO, effects=Effects(**more)))
        np.testing.assert_allclose(with_noise - without, noise, atol=1e-6 * np.abs(with_noise).max())


def test_same_frames_whatever_came_before():
    """A frame depends on the scene and its number: in any order, in a new simulator, bit for bit; another seed gives another."""
    scene = load_scene("short")
    first, second = Simulator(scene), Simulator(scene)
    forwards = [first.process(k) for k in (0, 5, 120)]
    backwards = [second.process(k) for k in (120, 5, 0)][::-1]
    for one, two in zip(forwards, backwards, strict=True):
        np.testing.assert_array_equal(one.frame.cube, two.frame.cube)
        np.testing.assert_array_equal(one.truth.hand_position, two.truth.hand_position)
    other = Simulator(dataclasses.replace(scene, seed=scene.seed + 1)).process(5)
    assert not np.array_equal(other.frame.cube, forwards[1].frame.cube)


def two_radars(**right):
    """The same radar twice, at the same place."""
    radars = (SceneRadar(frame_id="left/radar"), SceneRadar(frame_id="right/radar", **right))
    return Scene(
        duration=1.0,
        radars=radars,
        points=(Point(position=(3.0, 0.0, 1.2), velocity=(1.0, 0.0, 0.0)),),
        effects=Effects(noise=NoiseConfig()),
    )


def test_several_radars():
    """Each has its own noise and place; a late trigger and a slow clock shift its frames in scene time, as its stamps say."""
    scene = two_radars(trigger_offset=0.003, clock_drift=0.005)
    left, right = Simulator(scene, "left"), Simulator(scene, "right/radar")
    assert (left.info.frame_id, right.info.frame_id) == ("left/radar", "right/radar")
    assert [right.process(k).frame.stamp_ns for k in (0, 10)] == [3_000_000, 3_000_000 + 10 * 20_100_000]
    assert left.process(10).frame.stamp_ns == 200_000_000
    assert (left.n_frames, right.n_frames) == (50, math.floor((1.0 - 0.003) / 0.0201))
    noise = [Simulator(dataclasses.replace(scene, points=()), name).process(4).frame.cube for name in ("left", "right")]
    assert abs(np.vdot(*noise)) < 0.05 * np.linalg.norm(noise[0]) * np.linalg.norm(noise[1])
    with pytest.raises(ConfigError, match="no radar 'middle'; it has left/radar, right/radar"):
        Simulator(scene, "middle")


def test_a_converter_gives_counts_and_says_its_full_scale():
    """Whole numbers within the range that the radar's info states."""
    simulator = Simulator(
        point_scene(TARGET, radar=INFO, effects=Effects(noise=NoiseConfig(gain=60.0), converter=ConverterConfig(bits=8, full_scale=0.01)))
    )
    cube = simulator.process(0).frame.cube
    assert simulator.info.full_scale == 127
    np.testing.assert_array_equal(cube.real, np.rint(cube.real))
    assert 3 < np.abs(cube.real).max() <= 128


def test_lost_chirps_are_named():
    """Frames say which chirps are missing."""
    frame = Simulator(point_scene(TARGET, radar=INFO, effects=Effects(chirp_faults=ChirpFaultsConfig(dropped=0.2)))).process(0).frame
    assert 10 < len(frame.missing) < 45
    assert not frame.cube[frame.missing % 2, frame.missing // 2].any()


@pytest.mark.parametrize("amplitude", ["intra", "inter"])
def test_amplitude_modulation(amplitude):
    """The taper acts on what is transmitted, along a chirp or from chirp to chirp, and not on noise (A.25)."""

    def cube(effects, transmitter):
        radar = SceneRadar(mount=Pose(z=0.0), transmitter=transmitter)
        return Simulator(Scene(radars=(radar,), points=(Point(position=TARGET),), effects=effects)).process(0).frame.cube

    shaped, plain_cube = (cube(Effects(), t) for t in (Transmitter(amplitude=amplitude, taper="hamming"), Transmitter()))
    ratio = np.abs(shaped) / np.abs(plain_cube)
    along, across = (3, 1) if amplitude == "intra" else (1, 3)
    assert np.ptp(np.moveaxis(ratio, across, 0), axis=0).max() < 1e-5
    assert ratio.max() == pytest.approx(1.0, abs=0.01)
    assert np.take(ratio, 0, axis=along).max() == pytest.approx(0.08, abs=0.01)


def test_fidelity_that_cannot_show_what_is_named_is_refused():
    with pytest.raises(ConfigError, match="range_migration"):
        Simulator(point_scene(TARGET, effects=Effects(range_migration=True), fidelity=Fidelity(model="separable")))


def test_truth_has_both_hands_and_what_is_seen():
    """Hands of a standing person hang beside the body; visible scatterers are on the side of the person that faces the radar."""
    scene = Scene(duration=1.0, people=(Person(position=(2.5, 0.0)),))
    truth = Simulator(scene).process(3).truth
    right, left = truth.hand_position[0], truth.other_hand_position[0]
    assert right[1] > 0.1 > -0.1 > left[1]  # the person faces the radar: the right hand is to the radar's left
    assert 0.5 < right[2] < 0.9
    assert len(truth.scatterer_position) == len(truth.scatterer_rcs) == len(truth.scatterer_owner) > 100
    assert np.median(truth.scatterer_position[:, 0]) < 2.5
    assert set(truth.scatterer_owner.tolist()) == {0}
    assert truth.gesture_start_ns.tolist() == [0]


@pytest.mark.parametrize("sequence", [-1, 50, 10**12])
def test_no_frames_beyond_the_scene(sequence):
    with pytest.raises(DataError, match="frames 0 to 49"):
        Simulator(Scene(duration=1.0)).process(sequence)


def test_defaults_of_every_effect_can_be_made():
    """`explain` asks what an effect would be with its defaults."""
    for name in NAMED:
        assert type(default(name)).__name__ == f"{''.join(part.capitalize() for part in name.split('_'))}Config"
        assert type(default(name)) in get_args(get_type_hints(Effects)[name])
