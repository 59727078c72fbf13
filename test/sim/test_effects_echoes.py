"""Effects on single echoes, each against its own physics: amplitudes in watts, patterns, fluctuation, ghosts, clutter; and their sizes."""

import dataclasses
import math
import re

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import optimize, stats

from radar_core import SPEED_OF_LIGHT, AntennaArray, ConfigError, Pose, RadarInfo, Waveform
from radar_core.geometry import spherical_to_cartesian
from radar_sim.effects import config, echo, multipath, physics, sight
from radar_sim.effects.base import Moment, Setting
from radar_sim.people import Person
from radar_sim.propagation.base import IMPEDANCE, strength
from radar_sim.room import Things
from radar_sim.scatterers import THING, Echoes, Motion, Scatterers
from radar_sim.scene import Scene, SceneRadar
from radar_sim.things import Corner, Point, Wall

MOMENT = Moment(0, 0.0)


def setting_of(mount: Pose | None = None, **scene) -> Setting:
    radar = SceneRadar(mount=mount or Pose())
    return Setting(Scene(radars=(radar,), **scene), radar)


SETTING = setting_of()


def echoes_at(position, velocity=(0.0, 0.0, 0.0), acceleration=(0.0, 0.0, 0.0), *, rcs=0.1, owner=THING) -> Echoes:
    """Echoes at places of the sensor frame."""
    position = np.atleast_2d(np.asarray(position, np.float64))
    n = len(position)
    motion = Motion(position, *(np.array(np.broadcast_to(v, (n, 3)), np.float64) for v in (velocity, acceleration)))
    owners = np.array(np.broadcast_to(owner, n), np.int32)
    sigma = strength(SETTING.info, np.full(n, rcs)).astype(np.complex128)
    return Echoes(motion, motion, sigma, owners, np.arange(n, dtype=np.int32))


def seen(setting: Setting, time=0.0) -> Echoes:
    """Echoes of a scene's things, by the radar equation."""
    things = Things(setting.scene, setting.radar).scatterers(time)
    motion = things.motion.turned(setting.radar.mount.rotation, setting.radar.mount.origin)
    return Echoes(motion, motion, strength(setting.info, things.rcs) + 0j, things.owner, np.arange(len(things), dtype=np.int32))


def polar(azimuth, elevation, distance=3.0):
    return spherical_to_cartesian(distance, np.radians(azimuth), np.radians(elevation))


# The radar equation.


@pytest.mark.parametrize("distance", [0.5, 1.0, 2.0, 4.0, 6.0])
def test_amplitudes_are_the_radar_equation(distance):
    """Received watts are (2.4), P G^2 lambda^2 sigma / ((4 pi)^3 R^4), for a point and for a corner reflector on its axis; R^-4 exactly."""
    place = (distance, 0.0, 1.2)
    setting = setting_of(points=(Point(position=place, rcs=0.1),), corners=(Corner(position=place),))
    received = physics.amplitudes(seen(setting)) ** 2 / IMPEDANCE
    wave = SPEED_OF_LIGHT / 76.75e9
    sigma = np.array([0.1, 4 * math.pi * 0.05**4 / (3 * wave**2)])
    expected = 10 ** (-3 + 1.2 + 2 * 1.0) * wave**2 * sigma / ((4 * math.pi) ** 3 * distance**4)
    np.testing.assert_allclose(10 * np.log10(received / expected), 0.0, atol=1e-6)


# Pattern.


@pytest.mark.parametrize(("azimuth", "elevation"), [(60, 0), (-60, 0), (0, 30), (0, -30)])
@pytest.mark.parametrize("edge", [-3.0, -10.0])
def test_pattern_at_the_rim(azimuth, elevation, edge):
    """One-way gain `edge` at half the field of view, in each plane: both ways together it weakens amplitudes by `edge` in dB."""
    effect = echo.Pattern(config.PatternConfig(edge=edge), SETTING)
    before = echoes_at(polar(azimuth, elevation))
    ratio = physics.amplitudes(effect.process(before, MOMENT)) / physics.amplitudes(before)
    np.testing.assert_allclose(20 * np.log10(ratio), 2 * edge, atol=1e-9)


def test_pattern_multiplies_both_ways():
    """A ghost that goes out on the boresight and comes back from the rim loses the rim's gain once; what comes from behind loses all."""
    effect = echo.Pattern(config.PatternConfig(edge=-3.0), SETTING)
    straight, rim, behind = (Motion.still(polar(a, 0.0)[None]) for a in (0.0, 60.0, 180.0))
    one = echoes_at(polar(0.0, 0.0))
    level = [
        np.abs(effect.process(dataclasses.replace(one, out=out, back=back), MOMENT).strength / one.strength)[0]
        for out, back in ((straight, straight), (straight, rim), (rim, straight), (straight, behind))
    ]
    np.testing.assert_allclose(level, [1.0, 10 ** (-0.15), 10 ** (-0.15), 0.0], atol=1e-12)


def test_measured_pattern():
    """At the matrix's directions its entries, linear in dB between, and the rim's beyond the rim."""
    azimuth, elevation = (-40.0, 0.0, 50.0), (-20.0, 30.0)
    gain = ((-6.0, -9.0), (0.0, -1.0), (-4.0, -8.0))
    effect = echo.Pattern(config.PatternConfig(azimuth=azimuth, elevation=elevation, gain=gain), SETTING)

    def level(a, e):
        before = echoes_at(polar(a, e))
        return 10 * np.log10(np.abs(effect.process(before, MOMENT).strength / before.strength))[0]  # one way

    for row, a in zip(gain, azimuth, strict=True):
        for value, e in zip(row, elevation, strict=True):
            assert level(a, e) == pytest.approx(value, abs=1e-9)
    assert level(25.0, 5.0) == pytest.approx((0.0 - 1.0 - 4.0 - 8.0) / 4, abs=1e-9)
    assert level(-10.0, -20.0) == pytest.approx(-1.5, abs=1e-9)
    assert level(-80.0, -50.0) == pytest.approx(-6.0, abs=1e-9)
    assert level(85.0, 5.0) == pytest.approx(-6.0, abs=1e-9)


def test_a_pattern_may_have_one_row():
    """Measured along one cut only: the other angle does not matter."""
    cut = config.PatternConfig(azimuth=(0.0,), elevation=(-30.0, 0.0, 30.0), gain=((-5.0, 0.0, -5.0),))
    factor = echo.Pattern(cut, SETTING).gain(np.stack([polar(a, 15.0) for a in (-50.0, 0.0, 20.0)]))
    np.testing.assert_allclose(10 * np.log10(factor), -2.5, atol=1e-9)
    with pytest.raises(ConfigError, match="elevation is empty"):
        config.PatternConfig(azimuth=(0.0,), gain=((),))


# Field of view, losses.


def test_field_of_view():
    """120 by 60 degrees, and a margin; either way beyond it is enough; nothing else changes."""
    angles = [(59, 0), (61, 0), (-61, 0), (0, 29), (0, -31), (180, 0)]
    echoes = echoes_at(np.stack([polar(*a) for a in angles]))
    kept = echo.FieldOfView(config.FieldOfViewConfig(), SETTING).process(echoes, MOMENT)
    np.testing.assert_array_equal(kept.source, [0, 3])
    wider = echo.FieldOfView(config.FieldOfViewConfig(margin=math.radians(2)), SETTING).process(echoes, MOMENT)
    np.testing.assert_array_equal(wider.source, [0, 1, 2, 3, 4])
    ghost = dataclasses.replace(echoes.select(np.array([0])), back=Motion.still(polar(70, 0)[None]))
    assert len(echo.FieldOfView(config.FieldOfViewConfig(), SETTING).process(ghost, MOMENT)) == 0
    inside = echoes.select(np.array([0, 3]))
    assert echo.FieldOfView(config.FieldOfViewConfig(), SETTING).process(inside, MOMENT) is inside


def test_losses():
    """20 dB of power are a tenth of the amplitude."""
    echoes = echoes_at([polar(0, 0), polar(20, 5)])
    lossy = echo.Losses(config.LossesConfig(level=20.0), SETTING).process(echoes, MOMENT)
    np.testing.assert_allclose(lossy.strength, 0.1 * echoes.strength, rtol=1e-12)
    assert lossy.out is echoes.out


# Swerling.

N_POINTS = 400
POINTS = tuple(Point(position=(1.0 + 0.01 * k, 0.3, 1.2), velocity=(0.1, 0.0, 0.0)) for k in range(N_POINTS))
CHI_SQUARE = {1: 2, 2: 2, 3: 4, 4: 4}


def fluctuation(setting: Setting, case: int, of: str = "points", frames: int = 3) -> np.ndarray:
    """Factors on the power, shape (frame, n) or (frame, n_chirp, n_tx, n)."""
    effect = echo.Swerling(config.SwerlingConfig(case=case, of=of), setting)
    w, factors = setting.info.waveform, []
    for k in range(frames):
        before = seen(setting, 0.02 * k + w.acquisition_time / 2)
        after = effect.process(before, Moment(k, 0.02 * k, 5))
        slow = np.abs(after.strength / before.strength) ** 2
        factors.append(slow if after.envelope is None else slow * after.envelope.astype(np.float64) ** 2)
    return np.array(factors)


@pytest.mark.parametrize("case", [1, 2, 3, 4])
def test_swerling_distribution(case):
    """Power over its mean is chi-square with 2 or 4 degrees of freedom over the degrees of freedom (Kolmogorov-Smirnov, 1200 draws)."""
    factors = fluctuation(setting_of(points=POINTS), case)
    if case in (2, 4):
        assert factors.shape == (3, 64, 2, N_POINTS)
        factors = factors[:, [0, 63], [1, 0]][:, 0]
    freedom = CHI_SQUARE[case]
    # A fixed seed: the p-value is not small by chance, but would be 1e-10 and less for the other number of degrees of freedom.
    assert stats.kstest(factors.ravel(), stats.chi2(freedom, scale=1 / freedom).cdf).pvalue > 0.01
    assert stats.kstest(factors.ravel(), stats.chi2(6 - freedom, scale=1 / (6 - freedom)).cdf).pvalue < 1e-6


@pytest.mark.parametrize("case", [1, 2, 3, 4])
def test_swerling_draws_are_independent(case):
    """From target to target, frame to frame and, in cases 2 and 4, chirp to chirp and transmitter to transmitter."""
    factors = fluctuation(setting_of(points=POINTS), case)
    rows = (
        [factors[0], factors[1], factors[2]] if case in (1, 3) else [factors[0, 0, 0], factors[0, 0, 1], factors[0, 1, 0], factors[1, 0, 0]]
    )
    for i, one in enumerate(rows):
        assert abs(np.corrcoef(one[:-1], one[1:])[0, 1]) < 0.2  # 4 standard deviations of 0.05
        for other in rows[:i]:
            assert abs(np.corrcoef(one, other)[0, 1]) < 0.2


def test_swerling_of_people_is_one_factor_each():
    """All echoes of a person fluctuate together, persons apart; points only where they are asked for; case 0 is steady."""
    setting = setting_of(points=POINTS[:2], people=(Person(id=4), Person(id=9, position=(3.0, 1.0))))
    body = echoes_at(np.stack([polar(a, 0) for a in range(10)]), owner=[0, 0, 0, 1, 1, 1, 1, THING, THING, 0])
    points = seen(setting, setting.info.waveform.acquisition_time / 2)
    echoes = Echoes(
        *[Motion.join([points.out, body.out])] * 2,
        np.concatenate([points.strength, body.strength]),
        np.concatenate([points.owner, body.owner]),
        np.arange(12, dtype=np.int32),
    )

    def factors(of, case=1):
        return echo.Swerling(config.SwerlingConfig(case=case, of=of), setting).process(echoes, MOMENT).strength / echoes.strength

    people, both, things = factors("people"), factors("all"), factors("points")
    assert len(set(people[[2, 3, 4, 11]])) == len(set(people[5:9])) == 1
    assert people[2] != people[5]
    np.testing.assert_array_equal(people[[0, 1, 9, 10]], 1.0)
    np.testing.assert_array_equal(things[2:], 1.0)
    assert things[0] != things[1] != 1.0
    np.testing.assert_array_equal(both, people * things)
    np.testing.assert_array_equal(factors("all", 0), 1.0)


def test_swerling_knows_points_whatever_else_is_seen():
    """A point's fluctuation stays the same when others are hidden; walls are steady; envelopes multiply."""
    wall = Wall(start=(4.0, -1.0), end=(4.0, 1.0))
    setting = setting_of(points=POINTS[:5], walls=(wall,))
    every = seen(setting, setting.info.waveform.acquisition_time / 2)
    some = every.select(np.r_[2, 4, 5 : len(every)])
    for case in (1, 2):
        effect = echo.Swerling(config.SwerlingConfig(case=case), setting)
        whole, part = effect.process(every, MOMENT), effect.process(some, MOMENT)
        again = effect.process(dataclasses.replace(some, envelope=np.full((64, 2, len(some)), 2.0, np.float32)), MOMENT)
        np.testing.assert_array_equal(whole.strength[[2, 4]], part.strength[:2])
        np.testing.assert_array_equal(part.strength[2:], some.strength[2:])
        if case == 2:
            np.testing.assert_array_equal(whole.envelope[:, :, [2, 4]], part.envelope[:, :, :2])
            np.testing.assert_array_equal(part.envelope[:, :, 2:], 1.0)
            np.testing.assert_array_equal(again.envelope, 2 * part.envelope)


# Multipath.

MOUNT = Pose(x=0.3, y=-0.4, z=1.3, yaw=0.35, tilt=-0.12)
SIDE = Wall(start=(-2.0, 2.5), end=(6.0, 2.5), thickness=0.2, mirror=0.3)
TARGET, SPEED, ACCELERATION = np.array([2.5, 0.9, 0.8]), np.array([0.6, -0.8, 0.4]), np.array([2.0, 3.0, -1.0])


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


# Clutter.


def test_clutter_is_the_same_for_all():
    """Drawn once from the scene's seed: the same in all frames and, in the room, for all radars; still; without owner; after the rest."""
    radars = (SceneRadar(frame_id="a/radar"), SceneRadar(frame_id="b/radar", mount=Pose(y=1.0, z=1.0, yaw=-0.2)))
    scene = Scene(radars=radars, points=(Point(position=(2.0, 0.0, 1.0)),), seed=3)
    own = Things(scene).scatterers(0.0)
    first, second = (sight.Clutter(config.ClutterConfig(low=(1.0, -3.0, 0.0)), Setting(scene, r, i)) for i, r in enumerate(radars))
    one, other = first.process(own, Moment(0, 0.0)), second.process(own, Moment(7, 3.0, 3, 1))
    np.testing.assert_array_equal(one.motion.position, other.motion.position)
    np.testing.assert_array_equal(one.rcs, other.rcs)
    assert len(one) == 201
    assert one.rcs[0] == own.rcs[0]
    assert (one.owner[1:] == THING).all()
    assert not one.motion.velocity.any()
    reseeded = sight.Clutter(config.ClutterConfig(), Setting(dataclasses.replace(scene, seed=4), radars[0]))
    assert not np.array_equal(reseeded.scatterers.motion.position[0], first.scatterers.motion.position[0])


def test_clutter_distribution():
    """Places even over the volume, cross-sections exponential with the mean asked for (Kolmogorov-Smirnov, 5000 draws)."""
    chosen = config.ClutterConfig(count=5000, rcs=0.002, low=(0.5, -1.0, 0.2), high=(6.0, 2.0, 2.2))
    drawn = sight.Clutter(chosen, SETTING).scatterers
    assert stats.kstest(drawn.rcs, stats.expon(scale=0.002).cdf).pvalue > 0.01
    for axis in range(3):
        low, high = chosen.low[axis], chosen.high[axis]
        assert stats.kstest(drawn.motion.position[:, axis], stats.uniform(low, high - low).cdf).pvalue > 0.01


def test_clutter_behind_the_array_is_shielded():
    """Half of a volume around the radar is behind its plane."""
    chosen = config.ClutterConfig(count=2000, low=(-3.0, -3.0, 0.0), high=(3.0, 3.0, 2.4))
    drawn = sight.Clutter(chosen, SETTING).scatterers
    assert 900 < len(drawn) < 1100  # 4.5 standard deviations
    assert (drawn.motion.position[:, 0] > 0).all()


# Sizes.


def number(text: str) -> float:
    """First number of a line."""
    return float(re.search(r"-?\d+\.?\d*(e-?\d+)?", text).group())


def test_sizes_of_effects():
    """One line each, in the unit that is natural to it."""
    echoes = echoes_at([polar(0, 0), polar(60, 0), polar(70, 0, 6.0)])
    assert (
        echo.Pattern(config.PatternConfig(), SETTING).size(echoes.select(np.array([0, 1])))
        == "-6.0 dB two-way at the echo farthest from boresight"
    )
    # Of three echoes of equal strength, the one beyond has (1/2)^4 of the power of each of the others: 1/33, -15.2 dB.
    assert echo.FieldOfView(config.FieldOfViewConfig(), SETTING).size(echoes) == "1 of 3 echoes are beyond, with -15.2 dB of the power"
    assert echo.FieldOfView(config.FieldOfViewConfig(), SETTING).size(echoes.select(np.array([0]))) == "none of 1 echoes is beyond"
    assert echo.Losses(config.LossesConfig(level=25.0), SETTING).size(echoes) == "-25.0 dB on every echo"
    assert echo.Losses(config.LossesConfig(level=0.0), SETTING).size(echoes) == "0.0 dB on every echo"
    setting = setting_of(points=POINTS[:7])
    assert echo.Swerling(config.SwerlingConfig(case=1), setting).size(echoes) == "5.6 dB rms from frame to frame: 7 points"
    people = dataclasses.replace(setting, scene=dataclasses.replace(setting.scene, people=(Person(),)))
    everybody = echo.Swerling(config.SwerlingConfig(case=4, of="all"), people)
    assert everybody.size(echoes) == "3.5 dB rms from chirp to chirp: 7 points and 1 person"
    assert echo.Swerling(config.SwerlingConfig(case=4), SETTING).size(echoes) == "nothing in the scene fluctuates"
    assert echo.Swerling(config.SwerlingConfig(case=0), SETTING).size(echoes) == "steady (case 0)"


def test_size_of_swerling_is_the_spread():
    """Standard deviation of 10 log10 of the power."""
    for case, spread in ((1, 5.6), (3, 3.5)):
        factor = np.random.default_rng(2).chisquare(CHI_SQUARE[case], 200_000)
        assert np.std(10 * np.log10(factor)) == pytest.approx(spread, abs=0.06)


def test_size_of_multipath():
    """Floor at 1.2 m, target at 3 m and the radar's height: image at 3.84 m, -8.24 - 2.15 dB, half of 0.84 m behind its echo."""
    echoes = echoes_at([3.0, 0.0, 0.0])
    assert multipath.Multipath(config.MultipathConfig(), SETTING).size(echoes) == "strongest ghost -10.4 dB, 0.42 m behind its echo"
    with_ghosts = multipath.Multipath(config.MultipathConfig(), SETTING).process(echoes, MOMENT)
    assert multipath.Multipath(config.MultipathConfig(), SETTING).size(with_ghosts) == "strongest ghost -10.4 dB, 0.42 m behind its echo"
    assert multipath.Multipath(config.MultipathConfig(floor=0.0), SETTING).size(echoes) == "no floor or wall mirrors"


def test_size_of_clutter():
    """Its power against that of the echoes; ten times the cross-section are 10 dB."""
    echoes = echoes_at([3.0, 0.0, 0.0], rcs=1.0)
    levels = [number(sight.Clutter(config.ClutterConfig(rcs=r), SETTING).size(echoes).split(", ")[1]) for r in (1e-3, 1e-2)]
    assert levels[1] - levels[0] == pytest.approx(10.0, abs=0.11)
    drawn = sight.Clutter(config.ClutterConfig(rcs=1e-3), SETTING).scatterers
    distance = np.linalg.norm(drawn.motion.position - [0.0, 0.0, 1.2], axis=-1)
    assert levels[0] == pytest.approx(10 * math.log10((drawn.rcs / distance**4).sum() * 81), abs=0.06)


def test_sizes_of_physics():
    """Against closed forms and exact phases of one echo 1.5 m away, at 40 degrees, crossing and receding."""
    w = Waveform()
    place, velocity, acceleration = polar(40, 10, 1.5), np.array([1.0, -2.0, 0.5]), np.array([5.0, 0.0, 3.0])
    echoes = echoes_at(place, velocity, acceleration)
    rate = abs(float(place @ velocity)) / 1.5
    migrates, shifts = (number(physics.size(name, SETTING, echoes)) for name in ("range_migration", "doppler_in_chirp"))
    assert migrates == pytest.approx(rate * w.acquisition_time / w.range_resolution, rel=0.05)
    assert shifts == pytest.approx(2 * rate * w.carrier / SPEED_OF_LIGHT * 66e-6, rel=0.05)

    half = w.acquisition_time / 2
    distance = [np.linalg.norm(echoes.out.at(t)[0]) for t in (-half, 0.0, half)]
    off = 2 / w.wavelength * 360 * (distance[0] - 2 * distance[1] + distance[2]) / 2  # the even part: no third derivative
    assert number(physics.size("curvature", SETTING, echoes)) == pytest.approx(abs(off), rel=0.05)

    tx, rx = (np.array([[0.0, *e] for e in elements]) for elements in (AntennaArray().tx, AntennaArray().rx))
    u = place / 1.5
    squint = max(abs((t + r) @ u) for t in tx for r in rx) * w.bandwidth / 2 / SPEED_OF_LIGHT * 360
    assert number(physics.size("squint", SETTING, echoes)) == pytest.approx(squint, rel=0.05)
    near = [np.linalg.norm(place - t) + t @ u + np.linalg.norm(place - r) + r @ u - 3.0 for t in tx for r in rx]
    assert number(physics.size("near_field", SETTING, echoes)) == pytest.approx(max(near) / w.wavelength * 360, rel=0.05)


def test_sizes_of_physics_read_well():
    """Units, and digits that count."""
    echoes = echoes_at([2.0, 1.0, 0.0], (0.05, 0.0, 0.0))
    assert re.fullmatch(r"0\.00\d+ bins over a frame", physics.size("range_migration", SETTING, echoes))
    assert re.fullmatch(r"0\.00\d+ bins", physics.size("doppler_in_chirp", SETTING, echoes))
    assert re.fullmatch(r"[\d.]+ deg at the array's and sweep's ends", physics.size("squint", SETTING, echoes))
    assert re.fullmatch(r"[\d.]+ deg at the frame's ends", physics.size("curvature", SETTING, echoes))
    assert re.fullmatch(r"[\d.]+ deg at the array's ends", physics.size("near_field", SETTING, echoes))
    still = echoes_at([2.0, 0.0, 0.0])
    assert physics.size("range_migration", SETTING, still) == "0 bins over a frame"
    assert physics.size("squint", SETTING, still) == "0 deg at the array's and sweep's ends"


def test_a_tone_has_no_range_bins_and_no_sweep():
    """CW: nothing migrates or squints."""
    wave = Waveform(modulation="cw")
    radar = SceneRadar.of(RadarInfo(waveform=wave))
    setting = Setting(Scene(radars=(radar,)), radar)
    echoes = echoes_at([2.0, 1.0, 0.0], (3.0, 0.0, 0.0))
    assert physics.size("range_migration", setting, echoes) == "0 bins over a frame"
    assert physics.size("squint", setting, echoes) == "0 deg at the array's and sweep's ends"


def test_effects_do_not_change_what_they_are_given():
    """Every effect returns new echoes: those that came in are as before, so naming or not naming another one changes nothing."""
    setting = setting_of(MOUNT, points=(Point(position=tuple(TARGET)),), walls=(SIDE,))
    echoes = dataclasses.replace(seen(setting), envelope=None)
    copies = [a.copy() for a in (echoes.out.position, echoes.strength, echoes.owner, echoes.source)]
    effects = [
        echo.Swerling(config.SwerlingConfig(case=2), setting),
        multipath.Multipath(config.MultipathConfig(), setting),
        echo.Pattern(config.PatternConfig(), setting),
        echo.FieldOfView(config.FieldOfViewConfig(), setting),
        echo.Losses(config.LossesConfig(), setting),
    ]
    now = echoes
    for effect in effects:
        before = now.strength.copy(), now.envelope
        after = effect.process(now, MOMENT)
        np.testing.assert_array_equal(now.strength, before[0])
        assert now.envelope is before[1]
        now = after
    for copy, array in zip(copies, (echoes.out.position, echoes.strength, echoes.owner, echoes.source), strict=True):
        np.testing.assert_array_equal(copy, array)
    scatterers = Scatterers.join([Things(setting.scene).scatterers(0.0)])
    n = len(scatterers)
    sight.Clutter(config.ClutterConfig(), setting).process(scatterers, MOMENT)
    assert len(scatterers) == n
