"""Effects on single echoes, each against its own physics: amplitudes in watts, patterns, fluctuation, ghosts, clutter; and their sizes."""

import dataclasses
import math

import numpy as np
import pytest
from echo_settings import (
    CHI_SQUARE,
    MOMENT,
    MOUNT,
    N_POINTS,
    POINTS,
    SETTING,
    SIDE,
    TARGET,
    echoes_at,
    polar,
    seen,
    setting_of,
)
from scipy import stats

from radar_core import SPEED_OF_LIGHT, ConfigError, Pose
from radar_sim.effects import config, echo, multipath, physics, sight
from radar_sim.effects.base import Moment, Setting
from radar_sim.people import Person
from radar_sim.propagation.base import IMPEDANCE
from radar_sim.room import Things
from radar_sim.scatterers import THING, Echoes, Motion, Scatterers
from radar_sim.scene import Scene, SceneRadar
from radar_sim.things import Corner, Point, Wall

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
