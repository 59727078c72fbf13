"""Ghosts by way of walls and floor, against mirrors and the ways themselves."""

import dataclasses
import math

import numpy as np
import pytest
from echo_settings import (
    ACCELERATION,
    MOMENT,
    MOUNT,
    SIDE,
    SPEED,
    TARGET,
    setting_of,
)
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import optimize

from radar_core import Pose
from radar_sim.effects import config, multipath, physics
from radar_sim.scatterers import Echoes, Motion
from radar_sim.things import Wall


def room_echo(mount: Pose, place=TARGET) -> Echoes:
    """One echo at a place of the room, moving in the room."""
    motion = Motion(place[None].astype(float), SPEED[None], ACCELERATION[None]).turned(mount.rotation, mount.origin)
    return Echoes(motion, motion, np.array([1.0 + 0j]), np.array([7], np.int32), np.array([3], np.int32))


def shortest_by_way_of(surface, mount: Pose, place: np.ndarray):
    """Length of the shortest way from radar to place that touches a surface (Fermat), and where; ``surface(a, b)`` gives its points."""
    result = optimize.minimize(
        lambda x: np.linalg.norm(surface(*x) - mount.origin) + np.linalg.norm(surface(*x) - place),
        [1.0, 1.0],
        method="BFGS",
        options={"gtol": 1e-10},
    )
    return result.fun, surface(*result.x)


SURFACES = {"floor": lambda a, b: np.array([a, b, 0.0]), "wall": lambda a, b: np.array([a, 2.4, b])}


def ghosts_of(kind: str, **more) -> tuple[Echoes, float]:
    """Echo and its three ghosts by way of one mirror, and that mirror's share."""
    setting = setting_of(MOUNT, walls=() if kind == "floor" else (SIDE,))
    chosen = config.MultipathConfig(floor=0.15 if kind == "floor" else 0.0, **more)
    return multipath.Multipath(chosen, setting).process(room_echo(MOUNT), MOMENT), 0.15 if kind == "floor" else 0.3


@pytest.mark.parametrize("kind", ["floor", "wall"])
def test_ghosts_are_at_the_mirrored_place(kind):
    """Length and direction of a mirrored leg are those of the shortest way that touches the mirror: 1e-6 m, 1e-4 rad (of the optimiser)."""
    echoes, _ = ghosts_of(kind)
    length, touch = shortest_by_way_of(SURFACES[kind], MOUNT, TARGET)
    straight = np.linalg.norm(TARGET - MOUNT.origin)
    np.testing.assert_allclose(echoes.range, [straight, (straight + length) / 2, (straight + length) / 2, length], atol=1e-6)
    arrives = MOUNT.from_room(touch)
    for leg, rows in ((echoes.out, [2, 3]), (echoes.back, [1, 3])):
        unit = leg.position[rows] / np.linalg.norm(leg.position[rows], axis=-1, keepdims=True)
        np.testing.assert_allclose(unit, np.tile(arrives / np.linalg.norm(arrives), (2, 1)), atol=1e-4)
    mirrored = TARGET * [1, 1, -1] if kind == "floor" else TARGET * [1, -1, 1] + [0, 4.8, 0]
    np.testing.assert_allclose(MOUNT.to_room(echoes.out.position[3]), mirrored, atol=1e-12)
    np.testing.assert_array_equal(echoes.source, 3)
    np.testing.assert_array_equal(echoes.owner, 7)


@pytest.mark.parametrize("kind", ["floor", "wall"])
def test_ghosts_move_as_the_way_changes(kind):
    """Rate and second derivative of the mirrored way, from shortest ways of the moving target (differences: 1e-5 m/s, 1e-2 m/s^2)."""
    echoes, _ = ghosts_of(kind)
    step = 1e-2
    lengths = [shortest_by_way_of(SURFACES[kind], MOUNT, TARGET + t * SPEED + t**2 / 2 * ACCELERATION)[0] for t in (-step, 0.0, step)]
    assert echoes.range_rate[3] == pytest.approx((lengths[2] - lengths[0]) / (2 * step), abs=2e-3)
    later = [np.linalg.norm(echoes.out.at(t)[3]) for t in (-step, 0.0, step)]
    np.testing.assert_allclose(later, lengths, atol=1e-6)
    straight = np.array([np.linalg.norm(echoes.out.at(t)[0]) for t in (-step, step)])
    one_way = (np.diff(straight)[0] + lengths[2] - lengths[0]) / (4 * step)
    np.testing.assert_allclose(echoes.range_rate[1:3], one_way, atol=2e-3)


@pytest.mark.parametrize("kind", ["floor", "wall"])
def test_ghosts_are_as_weak_as_the_mirror_and_the_way_make_them(kind):
    """Each bounce: the root of the mirror's share, turned by pi; each leg spreads over its length: P ~ share^n / (R_out R_back)^2."""
    echoes, share = ghosts_of(kind)
    length, _ = shortest_by_way_of(SURFACES[kind], MOUNT, TARGET)
    ratio = np.linalg.norm(TARGET - MOUNT.origin) / length
    level = physics.amplitudes(echoes) / physics.amplitudes(echoes)[0]
    np.testing.assert_allclose(level, [1.0, math.sqrt(share) * ratio, math.sqrt(share) * ratio, share * ratio**2], rtol=1e-6)
    np.testing.assert_allclose(echoes.strength, [1.0, -math.sqrt(share), -math.sqrt(share), share], rtol=1e-12)


def test_reciprocity():
    """There mirrored and back mirrored are one way, walked in both senses."""
    echoes, _ = ghosts_of("wall")
    for name in ("position", "velocity", "acceleration"):
        out, back = getattr(echoes.out, name), getattr(echoes.back, name)
        np.testing.assert_array_equal(out[1], back[2])
        np.testing.assert_array_equal(out[2], back[1])


def test_two_mirrors_are_two_sets_of_ghosts():
    """Mirrors do not mirror each other's images: 1 + 3 + 3 echoes, in the order floor, walls."""
    setting = setting_of(MOUNT, walls=(SIDE,))
    both = multipath.Multipath(config.MultipathConfig(), setting).process(room_echo(MOUNT), MOMENT)
    floor, wall = ghosts_of("floor")[0], ghosts_of("wall")[0]
    np.testing.assert_array_equal(both.out.position, np.concatenate([floor.out.position, wall.out.position[1:]]))
    np.testing.assert_array_equal(both.strength, np.concatenate([floor.strength, wall.strength[1:]]))
    assert len(multipath.Multipath(config.MultipathConfig(walls=False), setting).process(room_echo(MOUNT), MOMENT)) == 4


@pytest.mark.parametrize(
    ("wall", "count"),
    [
        (SIDE, 4),
        (dataclasses.replace(SIDE, start=(6.0, 2.5), end=(-2.0, 2.5)), 4),  # drawn from the other end
        (dataclasses.replace(SIDE, start=(-2.0, 2.5), end=(1.70, 2.5)), 1),  # ends before the mirror point, (1.733, 2.4, 0.974)
        (dataclasses.replace(SIDE, start=(-2.0, 2.5), end=(1.77, 2.5)), 4),
        (dataclasses.replace(SIDE, start=(1.77, 2.5), end=(6.0, 2.5)), 1),  # begins behind it
        (dataclasses.replace(SIDE, height=0.95), 1),  # lower than the mirror point
        (dataclasses.replace(SIDE, height=1.0), 4),
        (dataclasses.replace(SIDE, mirror=0.0), 1),
        (Wall(start=(-2.0, 0.2), end=(6.0, 0.2)), 1),  # between radar and target
        (Wall(start=(0.25, -5.0), end=(0.25, 5.0)), 1),  # the radar hangs on it
        (Wall(start=(4.0, -2.0), end=(4.0, 3.0)), 4),  # behind the target
        (Wall(start=(1.0, 0.9 - 0.05), end=(4.0, 0.9 - 0.05)), 1),  # the target is part of its surface
        (Wall(start=(-1.2, -5.0), end=(-1.2, 5.0)), 1),  # its images are behind the array
    ],
)
def test_only_what_a_wall_can_show(wall, count):
    """The mirror point lies on the wall, radar and target are on one side of it, the image in front of the array."""
    effect = multipath.Multipath(config.MultipathConfig(floor=0.0), setting_of(MOUNT, walls=(wall,)))
    assert len(effect.process(room_echo(MOUNT), MOMENT)) == count


def test_weak_paths_are_left_out():
    """By level against the straight path: floor at -8.2 dB a bounce and a little for the way; with both bounces twice that."""
    assert len(ghosts_of("floor", level=-15.0)[0]) == 3
    assert len(ghosts_of("floor", level=-5.0)[0]) == 1
    echoes = room_echo(MOUNT)
    assert multipath.Multipath(config.MultipathConfig(level=-5.0), setting_of(MOUNT)).process(echoes, MOMENT) is echoes


def test_ghosts_fluctuate_with_their_echo():
    """An envelope goes with every path."""
    envelope = np.arange(1.0, 129.0, dtype=np.float32).reshape(64, 2, 1)
    echoes = dataclasses.replace(room_echo(MOUNT), envelope=envelope)
    both = multipath.Multipath(config.MultipathConfig(), setting_of(MOUNT)).process(echoes, MOMENT)
    np.testing.assert_array_equal(both.envelope, np.repeat(envelope, 4, axis=2))


@settings(max_examples=40, deadline=None)
@given(x=st.floats(0.5, 5.0), y=st.floats(-2.0, 2.3), z=st.floats(0.05, 2.0), yaw=st.floats(-0.6, 0.6))
def test_images_reflect_anywhere(x, y, z, yaw):
    """Wherever target and radar are: image and echo are as far from the mirror, and the way is longer than the straight one."""
    mount = Pose(z=1.2, yaw=yaw)
    (mirror,) = multipath.Multipath(config.MultipathConfig(floor=0.0), setting_of(mount, walls=(SIDE,))).mirrors
    echo = room_echo(mount, np.array([x, y, z])).out
    image = mirror.image(echo)
    sides = [(leg.position - mirror.start) @ mirror.normal for leg in (echo, image)]
    np.testing.assert_allclose(sides[0], -sides[1], atol=1e-9)
    assert np.linalg.norm(image.position) > np.linalg.norm(echo.position)
    twice = mirror.image(image)
    np.testing.assert_allclose(twice.position, echo.position, atol=1e-9)
    np.testing.assert_allclose(np.linalg.norm(image.velocity), np.linalg.norm(echo.velocity))
