"""Scene files: ours load and keep their promises; mistakes are named by file, line and key."""

import dataclasses
from itertools import pairwise

import numpy as np
import pytest

from radar_core import GESTURES, NO_GESTURE, ConfigError
from radar_core.config import load, plain
from radar_core.paths import share_dir
from radar_sim import Action, Draw, Effects, Fidelity, Furniture, NoiseConfig, Person, Scene, Simulator, Walk, load_scene

OURS = sorted(path.stem for path in (share_dir() / "config" / "scenes").glob("*.yaml"))


def test_ours_are_there():
    wanted = {"demo", "short", "one_user", "two_crossing", "side_by_side", "handshake", "sitting", "five_people", "drawing", "empty_room"}
    assert wanted | {"single_target", "turntable", "two_radars"} <= set(OURS)


@pytest.mark.parametrize("name", OURS)
def test_ours_run(name):
    """Every scene of ours loads, says which effects it wants, and gives frames that pass the check at the door."""
    scene = load_scene(name)
    assert scene.effects.noise is not None
    for radar in scene.radars:
        simulator = Simulator(scene, radar.frame_id)
        assert simulator.n_frames == pytest.approx(scene.duration * 50, abs=2)
        for k in (0, simulator.n_frames // 2, simulator.n_frames - 1):
            result = simulator.process(k)
            result.frame.check(simulator.info)
            assert len(result.truth.person_id) == len(scene.people)


@pytest.mark.parametrize(
    ("place", "heading", "meets"),
    [((4.8, 0.0), 0.0, False), ((4.65, 0.0), 0.0, True), ((4.0, 0.55), 0.0, False), ((4.0, 0.45), 0.0, True), ((4.0, 0.6), 1.57, True)],
)
def test_people_keep_clear_of_furniture(place, heading, meets):
    """A table of 1 m x 0.6 m at (4, 0): nobody stands in it or within 0.2 m of it, however it is turned; over a lamp one can stand."""
    table = Furniture(position=(4.0, 0.0), heading=heading)
    people = (Person(position=place),)
    if meets:
        with pytest.raises(ConfigError, match=r"inside furniture\.0"):
            Scene(people=people, furniture=(table,))
    else:
        Scene(people=people, furniture=(table,))
    Scene(people=people, furniture=(dataclasses.replace(table, base=2.0),))


def test_short_ways_to_name_effects_and_fidelity(tmp_path):
    """`noise:` and `noise: true` are its defaults, `noise: false` is off; `effects: auto`; `fidelity: exact`."""
    path = tmp_path / "mine.yaml"
    for text, wanted in (
        ("effects: {noise: , squint: true, coupling: false}", Effects(noise=NoiseConfig(), squint=True)),
        ("effects: {squint: , noise: {gain: 3}}", Effects(noise=NoiseConfig(gain=3.0), squint=True)),
        ("effects: auto", Effects(auto=True)),
        ("effects:", Effects()),
    ):
        path.write_text(text)
        assert load_scene(path).effects == wanted
    path.write_text("fidelity: exact")
    assert load_scene(path).fidelity == Fidelity(model="exact")


@pytest.mark.parametrize("name", OURS)
def test_scenes_can_be_written_down_again(name):
    """What `simulate` writes beside a recording loads as the same scene."""
    scene = load_scene(name)
    assert load(Scene, plain(scene)) == scene


def test_a_motion_capture_lies_beside_its_scene(tmp_path):
    """A relative path in a scene file is relative to that file."""
    (tmp_path / "mine.yaml").write_text("people:\n  - script:\n      - {play: {file: walk.bvh}}\n")
    play = load_scene(tmp_path / "mine.yaml").people[0].script[0].play
    assert play is not None
    assert play.file == str(tmp_path / "walk.bvh")


@pytest.mark.parametrize(
    ("text", "wanted"),
    [
        ("duration: 5\nduratoin: 6\n", [":2:", "unknown key 'duratoin'", "duration"]),
        ("people:\n  - id: 1\n    hieght: 1.8\n", [":3:", "hieght"]),
        ("duration: ten\n", [":1:", "duration", "'ten'"]),
        ("duration: -5\n", ["duration", "-5", "s"]),
        ("people:\n  - id: 1\n    height: 175\n", ["height", "175", "2.3 m"]),
        ("people:\n  - script:\n      - {gesture: shove}\n", ["gesture", "shove", "push"]),
        ("people:\n  - script:\n      - {walk: {to: [1, 2], spede: 1}}\n", [":3:", "spede"]),
        ("people:\n  - script:\n      - {walk: {speed: 1}}\n", [":3:", "'people.0.script.0.walk.to' is missing"]),
        ("people:\n  - script:\n      - {walk: {to: [1, 2]}, stand: 3}\n", ["walk and stand", "exactly one"]),
        ("people:\n  - script:\n      - {stand: 3, size: 1.1}\n", ["size", "belong to a gesture"]),
        ("people:\n  - {id: 1}\n  - {id: 1}\n", ["ids [1, 1] repeat"]),
        ("points:\n  - {position: [1, 2]}\n", [":2:", "position"]),
        ("points:\n  - {position: [1, 2, .nan]}\n", ["position", "finite"]),
        ("effects:\n  multipth: {}\n", [":2:", "unknown key 'effects.multipth'", "did you mean 'multipath'?", "noise"]),
        ("effects: everything\n", [":1:", "effects"]),
        ("effects: {clutter: {low: [1, 0, 0], high: [1, 2, 2]}}\n", [":1:", "effects.clutter", "not below high"]),
        ("radars:\n  - waveform: {n_sample: 0}\n", [":2:", "radars.0", "n_sample is 0"]),
        ("radars:\n  - frame_id: a/radar\n  - frame_id: a/radar\n", [":3:", "radars.1.frame_id", "'a/radar'", "as that of radar 0"]),
        ("radars:\n  - transmitter: {together: [[0, 0], [0.01, 0]]}\n", [":2:", "waveform.n_tx to 1"]),
        ("radar: {mount: {z: 1}}\n", [":1:", "unknown key 'radar'", "did you mean 'radars'?"]),
        ("fidelity: exat\n", ["fidelity", "did you mean 'exact'?"]),
        ("fidelity: {model: blocks, blocks: 0}\n", ["blocks is 0"]),
        ("people:\n  - script:\n      - {gesture: swipe_lft}\n", [":3:", "did you mean 'swipe_left'?"]),
        ("people:\n  - script:\n      - {gesture: wave, variant: 1}\n", ["wave is performed in one way"]),
        ("walls:\n  - {start: [1, 1], end: [1, 1]}\n", [":2:", "walls.0", "two places"]),
        (
            "people:\n  - position: [2, 0.1]\nwalls:\n  - {start: [1, 0], end: [4, 0]}\n",
            [":2:", "people.0.position", "stands at (2.0, 0.1), inside walls.0", "move one of them"],
        ),
        (
            "people:\n  - script:\n      - {walk: {to: [2.5, 2]}}\nwalls:\n  - {start: [1, 1], end: [4, 1]}\n",
            [":3:", "people.0.script.0.walk.to", "leads through walls.0"],
        ),
        (
            "people:\n  - script: [{walk: {to: [5, 0]}}]\nfurniture:\n  - {position: [4, 0], heading: 0.5}\n",
            [":2:", "leads through furniture.0"],
        ),
        ("duration: [1\n", ["not valid YAML"]),
    ],
)
def test_mistakes_are_named(tmp_path, text, wanted):
    """The message names the file, where there is one the line and the key, and what would be right."""
    path = tmp_path / "mine.yaml"
    path.write_text(text)
    with pytest.raises(ConfigError) as caught:
        load_scene(path)
    for part in ["mine.yaml", *wanted]:
        assert part in str(caught.value)


def test_unknown_scene_lists_ours():
    with pytest.raises(ConfigError, match="demo"):
        load_scene("no_such_scene")


def test_a_script_that_cannot_be_kept_is_refused():
    """A step's `at` is a promise; when the steps before take longer, the error says which step, and when it could be."""
    person = Person(script=(Action(walk=Walk(to=(3.0, 0.5), speed=0.5)), Action(gesture="push", at=1.0)))
    with pytest.raises(ConfigError, match=r"person 1, step 2 .* cannot start at 1 s.* until [\d.]+ s"):
        Simulator(Scene(people=(person,)))


def test_drawing_and_gestures_are_different_things():
    with pytest.raises(ConfigError, match="gesture and draw"):
        Action(gesture="push", draw=Draw())


def doings(simulator: Simulator):
    """What every person does in the middle of every frame, without the echoes."""
    times = np.arange(simulator.n_frames) * 0.02 + simulator.info.waveform.acquisition_time / 2
    return [[timeline.at(t) for t in times] for timeline in simulator.world.timelines]


def test_short_is_as_promised():
    """Push at 2 s and swipe right at 4 s, one person from the start."""
    simulator = Simulator(load_scene("short"))
    (segments,) = doings(simulator)
    starts = [(GESTURES[s.gesture], s.start) for k, s in enumerate(segments) if s and s.gesture is not None and segments[k - 1] is not s]
    assert [name for name, _ in starts] == ["push", "swipe_right"]
    np.testing.assert_allclose([start for _, start in starts], [2.0, 4.0], atol=1e-9)
    truth = simulator.process(100).truth
    assert truth.gesture[0] == GESTURES.index("push")
    assert simulator.process(50).truth.gesture[0] == NO_GESTURE
    assert simulator.process(220).truth.gesture_index[0] == 1


def test_demo_is_as_promised():
    """Two people walk in, gesture at once with about a second or more between two gestures, and the first one rotates and draws."""
    simulator = Simulator(load_scene("demo"))
    for timeline, (x, y) in zip(simulator.world.timelines, ((2.3, -0.75), (2.5, 0.8)), strict=True):
        segments = timeline.segments
        strokes = [s for s in segments if s.kind == "gesture"]
        assert 7 <= len(strokes) <= 8
        assert all(b.start - a.end >= 0.9 for a, b in pairwise(strokes))
        assert 6.0 <= strokes[0].start <= 7.0
        assert strokes[-1].end < 30.0
        np.testing.assert_allclose(timeline.posture(np.array([strokes[0].start])).place[0], (x, y), atol=0.03)  # people sway
        walk = next(s for s in segments if s.kind == "walk")
        assert walk.end < 5.0
        assert (
            np.hypot(*timeline.posture(np.array([walk.start])).place[0]) > simulator.info.waveform.max_range
        )  # walks in: not seen at first
    drawing = [s for s in simulator.world.timelines[0].segments if s.kind == "draw"]
    rotate = next(s for s in simulator.world.timelines[0].segments if s.gesture == GESTURES.index("rotate"))
    assert 19.0 <= rotate.start <= 20.5
    assert 0.4 <= drawing[0].start - rotate.end <= 0.9
    assert 7.0 <= drawing[0].end - drawing[0].start <= 8.0
    assert drawing[0].end < 30.0
