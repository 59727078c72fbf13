"""Scene files: ours load and keep their promises; mistakes are named by file, line and key."""

from itertools import pairwise

import numpy as np
import pytest

from radar_core import GESTURES, NO_GESTURE, ConfigError, DataError
from radar_core.paths import share_dir
from radar_sim import Action, Draw, Person, Scene, Simulator, Walk, load_scene

OURS = sorted(path.stem for path in (share_dir() / "config" / "scenes").glob("*.yaml"))


def test_ours_are_there():
    assert {"demo", "one_user", "two_crossing", "single_target", "empty_room", "short"} <= set(OURS)


@pytest.mark.parametrize("name", OURS)
def test_ours_run(name):
    """Every scene of ours loads, says which effects it wants, and gives frames that pass the check at the door."""
    scene = load_scene(name)
    simulator = Simulator(scene)
    assert scene.effects.noise is not None
    assert simulator.n_frames == round(scene.duration * 50)
    for k in (0, simulator.n_frames - 1):
        result = simulator.process(k)
        result.frame.check(simulator.info)
        assert len(result.truth.person_id) == len(scene.people)


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
        ("effects:\n  rain: {}\n", [":2:", "unknown key 'effects.rain'", "noise"]),
        ("radar: {waveform: {n_sample: 0}}\n", ["n_sample is 0"]),
        ("model: quick\n", ["quick", "separable"]),
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


@pytest.mark.parametrize("sequence", [-1, 50, 10**12])
def test_no_frames_beyond_the_scene(sequence):
    with pytest.raises(DataError, match="frames 0 to 49"):
        Simulator(Scene(duration=1.0)).process(sequence)


def test_drawing_and_gestures_are_different_things():
    with pytest.raises(ConfigError, match="gesture and draw"):
        Action(gesture="push", draw=Draw())


def doings(simulator: Simulator):
    """What every person does in the middle of every frame, without the echoes."""
    times = np.arange(simulator.n_frames) * 0.02 + simulator.info.waveform.acquisition_time / 2
    return [[body.timeline.at(t) for t in times] for body in simulator._bodies]


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
    for body, (x, y) in zip(simulator._bodies, ((2.3, -0.75), (2.5, 0.8)), strict=True):
        segments = body.timeline.segments
        strokes = [s for s in segments if s.kind == "gesture"]
        assert 7 <= len(strokes) <= 8
        assert all(b.start - a.end >= 0.9 for a, b in pairwise(strokes))
        assert 6.0 <= strokes[0].start <= 7.0
        assert strokes[-1].end < 30.0
        assert strokes[0].here == (x, y)
        walk = next(s for s in segments if s.kind == "walk")
        assert walk.end < 5.0
        assert np.hypot(*walk.here) > simulator.info.waveform.max_range  # walks in: not seen at first
    drawing = [s for s in simulator._bodies[0].timeline.segments if s.kind == "draw"]
    rotate = next(s for s in simulator._bodies[0].timeline.segments if s.gesture == GESTURES.index("rotate"))
    assert 19.0 <= rotate.start <= 20.5
    assert 0.4 <= drawing[0].start - rotate.end <= 0.9
    assert 7.0 <= drawing[0].end - drawing[0].start <= 8.0
    assert drawing[0].end < 30.0
