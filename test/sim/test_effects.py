"""Effects: nothing that is not named acts, each acts as it says, and their order does not matter."""

import dataclasses
import math

import numpy as np
import pytest
from truths import first_cube, peak, point_scene

from radar_core import ConfigError, RadarInfo
from radar_core.config import load
from radar_core.geometry import spherical_to_cartesian
from radar_core.pose import Pose
from radar_sim import Coupling, Effects, Losses, Noise, Pattern, Scene, Simulator, load_scene
from radar_sim import effects as effects_module

INFO = RadarInfo(mount=Pose(z=0.0))
TARGET = (2.5, 0.4, 0.3)


def test_unnamed_effects_are_never_called(monkeypatch):
    """An effect that a scene does not name costs nothing: its code does not run, and the cube is the sum of the echoes bit for bit."""
    plain = first_cube(point_scene(TARGET, radar=INFO))

    def fail(*_args):
        raise AssertionError("an effect ran that the scene does not name")

    for name in ("thermal_noise", "leakage", "two_way_gain"):
        monkeypatch.setattr(f"radar_sim.simulator.{name}", fail)
    np.testing.assert_array_equal(first_cube(point_scene(TARGET, radar=INFO)), plain)
    assert not first_cube(Scene(duration=1.0, radar=INFO)).any()


def test_naming_one_effect_changes_only_what_it_does():
    """Noise of a scene is the same with and without echoes: the cube is their sum."""
    noise = Effects(noise=Noise())
    both = first_cube(point_scene(TARGET, radar=INFO, effects=noise))
    echoes, alone = first_cube(point_scene(TARGET, radar=INFO)), first_cube(Scene(duration=1.0, radar=INFO, effects=noise))
    np.testing.assert_array_equal(both, echoes + alone)


def test_order_of_effects_does_not_matter():
    """However the file orders them, the frames are equal bit for bit."""
    named = {"noise": {"noise_figure": 14}, "coupling": {"level": -50}, "pattern": {}, "losses": {"level": 10}}
    scenes = [
        load(Scene, {"duration": 1, "points": [{"position": TARGET}], "effects": dict(items)})
        for items in (list(named.items()), list(named.items())[::-1])
    ]
    np.testing.assert_array_equal(first_cube(scenes[0]), first_cube(scenes[1]))


def test_null_effects_load_as_defaults():
    """`noise: {}` names the effect with its usual values."""
    assert load(Scene, {"effects": {"noise": {}}}).effects.noise == Noise()
    with pytest.raises(ConfigError, match="rain"):
        load(Scene, {"effects": {"rain": {}}})


def test_coupling_is_a_still_echo_at_the_radar():
    """Leakage beats near zero range, stands still, and has the power it says: the level below the transmitted 12 dBm."""
    cube = first_cube(Scene(duration=1.0, radar=INFO, effects=Effects(coupling=Coupling(level=-60.0))))
    distance, speed = peak(cube, INFO)
    assert distance == pytest.approx(0.03, abs=0.02)
    assert speed == 0.0
    np.testing.assert_allclose(np.abs(cube) ** 2 / 50, 1e-3 * 10 ** (1.2 - 6.0), rtol=1e-5)


@pytest.mark.parametrize(("azimuth", "elevation"), [(0.0, 0.0), (math.radians(60), 0.0), (0.0, math.radians(30)), (0.5, -0.3)])
def test_pattern(azimuth, elevation):
    """One-way -3 dB at each edge of the field of view is -6 dB both ways; powers of cosines between."""
    place = tuple(spherical_to_cartesian(3.0, azimuth, elevation).tolist())
    ratio = first_cube(point_scene(place, radar=INFO, effects=Effects(pattern=Pattern(edge=-3.0)))) / first_cube(
        point_scene(place, radar=INFO)
    )
    fall = [
        -6.0 * math.log10(math.cos(angle)) / math.log10(math.cos(edge))
        for angle, edge in ((azimuth, math.radians(60)), (elevation, math.radians(30)))
    ]
    np.testing.assert_allclose(20 * np.log10(np.abs(ratio)), sum(fall), atol=1e-3)


def test_losses_weaken_echoes_only():
    """Losses act on echoes, not on leakage or noise."""
    lossy = Effects(losses=Losses(level=20.0))
    np.testing.assert_allclose(
        first_cube(point_scene(TARGET, radar=INFO, effects=lossy)), 0.1 * first_cube(point_scene(TARGET, radar=INFO)), rtol=2e-5, atol=0
    )
    for other in (Effects(noise=Noise()), Effects(coupling=Coupling())):
        both = dataclasses.replace(other, losses=lossy.losses)
        np.testing.assert_array_equal(
            first_cube(Scene(duration=1.0, radar=INFO, effects=both)), first_cube(Scene(duration=1.0, radar=INFO, effects=other))
        )


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


def test_boltzmann():
    """The constant is the SI's."""
    assert effects_module.BOLTZMANN == 1.380649e-23
