"""Fans, curtains and small movers: where they are, how fast, how strong; a scene without them is what it was."""

import math

import numpy as np
import pytest

from radar_core import ConfigError
from radar_core.config import load
from radar_sim import Person, Scene, Simulator
from radar_sim.movers import Curtain, Fan, Mover, Movers
from radar_sim.scatterers import THING

FAN = Fan(position=(3.0, 1.0, 1.2), radius=0.3, rate=4.0, heading=math.pi)
CURTAIN = Curtain(start=(4.0, -1.0), end=(4.0, 1.0), swing=0.1, period=2.0)
CAT = Mover(path=((2.0, 0.0), (3.0, 0.0), (3.0, 2.0)), speed=0.5, pause=1.0, rcs=0.02)


def seen(scene, time, span=0.0074):
    return Movers(scene.seed, scene.fans, scene.curtains, scene.movers).scatterers(time, span)


@pytest.mark.parametrize("tilt", [0.0, math.pi / 2])
def test_blades_turn_about_their_axis(tilt):
    """Each point keeps its distance from the hub, in the plane of the blades, and moves at omega times that, in the middle of the frame."""
    fan = Fan(position=(3.0, 1.0, 1.2), radius=0.3, rate=-4.0, heading=0.4, tilt=tilt)
    axis = np.array([math.cos(0.4) * math.cos(tilt), math.sin(0.4) * math.cos(tilt), math.sin(tilt)])
    first = np.linalg.norm(seen(Scene(fans=(fan,)), 0.0).motion.position - fan.position, axis=1)
    assert 0.25 < first.max() <= 0.3
    for time in (0.013, 1e5):
        motion = seen(Scene(fans=(fan,)), time).motion
        arm = motion.position - fan.position
        np.testing.assert_allclose(np.linalg.norm(arm, axis=1), first, rtol=1e-9)
        np.testing.assert_allclose(arm @ axis, 0.0, atol=1e-12)
        omega = -2 * math.pi * 4.0
        np.testing.assert_allclose(motion.velocity, np.cross(omega * axis, arm), rtol=2e-3, atol=2e-3)
        np.testing.assert_allclose(motion.acceleration, -(omega**2) * arm, rtol=2e-3, atol=2e-2)


def test_a_fan_fills_the_doppler_axis_up_to_its_tips():
    """Power in the fan's range cells beyond 1 m/s, none beyond the tips' speed of 7.5 m/s where nothing wraps round."""
    scene = Scene(duration=0.2, fans=(Fan(position=(2.0, 0.0, 1.2), radius=0.15, rate=3.0, heading=math.pi / 2, rcs=0.1),))
    simulator = Simulator(scene)
    wave = simulator.info.waveform
    power = np.zeros(wave.n_chirp)
    for k in range(simulator.n_frames):
        cube = simulator.process(k).frame.cube
        window = np.hanning(wave.n_chirp)[:, None, None] * np.hanning(wave.n_sample)
        power += (np.abs(np.fft.fft2(cube * window, axes=(1, 3))) ** 2).sum(axis=(0, 2, 3))
    speed = np.abs(np.fft.fftfreq(wave.n_chirp)) * 2 * wave.max_speed
    tip = 2 * math.pi * 3.0 * 0.15
    cell = wave.max_speed / wave.n_chirp * 2
    assert power[(speed > 0.4 * tip) & (speed < tip)].sum() > 0.05 * power.sum()
    assert power[speed > tip + 3 * cell].sum() < 1e-3 * power.sum()


def test_a_curtain_hangs_from_its_top_and_its_hem_swings():
    """Over a period every point moves across the curtain only, to both sides alike, by its share of the swing."""
    places = np.array([seen(Scene(curtains=(CURTAIN,)), t).motion.position for t in np.linspace(0, 2.0, 400, endpoint=False)])
    np.testing.assert_allclose(np.ptp(places[..., 1:], axis=0), 0.0, atol=1e-12)
    reach, height = np.ptp(places[..., 0], axis=0) / 2, places[0, :, 2]
    np.testing.assert_allclose(reach, 0.1 * (1 - height / 2.2), rtol=1e-3)
    np.testing.assert_allclose(places[..., 0].mean(axis=0), 4.0, atol=1e-6)
    assert reach.max() > 0.08


def test_a_mover_goes_to_and_fro_and_rests():
    """On its path, at its speed or at rest a second at each place; after 6 s of way and 4 of rest everything begins again."""
    scene = Scene(movers=(CAT,), seed=3)
    time = np.arange(0.0, 16.0, 0.01)
    middle = np.array([seen(scene, t).motion.position[:, :2].mean(axis=0) for t in time])
    middle -= middle.min(axis=0) - (2.0, 0.0)
    on_path = np.minimum(np.abs(middle[:, 1]), np.abs(middle[:, 0] - 3.0))
    assert on_path.max() < 1e-9
    np.testing.assert_allclose(middle.max(axis=0), (3.0, 2.0), atol=1e-9)
    speed = np.hypot(*(np.diff(middle, axis=0) / 0.01).T)
    assert np.mean(np.isclose(speed, 0.5, atol=1e-6) | np.isclose(speed, 0.0, atol=1e-6)) > 0.98
    np.testing.assert_allclose(np.mean(speed[:1600] < 0.25), 4 / 16, atol=0.01)
    np.testing.assert_allclose(seen(scene, 0.7).motion.position, seen(scene, 0.7 + 16.0).motion.position, atol=1e-9)


def test_cross_sections_add_up():
    """Three blades, a curtain's area times its share, a cat; nobody's."""
    found = seen(Scene(fans=(FAN,), curtains=(CURTAIN,), movers=(CAT,)), 1.0)
    assert found.rcs.sum() == pytest.approx(3 * 0.01 + 2.0 * 2.2 * 0.002 + 0.02)
    assert (found.owner == THING).all()
    assert np.isfinite(found.motion.position).all()


def test_a_scene_without_them_is_what_it_was():
    """Not one sample changes and nothing is made; with one of them people's echoes stay, and something else is there."""
    person = Person(position=(2.0, 0.0))
    plain, moved = (Simulator(Scene(duration=0.1, people=(person,), fans=fans)) for fans in ((), (FAN,)))
    assert plain.world._movers is None
    both = moved.echoes(2)
    people, alone = both.select(both.owner == 0), plain.echoes(2)
    np.testing.assert_array_equal(people.strength, alone.strength)
    np.testing.assert_array_equal(people.out.position, alone.out.position)
    assert len(both) > len(alone)
    assert not np.array_equal(plain.process(2).frame.cube, moved.process(2).frame.cube)


@pytest.mark.parametrize(
    ("kind", "text", "message"),
    [
        (Mover, {"path": [[1, 1]]}, "at least two"),
        (Mover, {"path": [[1, 1], [1, 1]]}, "as the place before it"),
        (Curtain, {"start": [1, 1], "end": [1, 1]}, "give two places"),
        (Fan, {"position": [1, 1, 1], "blades": 0}, "blades"),
    ],
)
def test_what_makes_no_sense_is_refused(kind, text, message):
    with pytest.raises(ConfigError, match=message):
        load(kind, text)
