"""Simulated lives: scenes that can be, the same for the same draws, and files that give them back."""

from __future__ import annotations

import dataclasses
import itertools
import math

import numpy as np
import pytest

from radar_core import GESTURES, ConfigError, DataError, PointCloud, RadarInfo
from radar_lab.datasets import lives
from radar_lab.datasets.life_scenes import DURATION, KINDS, kind_of, life_scene
from radar_lab.datasets.life_strokes import gesture_of, own_name, own_strokes
from radar_lab.datasets.samples import open_folder, write_chunk
from radar_lab.evaluation.scoring import TruthSegment
from radar_sim import Action, Effects, LossesConfig, NoiseConfig, Person, Scene, SceneRadar
from radar_sim.motions.strokes import Performance, perform

S = 1_000_000_000
PUSH = GESTURES.index("push")


def possible(number, seed=1, tries=30):
    """First scene of a number that can be; a scene that cannot is refused when it is made."""
    rng = np.random.default_rng([seed, number])
    for _ in range(tries):
        try:
            return life_scene(number, rng)
        except ConfigError:
            continue
    raise AssertionError(f"number {number}: {tries} draws, and no scene")


@pytest.fixture(scope="module")
def scenes():
    return [possible(number) for number in range(80)]


def test_the_same_draws_give_the_same_scene_and_others_another(scenes):
    assert [possible(number) for number in range(8)] == scenes[:8]
    assert possible(0, seed=2) != scenes[0]
    assert life_scene(0, np.random.default_rng(3), "tinyrad") == life_scene(3, np.random.default_rng(3))


def test_radars_of_all_kinds_take_turns(scenes):
    """Four in a row are seen by four carriers; they hang where people hang radars, never tilted up by more than 2 degrees."""
    assert [kind_of(number) for number in range(5)] == [*KINDS, "design"]
    for number in range(0, len(scenes), 4):
        carriers = [round(scene.radars[0].waveform.carrier / 1e9) for scene in scenes[number : number + 4]]
        assert [carrier // 10 for carrier in carriers] == [7, 7, 6, 2]
    for scene in scenes:
        assert 0.8 <= scene.radars[0].mount.z <= 2.4
        assert scene.radars[0].mount.tilt <= math.radians(2.0)


def test_people_stand_where_the_radar_sees_them_and_do_all_kinds_of_things(scenes):
    for scene in scenes:
        assert scene.duration == DURATION
        assert 1 <= len(scene.people) <= 4
        places = np.array([person.position for person in scene.people])
        distance = np.hypot(*places.T)
        assert (distance >= 0.6).all()
        assert (distance <= min(5.5, scene.radars[0].waveform.max_range - 0.5)).all()
        assert (np.abs(np.degrees(np.arctan2(places[:, 1], places[:, 0]))) <= 52.0).all()
        assert all(np.hypot(*(a - b)) > 0.8 for a, b in itertools.combinations(places, 2))
    people = [person for scene in scenes for person in scene.people]
    actions = [action for person in people for action in person.script]
    strokes = {action.gesture for action in actions if action.gesture}
    assert strokes == {*GESTURES, *(f"as_{gesture}" for gesture in GESTURES)}
    assert any(person.moves is None for person in people)
    assert any(person.moves is not None and person.moves.speed[1] > 1.5 for person in people)
    for name in ("walk", "fidget", "reach", "draw", "sit", "rise", "stand"):
        assert any(getattr(action, name) is not None for action in actions), name
    assert {person.arm for person in people} == {"left", "right"}
    assert {len(scene.people) for scene in scenes} == {1, 2, 3, 4}
    assert any(scene.walls for scene in scenes)
    assert any(not scene.walls for scene in scenes)


def test_who_sits_rises_before_walking_off(scenes):
    """Nobody sits down twice, or walks while sitting."""
    for person in (person for scene in scenes for person in scene.people):
        sits = False
        for action in person.script:
            if action.sit is not None or action.walk is not None:
                assert not sits
            sits = (sits or action.sit is not None) and action.rise is None


@pytest.mark.parametrize("seed", range(40))
def test_strokes_of_other_people_are_what_they_are_called(seed):
    """Where the hand goes from the first place to the last, in the middle and how far, for each of the ten."""
    strokes = {stroke.name.removeprefix("as_"): stroke for stroke in own_strokes(np.random.default_rng(seed))}
    assert set(strokes) == set(GESTURES)
    paths = {name: perform(stroke.path(), Performance()) for name, stroke in strokes.items()}
    ways = {name: np.array([path(u) for u in np.linspace(0.0, 1.0, 201)]) for name, path in paths.items()}
    gone = {name: way[-1] - way[0] for name, way in ways.items()}
    assert gone["push"][0] > 0.2
    assert gone["pull"][0] < -0.2
    assert gone["swipe_up"][2] > 0.2
    assert gone["swipe_down"][2] < -0.2
    assert gone["swipe_left"][1] > 0.15
    assert gone["swipe_right"][1] < -0.15
    out = ways["push_pull"][:, 0]
    assert out.max() > max(out[0], out[-1]) + 0.15
    for name, stroke in strokes.items():
        assert np.linalg.norm(ways[name], axis=1).max() < 1.0
        fastest = np.linalg.norm(np.diff(ways[name], axis=0), axis=1).max() * 200 * 0.62 / stroke.duration
        assert 0.1 < fastest < 9.0, name


def test_a_left_arm_does_the_right_ones_swipes_in_a_mirror():
    left, right = (Person(position=(2.0, 0.0), arm=arm) for arm in ("left", "right"))
    assert own_name("swipe_left", "left") == "as_swipe_right"
    for arm, person in (("left", left), ("right", right)):
        for gesture in GESTURES:
            assert gesture_of(own_name(gesture, arm), person) == gesture
            assert gesture_of(gesture, person) == gesture


def small_life(number=3, n=6):
    """Two people and a cloud of up to four points every 50 ms."""
    rng = np.random.default_rng(number)
    names = [*lives.FIELDS]
    clouds = [
        PointCloud(S + 50_000_000 * k, k, "radar", **{name: rng.standard_normal(k % 5).astype(np.float32) for name in names})
        for k in range(n)
    ]
    position = rng.standard_normal((n, 2, 3)).astype(np.float32)
    segments = (TruthSegment(1, PUSH, S, S + 10**8), TruthSegment(2, 0, S, S + 2 * 10**8))
    return lives.Life(number, kind_of(number), RadarInfo(), clouds, np.array([1, 2]), position, segments)


def test_a_file_gives_the_life_back(tmp_path):
    life, folder = small_life(), open_folder(tmp_path / "lives", lives.manifest(1))
    write_chunk(lives.life_path(folder, life.number), lives.life_columns(life), compressed=True)
    (again,) = map(lives.read_life, lives.life_files(folder))
    assert (again.number, again.kind, again.info, again.segments) == (life.number, life.kind, life.info, life.segments)
    np.testing.assert_array_equal(again.position, life.position)
    np.testing.assert_array_equal(again.person_id, life.person_id)
    for a, b in zip(again.clouds, life.clouds, strict=True):
        assert (a.stamp_ns, a.frame_id) == (b.stamp_ns, b.frame_id)
        for name in lives.FIELDS:
            np.testing.assert_array_equal(getattr(a, name), getattr(b, name))
        assert np.isnan(a.noise).all()


def test_what_is_no_life_is_refused(tmp_path):
    """Positions of nobody, a folder with nothing or something else in it, and files that are cut off or lack a column."""
    life = small_life()
    with pytest.raises(DataError, match="positions have shape"):
        dataclasses.replace(life, position=life.position[:, :1])
    with pytest.raises(DataError, match="no lives here"):
        lives.life_files(tmp_path)
    open_folder(tmp_path / "other", {"format": 2})
    with pytest.raises(DataError, match="holds other samples"):
        lives.life_files(tmp_path / "other")
    open_folder(tmp_path / "newer", {"lives": 99})
    with pytest.raises(DataError, match="have format 99"):
        lives.life_files(tmp_path / "newer")
    bad = tmp_path / "life_00000.npz"
    bad.write_bytes(b"PK\x03\x04 cut off")
    with pytest.raises(DataError, match=r"life_00000\.npz: cannot be read"):
        lives.read_life(bad)
    columns = lives.life_columns(life)
    del columns["position"]
    write_chunk(bad, columns)
    with pytest.raises(DataError, match=r"life_00000\.npz: is no life \('position'\)"):
        lives.read_life(bad)


def short_scene(number, rng, tries):
    """One push in 3 s; the first draw of an odd number is of a scene that cannot be."""
    tries.append(number)
    if number % 2 and tries.count(number) % 2:
        raise ConfigError("a wall through somebody")
    script = (Action(stand=0.3), Action(gesture=own_name("swipe_left", "left") if number else "push"))
    person = Person(position=(2.0, float(rng.uniform(-0.2, 0.2))), body="ellipsoids", arm="left" if number else "right", script=script)
    info = dataclasses.replace(RadarInfo(), full_scale=0.0)
    effects = Effects(noise=NoiseConfig(), losses=LossesConfig())
    seed, strokes = int(rng.integers(1000)), own_strokes(rng)
    return Scene(duration=3.0, seed=seed, radars=(SceneRadar.of(info),), people=(person,), strokes=strokes, effects=effects)


@pytest.mark.long
def test_a_stopped_run_goes_on_and_gives_the_same_files(tmp_path, monkeypatch):
    tries = []
    monkeypatch.setattr(lives, "life_scene", lambda number, rng, gestures: short_scene(number, rng, tries))
    one, two = tmp_path / "one", tmp_path / "two"
    assert lives.generate_lives(one, 2, seed=5, progress=False) == 2
    assert tries == [0, 1, 1]
    assert lives.generate_lives(two, 1, seed=5, progress=False) == 1
    before = lives.life_path(two, 0).stat().st_mtime_ns
    assert lives.generate_lives(two, 2, seed=5, progress=False) == 2
    assert lives.life_path(two, 0).stat().st_mtime_ns == before
    for number in range(2):
        assert lives.life_path(one, number).read_bytes() == lives.life_path(two, number).read_bytes()
    life = lives.read_life(lives.life_path(one, 1))
    assert [segment.name for segment in life.segments] == ["swipe_left"]
    assert [segment.name for segment in lives.read_life(lives.life_path(one, 0)).segments] == ["push"]
    assert len(life.clouds) > 60
    with pytest.raises(ConfigError, match="other settings"):
        lives.generate_lives(one, 2, seed=6, progress=False)


def test_a_number_without_a_possible_scene_is_left_out(monkeypatch):
    def never(number, rng, gestures):
        raise ConfigError("a wall through somebody")

    monkeypatch.setattr(lives, "life_scene", never)
    assert lives.simulate_life(0, np.random.default_rng(1)) is None
    with pytest.raises(DataError, match="life 0 of seed 1"):
        lives.scene_of(0)


def test_the_scene_of_a_life_can_be_drawn_again(monkeypatch):
    monkeypatch.setattr(lives, "record_life", lambda number, scene, simulator, rng: scene)
    scene = lives.simulate_life(3, lives._draws(3, 5))
    assert lives.scene_of(3, 5) == scene
    assert lives.scene_of(3, 6) != scene
    busy = lives.simulate_life(3, lives._draws(3, 5), 0.8)
    assert busy not in (scene, None)
    assert lives.scene_of(3, 5, 0.8) == busy


def test_people_gesture_as_often_as_they_are_told():
    """Of what those do who gesture at all, the wanted share is gestures: standing before one is no action of its own."""
    for wanted in (0.5, 0.8):
        done = [0, 0]
        for number in range(30):
            for person in lives.scene_of(number, 3, wanted).people:
                names = [action for action in person.script if action.stand is None]
                gestures = sum(action.gesture is not None for action in names)
                if gestures:
                    done[0] += gestures
                    done[1] += len(names)
        assert done[0] / done[1] == pytest.approx(wanted / (1 - 0.1 * (1 - wanted)), abs=0.06)


def test_lives_with_more_gestures_are_kept_apart(tmp_path):
    assert lives.manifest(1, lives.GESTURES_SHARE) == lives.manifest(1)
    lives.open_folder(tmp_path, lives.manifest(2, 0.8))
    with pytest.raises(ConfigError, match="other settings"):
        lives.generate_lives(tmp_path, 0, seed=2, progress=False)
    with pytest.raises(ConfigError, match=r"gestures is 1\.5; .*0 to 1"):
        lives.generate_lives(tmp_path, 0, seed=2, gestures=1.5, progress=False)
