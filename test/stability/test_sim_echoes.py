"""Hard cases of things in the room and of effects on echoes: nothing, at the radar, behind it, far away, beyond float32."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from radar_core import AntennaArray, Pose, RadarInfo
from radar_sim.effects import config, echo, multipath, physics, sight
from radar_sim.effects.base import Moment, Setting
from radar_sim.people import Person
from radar_sim.room import Things
from radar_sim.scatterers import THING, Echoes, Motion, Scatterers
from radar_sim.scene import Scene, SceneRadar
from radar_sim.things import Corner, Furniture, Point, Wall

MOMENT = Moment(0, 0.0)
SCENE = Scene(
    points=(Point(position=(2.0, 0.0, 1.2)), Point(position=(2.0, 0.0, 1.2))),
    people=(Person(position=(3.0, 1.0)),),
    walls=(Wall(start=(-1.0, 2.0), end=(5.0, 2.0)), Wall(start=(5.0, -2.0), end=(5.0, 2.0), thickness=0.0)),
)
SETTING = Setting(SCENE, SCENE.radars[0])
EFFECTS = [
    *(echo.Swerling(config.SwerlingConfig(case=case, of="all"), SETTING) for case in range(5)),
    multipath.Multipath(config.MultipathConfig(level=-200.0), SETTING),
    echo.Pattern(config.PatternConfig(), SETTING),
    echo.Pattern(config.PatternConfig(azimuth=(-60.0, 60.0), elevation=(0.0,), gain=((-3.0,), (-200.0,))), SETTING),
    echo.FieldOfView(config.FieldOfViewConfig(), SETTING),
    echo.Losses(config.LossesConfig(level=100.0), SETTING),
]
SIZES = [
    *(lambda e, c=case: echo.Swerling(config.SwerlingConfig(case=c, of="all"), SETTING).size(e) for case in range(5)),
    lambda e: multipath.Multipath(config.MultipathConfig(), SETTING).size(e),
    lambda e: multipath.Multipath(config.MultipathConfig(floor=1.0, level=0.0), SETTING).size(e),
    lambda e: echo.Pattern(config.PatternConfig(edge=-60.0), SETTING).size(e),
    lambda e: echo.FieldOfView(config.FieldOfViewConfig(), SETTING).size(e),
    lambda e: echo.Losses(config.LossesConfig(), SETTING).size(e),
    lambda e: sight.Clutter(config.ClutterConfig(), SETTING).size(e),
    lambda e: physics.size("range_migration", SETTING, e),
    lambda e: physics.size("doppler_in_chirp", SETTING, e),
    lambda e: physics.size("squint", SETTING, e),
    lambda e: physics.size("curvature", SETTING, e),
    lambda e: physics.size("near_field", SETTING, e),
]


def echoes_of(position, velocity=0.0, acceleration=0.0, strength=1e-3, owner=THING) -> Echoes:
    position = np.asarray(position, np.float64).reshape(-1, 3)
    motion = Motion(position, np.full_like(position, velocity), np.full_like(position, acceleration))
    n = len(position)
    return Echoes(motion, motion, np.full(n, strength, complex), np.full(n, owner, np.int32), np.arange(n, dtype=np.int32))


def finite(echoes: Echoes) -> bool:
    legs = [getattr(leg, name) for leg in (echoes.out, echoes.back) for name in ("position", "velocity", "acceleration")]
    return all(np.isfinite(a).all() for a in (*legs, echoes.strength, physics.amplitudes(echoes)))


CASES = {
    "nothing": echoes_of([]),
    "one": echoes_of([2.0, 0.0, 0.0]),
    "at the radar": echoes_of([0.0, 0.0, 0.0], velocity=1.0, acceleration=1.0),
    "nearly at the radar": echoes_of([1e-300, 0.0, 0.0], velocity=1.0),
    "behind": echoes_of([[-2.0, 0.0, 0.0], [-1e-12, 0.5, 0.0]]),
    "straight above": echoes_of([0.0, 0.0, 2.0]),
    "on the floor": echoes_of([2.0, 0.0, -1.2]),
    "in the wall": echoes_of([2.0, 2.0, 0.0]),
    "on both sides of the wall": echoes_of([[2.0, 1.95 - 1e-12, 0.0], [2.0, 1.95 + 1e-12, 0.0]]),
    "far and fast": echoes_of([1e4, -1e4, 1e4], velocity=1e3, acceleration=1e6),
    "beyond float32": echoes_of([2.0, 0.0, 0.0], strength=1e60),
    "far below float32": echoes_of([2.0, 0.0, 0.0], strength=1e-200),
    "no power": echoes_of([[2.0, 0.0, 0.0], [3.0, 0.1, 0.0]], strength=0.0),
    "a person": echoes_of([[2.0, 0.0, 0.0], [3.0, 0.1, 0.0]], owner=0),
    "twice the same": echoes_of([[2.0, 0.0, 0.0]] * 2),
}


@pytest.mark.parametrize("name", CASES)
def test_effects_stay_finite(name):
    """No effect, alone or after the others, makes a number that is none; numpy's warnings are errors."""
    now = CASES[name]
    for effect in EFFECTS:
        assert finite(effect.process(CASES[name], MOMENT))
        now = effect.process(now, MOMENT)
        assert finite(now)
        assert now.envelope is None or (now.envelope.shape == (64, 2, len(now)) and np.isfinite(now.envelope).all())


@pytest.mark.parametrize("name", CASES)
def test_sizes_are_lines(name):
    """Whatever the echoes, `size` gives one line without NaN."""
    for size in SIZES:
        line = size(CASES[name])
        assert line
        assert "\n" not in line
        assert "nan" not in line
        assert "inf" not in line.replace("info", "")


def test_nothing_stays_nothing():
    """No echoes in, no echoes out, of the right shapes."""
    for effect in EFFECTS:
        out = effect.process(CASES["nothing"], MOMENT)
        assert len(out) == len(out.out) == len(out.back) == len(out.owner) == len(out.source) == 0


@settings(max_examples=50, deadline=None)
@given(
    place=st.tuples(*[st.floats(-1e4, 1e4, allow_subnormal=True)] * 3),
    speed=st.floats(-1e3, 1e3),
    strength=st.floats(0.0, 1e12),
)
def test_anywhere(place, speed, strength):
    """Any place within a scene's limits: finite, and no path is stronger than a perfect mirror could make it."""
    echoes = echoes_of(place, velocity=speed, strength=strength)
    for effect in EFFECTS[5:]:
        out = effect.process(echoes, MOMENT)
        assert finite(out)
        assert (np.abs(out.strength) <= strength * (1 + 1e-9)).all()
    for size in SIZES[5:]:
        assert size(echoes)


@pytest.mark.parametrize("z", [0.0, -1.0, 1e-4])
def test_a_radar_on_or_under_the_floor(z):
    """There the floor does not mirror."""
    radar = SceneRadar(mount=Pose(z=z))
    effect = multipath.Multipath(config.MultipathConfig(), Setting(Scene(radars=(radar,)), radar))
    assert effect.mirrors == ()
    echoes = CASES["one"]
    assert effect.process(echoes, MOMENT) is echoes


def test_a_radar_in_a_wall():
    """A radar inside a wall, or at its surface, gets no image by it."""
    for y in (2.0, 1.96, 1.95):
        radar = SceneRadar(mount=Pose(y=y))
        scene = Scene(radars=(radar,), walls=SCENE.walls[:1])
        assert multipath.Multipath(config.MultipathConfig(floor=0.0), Setting(scene, radar)).mirrors == ()


def test_things_at_the_radar():
    """A corner with its apex at the radar, a wall through it: finite, no echo of the corner."""
    scene = Scene(corners=(Corner(position=(0.0, 0.0, 1.2)),), walls=(Wall(start=(0.0, -1.0), end=(0.0, 1.0)),))
    things = Things(scene).scatterers(0.0)
    assert things.rcs[0] == 0.0
    assert np.isfinite(things.towards(SCENE.radars[0].mount.origin)).all()


def test_an_empty_room():
    """No things: no scatterers, no hull, of the right shapes; clutter alone."""
    empty = Scene()
    things = Things(empty).scatterers(1e6)
    assert len(things) == 0
    assert things.motion.position.shape == things.normal.shape == (0, 3)
    assert things.hulls == ()
    assert len(sight.Clutter(config.ClutterConfig(count=1), Setting(empty, empty.radars[0])).process(things, MOMENT)) == 1


def test_extreme_things():
    """The largest and the smallest sizes that a scene may have."""
    scene = Scene(
        points=(Point(position=(1e4, -1e4, 1e4), velocity=(1e3, 1e3, -1e3), rcs=1e6), Point(position=(1.0, 0.0, 0.0), rcs=0.0)),
        corners=(Corner(position=(3.0, 0.0, 1.2), edge=2.0), Corner(position=(3.0, 0.0, 1.2), edge=1e-3)),
        walls=(
            Wall(start=(-50.0, 50.0), end=(50.0, 50.0), height=30.0),
            Wall(start=(3.0, 0.0), end=(3.002, 0.0), height=0.01, thickness=0.0),
        ),
        furniture=(
            Furniture(position=(2.0, 1.0), size=(1e-3, 1e-3, 1e-3)),
            Furniture(position=(2.0, 1.0), size=(20.0, 1e-3, 0.3), base=20.0),
        ),
    )
    things = Things(scene).scatterers(1e6)
    for array in (things.motion.position, things.normal, things.rcs, things.towards(np.array([0.0, 0.0, 1.2]))):
        assert np.isfinite(array).all()
    assert (things.rcs >= 0.0).all()
    lengths = np.linalg.norm(things.normal, axis=-1)
    assert (np.isclose(lengths, 1.0) | (lengths == 0.0)).all()


def test_one_element_at_the_phase_centre():
    """An array without extent neither squints nor has a near field."""
    array = AntennaArray(tx=((0.0, 0.0),), rx=((0.0, 0.0),))
    base = RadarInfo()
    radar = SceneRadar.of(RadarInfo(array=array, waveform=type(base.waveform)(n_tx=1)))
    setting = Setting(Scene(radars=(radar,)), radar)
    echoes = echoes_of([1.0, 0.7, 0.2])
    assert physics.size("squint", setting, echoes).startswith("0 deg")
    assert physics.size("near_field", setting, echoes).startswith("0 deg")


def test_all_round_field_of_view():
    """A field of view of 360 by 180 degrees, widened or not, sees what is behind; the pattern's model stays finite."""
    array = AntennaArray(fov_azimuth=2 * math.pi, fov_elevation=math.pi)
    radar = SceneRadar.of(RadarInfo(array=array))
    setting = Setting(Scene(radars=(radar,)), radar)
    for margin in (0.0, 1.0):
        assert len(echo.FieldOfView(config.FieldOfViewConfig(margin=margin), setting).process(CASES["behind"], MOMENT)) == 2
    for edge in (0.0, -60.0):
        assert finite(echo.Pattern(config.PatternConfig(edge=edge), setting).process(CASES["behind"], MOMENT))


def test_no_field_of_view():
    """A margin that leaves nothing of the field of view leaves nothing of the echoes."""
    effect = echo.FieldOfView(config.FieldOfViewConfig(margin=-1.0), SETTING)
    assert len(effect.process(CASES["one"], MOMENT)) == 0


def test_clutter_all_behind():
    """Nothing of it is left, and it says so."""
    chosen = config.ClutterConfig(low=(-3.0, -1.0, 0.0), high=(-1.0, 1.0, 2.0))
    empty = Scatterers.join([])
    assert len(sight.Clutter(chosen, SETTING).process(empty, MOMENT)) == 0
    assert sight.Clutter(chosen, SETTING).size(CASES["one"]) == "all of it is behind the array"
    assert "no echoes" in sight.Clutter(config.ClutterConfig(rcs=0.0), SETTING).size(CASES["one"])
