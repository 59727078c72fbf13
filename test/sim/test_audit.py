"""Only the effects a scene calls for: the published table, what leaving effects out does to what scenes are for, what effects move."""

import dataclasses
import math
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from benchmarks.effects import apart, chain, deviation, unshared
from radar_core import Pose, RadarInfo
from radar_sim import Effects, MultipathConfig, Person, Point, Scene, SceneRadar, Simulator, Wall, load_scene
from radar_sim.audit import audit, called_for, everything, ours, real, table
from radar_sim.auto import CANDIDATES, choose_effects
from radar_sim.effects.chain import NAMES, is_named
from radar_sim.effects.config import PHYSICS
from radar_sim.probe import displacement, places

DOCS = Path(__file__).parents[2] / "docs" / "research" / "effects.md"
NUMBER = re.compile(r"[0-9][0-9.e+-]*|inf")
OURS = {label: (label, scene, radar) for label, scene, radar in ours()}
SOME = ("single_target", "short", "empty_room", "five_people")


def published() -> list[list[str]]:
    """Cells of the table of effects in the documentation, row by row."""
    rows = [line.strip("|\n ").split(" | ") for line in DOCS.read_text(encoding="utf-8").splitlines() if line.startswith("|")]
    start = next(k for k, row in enumerate(rows) if row[0] == "effect")
    return rows[start : start + 4 + len(NAMES)]


def test_the_published_table_has_every_scene_and_every_effect():
    head, _, *rows = published()
    assert head[1:] == [label.replace("_", " ") for label in OURS]
    assert [row[0] for row in rows[2:]] == [f"`{name}`" for name in NAMES]


@pytest.mark.parametrize("label", [label if label in SOME else pytest.param(label, marks=pytest.mark.long) for label in OURS])
def test_the_published_table_is_what_the_code_says(label):
    """On or off, and what each effect changes: `python docs/research/make_effects.py` writes it anew.

    Sizes are the same to 5 % and 0.0005: where two directions are equally strong, another machine's rounding may prefer the other one.
    """
    column = [row[list(OURS).index(label) + 1] for row in published()]
    wanted = [line.strip("|\n ").split(" | ")[1] for line in table([audit(*OURS[label])]).splitlines()]
    assert column[:4] == wanted[:4]
    for name, cell, own in zip(NAMES, column[4:], wanted[4:], strict=True):
        assert (name, NUMBER.sub("", cell).strip("() ")) == (name, NUMBER.sub("", own).strip("() "))
        assert [float(x) for x in NUMBER.findall(cell)] == pytest.approx([float(x) for x in NUMBER.findall(own)], rel=0.05, abs=5e-4), name


@pytest.mark.long
@pytest.mark.parametrize("label", ["single_target", "short"])
def test_what_a_scene_does_not_call_for_changes_nothing_that_it_is_for(label):
    """With `auto` and with all that is real on, the chain gives the same within the tolerance; `python -m benchmarks effects` does all."""
    _, scene, radar = OURS[label]
    auto = choose_effects(called_for(scene), Simulator, radar).scene
    left_out = [name for name in CANDIDATES if not is_named(auto.effects, name)]
    assert len(left_out) >= 5  # else nothing is compared
    one, other = chain(auto, radar), chain(real(scene), radar)
    assert sum(other.points) > 100
    if scene.purpose == "gestures":
        assert [name for name, _ in other.gestures] == ["push", "swipe_right"]
    assert max(deviation(scene, radar, one, other).values()) <= scene.tolerance


@pytest.mark.long
def test_a_tolerance_that_is_too_wide_is_found_out():
    """With tolerance 1, auto leaves out the occlusion that the scene is about; then people are seen that the other run does not see.

    Without occlusion named: one person stands behind another, at an angle of 0.
    """
    people = (Person(id=1, position=(1.6, 0.0)), Person(id=2, position=(3.2, 0.0)))
    scene = dataclasses.replace(load_scene("two_crossing"), people=people, duration=4.0, tolerance=1.0)
    scene = dataclasses.replace(scene, effects=dataclasses.replace(scene.effects, occlusion=None))
    wide = choose_effects(called_for(scene), Simulator).scene
    assert not is_named(wide.effects, "occlusion")
    assert is_named(choose_effects(called_for(dataclasses.replace(scene, tolerance=0.02)), Simulator).scene.effects, "occlusion")
    assert max(deviation(scene, "", chain(wide, ""), chain(real(scene), "")).values()) > 0.02


def test_everything_is_everything_and_keeps_the_scenes_settings():
    scene = load_scene("demo")
    assert all(is_named(everything(scene).effects, name) for name in NAMES)
    added = {name for name in NAMES if is_named(real(scene).effects, name) and not is_named(scene.effects, name)}
    assert added <= set(CANDIDATES)
    assert everything(scene).effects.noise == real(scene).effects.noise == scene.effects.noise
    assert called_for(scene).effects == dataclasses.replace(scene.effects, auto=True)


def test_effects_that_are_not_named_are_never_called(monkeypatch):
    """Every effect that a scene does not name may be broken: frames are the same bit for bit."""
    scene = load_scene("demo")
    before = Simulator(scene).process(700).frame.cube
    from radar_sim.effects import chain as stages

    def broken(*_):
        raise AssertionError("an effect was made that the scene does not name")

    for kinds in (stages.SCENE, stages.ECHO, stages.SIGNAL):
        for name in kinds:
            if not is_named(scene.effects, name):
                monkeypatch.setitem(kinds, name, dataclasses.replace(kinds[name], make=broken))
    np.testing.assert_array_equal(Simulator(scene).process(700).frame.cube, before)
    with pytest.raises(AssertionError, match="does not name"):
        Simulator(everything(scene))


INFO = RadarInfo(mount=Pose(z=0.0))


def looked_at(*points: Point, moving: bool = False, info: RadarInfo = INFO) -> np.ndarray:
    """Places of the first frame of some points."""
    cube = Simulator(Scene(duration=0.1, radars=(SceneRadar.of(info),), points=points)).process(0).frame.cube
    return places(cube[None].astype(np.complex128), info, moving=moving)[0]


def test_places_are_where_the_strongest_echo_is():
    """Within half a range cell, and within half a step of the directions compared plus what the small elevation adds (0.01 rad)."""
    cell = INFO.waveform.range_resolution
    for x, y in ((2.0, 0.0), (3.0, 1.2), (2.5, -1.5)):
        place = looked_at(Point(position=(x, y, 0.05)), Point(position=(4.5, 0.3, 0.0), rcs=1e-3))
        assert math.hypot(*place) == pytest.approx(math.hypot(x, y), abs=cell)  # a range beside a cell's middle is seen in two
        assert math.atan2(place[1], place[0]) == pytest.approx(math.atan2(y, x), abs=0.03)


def test_what_stands_still_is_left_out_where_people_are_followed():
    strong, walker = Point(position=(2.0, 1.0, 0.0), rcs=10.0), Point(position=(3.5, -1.0, 0.0), velocity=(1.0, 0.0, 0.0), rcs=0.1)
    still, moving = (looked_at(strong, walker, moving=m) for m in (False, True))
    assert still[1] > 0.9
    assert moving[1] < -0.9


def test_nothing_there_has_no_place_and_displacement_says_so():
    """Nothing against nothing: 0; something against nothing: infinite; half a metre at two metres: 0.25."""
    nowhere = looked_at(Point(position=(-2.0, 0.0, 0.0)))
    assert np.isnan(nowhere).all()
    here, there = np.array([[2.0, 0.0]]), np.array([[2.5, 0.0]])
    assert displacement(nowhere[None], nowhere[None]) == 0.0
    assert displacement(here, nowhere[None]) == displacement(nowhere[None], here) == math.inf
    assert displacement(here, there) == 0.25
    assert displacement(np.empty((0, 2)), np.empty((0, 2))) == 0.0


@pytest.mark.parametrize("modulation", [{"modulation": "cw"}, {"modulation": "ofdm", "chirp_duration": 64 / 1.5e9}])
def test_other_modulations_have_places_of_direction(modulation):
    waveform = dataclasses.replace(INFO.waveform, **modulation)
    place = looked_at(Point(position=(2.0, 2.0, 0.0), velocity=(1.0, 0.0, 0.0)), info=dataclasses.replace(INFO, waveform=waveform))
    assert math.atan2(place[1], place[0]) == pytest.approx(math.pi / 4, abs=0.03)


def test_auto_judges_by_what_the_scene_is_for():
    """A ghost in the floor, 8 dB and more below, changes samples by a tenth and more, and moves no strong echo by 2 % of its range."""
    point = Point(position=(4.5, 0.3, 1.1), velocity=(0.4, 0.0, 0.0))  # the ghost is within the field of view
    scene = Scene(duration=0.5, points=(point,), effects=Effects(auto=True))
    by_samples, by_place = (choose_effects(dataclasses.replace(scene, purpose=p), Simulator) for p in ("samples", "detections"))
    assert is_named(by_samples.scene.effects, "multipath")
    assert not is_named(by_place.scene.effects, "multipath")
    change = by_place.changes["multipath"]
    assert change.samples > 0.1 > 0.02 > change.decisive > 0.0
    assert any(line.startswith("multipath: off, it changes the samples by") and "moves the strongest" in line for line in by_place.reasons)
    mirror = dataclasses.replace(scene, purpose="detections", walls=(Wall(start=(0.5, 1.0), end=(6.0, 1.0), mirror=1.0),))
    # at a grazing wall of metal the ghost is as strong as the echo
    assert is_named(choose_effects(mirror, Simulator).scene.effects, "multipath")
    for name in PHYSICS:
        assert by_place.changes[name].decisive < 0.02


def test_places_that_only_one_run_has_count_as_a_range():
    """Four places at 2 m: one 0.2 m off is sqrt(0.1^2 / 4); one missing is sqrt(1 / 4); in both missing: does not count."""
    ours_, origin = np.array([[2.0, 0.0]] * 4), np.zeros(2)
    off, missing = ours_.copy(), ours_.copy()
    off[0, 1], missing[0] = 0.2, np.nan
    assert apart(off, ours_, origin) == pytest.approx(0.05)
    assert apart(missing, ours_, origin) == pytest.approx(0.5)
    assert apart(missing, missing, origin) == 0.0
    nothing = np.full((4, 2), np.nan)
    assert apart(nothing, nothing, origin) == 0.0
    assert apart(nothing, ours_, origin) == 1.0


def test_gestures_that_only_one_run_has_are_a_share():
    assert unshared([], []) == 0.0
    assert unshared([("push", 2.0)], [("push", 2.1)]) == 0.0
    assert unshared([("push", 2.0)], [("pull", 2.0)]) == 1.0
    assert unshared([("push", 2.0), ("wave", 4.0)], [("push", 2.1)]) == 0.5


@pytest.mark.long
def test_explain_all_wants_no_scene_beside_it():
    for arguments in ([], ["demo", "--all"]):
        done = subprocess.run([sys.executable, "-m", "radar_app.cli", "explain", *arguments], capture_output=True, text=True)
        assert done.returncode == 2
        assert "name one scene" in done.stderr
        assert "Traceback" not in done.stderr


def test_multipath_can_be_named_beside_auto():
    """What the scene names stays, whatever it moves."""
    scene = Scene(
        duration=0.5, purpose="detections", points=(Point(position=(2.5, 0.3, 1.1)),), effects=Effects(multipath=MultipathConfig())
    )
    assert is_named(choose_effects(called_for(scene), Simulator).scene.effects, "multipath")
