"""Strokes of one's own: files, paths, both hands, truth, and what is refused."""

import numpy as np
import pytest

from radar_core import GESTURES, ConfigError
from radar_core.config import load, plain
from radar_sim import Action, Person, Scene, Simulator, Stroke, load_scene, load_stroke
from radar_sim.motions.script import Timeline

OURS = ("circle", "clap")


def timeline(*script, arm="right", strokes=OURS):
    return Timeline(Person(arm=arm, script=script), 3, (0.0, 0.0), [load_stroke(name) for name in strokes])


@pytest.mark.parametrize("name", OURS)
def test_ours_go_through_their_places(name):
    """At rest at both ends, through every place, never beyond the arm."""
    stroke = load_stroke(name)
    way = stroke.path()
    path = np.array([way(u) for u in np.linspace(0.0, 1.0, 2001)])
    for place in stroke.places:
        assert np.linalg.norm(path - place, axis=1).min() < 2e-3
    np.testing.assert_allclose(path[[0, -1]], [stroke.places[0], stroke.places[-1]], atol=1e-9)
    speed = np.linalg.norm(np.diff(path, axis=0), axis=1) * 2000
    assert max(speed[0], speed[-1]) < 0.01 * speed.max()
    assert np.linalg.norm(path, axis=1).max() <= 0.99


def test_both_hands_clap_and_one_circles():
    """Hands are mirrored to each other from rest to rest while clapping; while circling only the acting one leaves the thigh."""
    line = timeline(Action(gesture="clap"), Action(stand=1.0), Action(gesture="circle"))
    clap, circle = (segment for segment in line.segments if segment.gesture is not None)
    hands = line.posture(np.linspace(0.0, clap.end, 200)).hands
    np.testing.assert_allclose(hands[:, 0], hands[:, 1] * [1.0, -1.0, 1.0], atol=1e-12)
    hands = line.posture(np.linspace(circle.start, circle.end, 50)).hands
    assert np.ptp(hands[:, 0], axis=0).max() < 1e-9
    assert np.ptp(hands[:, 1, 0]) > 0.4


@pytest.mark.parametrize("strokes", [OURS, OURS[::-1]])
def test_truth_names_them_after_the_ten(strokes):
    scene = Scene(duration=6.0, strokes=strokes_of(strokes), people=(Person(script=(Action(gesture="clap"),)),))
    simulator = Simulator(scene)
    (segment,) = (s for s in simulator.world.timelines[0].segments if s.gesture is not None)
    truth = simulator.process(round(0.5 * (segment.start + segment.end) / simulator.interval)).truth
    assert truth.labels == (*GESTURES, *strokes)
    assert truth.labels[truth.gesture[0]] == "clap"


def strokes_of(names):
    return tuple(load_stroke(name) for name in names)


def test_a_file_beside_the_scene_s_and_a_scene_that_holds_them(tmp_path):
    """Scene files name stroke files; what a scene says of itself holds them whole."""
    (tmp_path / "zig.yaml").write_text("name: zig\nplaces: [[0.3, 0, 0], [0.8, 0, 0], [0.3, 0.2, 0]]\n")
    (tmp_path / "scene.yaml").write_text(
        "strokes: [zig.yaml, circle]\npeople:\n  - script:\n      - {gesture: zig}\n      - {gesture: circle}\n"
    )
    scene = load_scene(tmp_path / "scene.yaml")
    assert scene.labels == (*GESTURES, "zig", "circle")
    assert load(Scene, plain(scene)) == scene


def test_without_strokes_a_scene_is_what_it_was():
    """Neither the ten nor how they are performed change by strokes that are not performed."""
    one = Timeline(Person(script=(Action(gesture="push"),)), 3)
    two = timeline(Action(gesture="push"))
    times = np.linspace(0.0, one.end, 50)
    np.testing.assert_array_equal(one.posture(times).hands, two.posture(times).hands)


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ({"name": "push", "places": [[0.3, 0, 0], [0.8, 0, 0]]}, "one of the ten"),
        ({"name": "Big Circle", "places": [[0.3, 0, 0], [0.8, 0, 0]]}, "cannot be the name of a gesture"),
        ({"name": "zig", "places": [[0.3, 0, 0]]}, "too few"),
        ({"name": "zig", "places": [[0.3, 0, 0], [0.9, 0.9, 0]]}, "of the reach away"),
        ({"name": "zig", "places": [[0.3, 0, 0], [0.3, 0, 0]]}, "the same"),
        ({"name": "zig"}, "places"),
    ],
)
def test_strokes_that_make_no_sense(given, words):
    with pytest.raises(ConfigError, match=words):
        load(Stroke, given)


def test_a_gesture_that_nobody_described(tmp_path):
    (tmp_path / "scene.yaml").write_text("strokes: [circle]\npeople:\n  - script:\n      - {gesture: circel}\n")
    with pytest.raises(ConfigError, match=r":4: .*did you mean 'circle'.*strokes"):
        load_scene(tmp_path / "scene.yaml")
    with pytest.raises(ConfigError, match="two have the same name"):
        Scene(strokes=strokes_of(("circle", "circle")))
    with pytest.raises(ConfigError, match="circle, clap"):
        load_stroke("circel")
