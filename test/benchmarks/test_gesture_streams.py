"""Streams and crowds hold what they say, and a simulated one is found."""

from __future__ import annotations

import dataclasses
import math
from itertools import pairwise

import numpy as np
import pytest

from benchmarks import gesture_crowds, gesture_scenes, gesture_streams
from benchmarks.gesture_causes import judge
from benchmarks.gesture_clouds import StreamStore, follow
from benchmarks.gesture_scenes import CROWDS, IDLE, TOGETHER, Crowd, crowd_scene, fitted, gesture_stream, idle_stream, scene_of, unknown
from benchmarks.gesture_streams import Plan, gesture_figures
from benchmarks.stores import code_of
from radar_core import GESTURES
from radar_dsp import Baseband, BasebandConfig
from radar_gestures.classifiers.model import load_model
from radar_sim import Action, Person, Simulator
from radar_sim.motions.script import Timeline

PUSH = GESTURES.index("push")


def segments(scene, number=0):
    person = scene.people[number]
    mount = scene.radars[0].mount
    return Timeline(person, scene.seed, (mount.x, mount.y)).segments


def strokes(scene, number=0):
    return [(GESTURES[s.gesture], s.start, s.end) for s in segments(scene, number) if s.gesture is not None and s.start < scene.duration]


# Scenes


def test_gesture_streams_do_all_gestures_evenly_and_none_is_cut():
    """Ten strokes a round in random order, pauses of 1 s and more between them, all over before the scene is; the seed decides."""
    scene = gesture_stream(3, 120.0)
    done = strokes(scene)
    names = [name for name, _, _ in done]
    assert len(names) >= 12  # a stroke, its pause and bringing the hand there take 6 s at most on average
    counts = [names.count(name) for name in GESTURES]
    assert max(counts) - min(counts) <= 1
    assert all(end <= scene.duration for _, _, end in done)
    assert all(start - end >= 1.0 for (_, _, end), (_, start, _) in pairwise(done))
    assert gesture_stream(3, 120.0) == scene
    assert gesture_stream(4, 120.0) != scene


def test_unknown_streams_hold_no_known_stroke():
    """Every stroke is tilted by 39 degrees or more, except for an eight, which is drawn."""
    script = gesture_stream(0, 60.0, unknown).people[0].script
    assert all(abs(action.tilt) > 0.68 for action in script if action.gesture is not None)
    assert all(action.draw.shape == "eight" for action in script if action.draw is not None)


@pytest.mark.parametrize("kind", IDLE)
def test_idle_streams_hold_no_gesture(kind):
    """One, two and three people by the seed, who do something all the time, but gesture never."""
    for seed in range(3):
        scene = idle_stream(kind, seed, 30.0)
        assert len(scene.people) == 1 + seed
        assert not any(strokes(scene, number) for number in range(len(scene.people)))
        assert all(segments(scene, number)[-1].end >= scene.duration for number in range(len(scene.people)))


@pytest.mark.parametrize("crowd", CROWDS, ids=lambda crowd: crowd.name)
def test_crowds_gesture_together_and_differently(crowd):
    """Neighbours are as far apart as said; who gestures in a round starts within 0.3 s; a bystander does nothing."""
    scene = crowd_scene(crowd, 1, rounds=3)
    places = np.array([person.position for person in scene.people])
    gaps = np.hypot(*np.diff(places, axis=0).T)
    assert len(places) == crowd.users + crowd.bystander
    assert ((gaps >= crowd.apart[0]) & (gaps <= crowd.apart[1])).all()
    done = [strokes(scene, number) for number in range(len(places))]
    users = [own for own in done if own]
    assert len(users) == crowd.users
    for turn in zip(*users, strict=True):
        starts = [start for _, start, _ in turn]
        assert max(starts) - min(starts) <= TOGETHER
        assert len({name for name, _, _ in turn}) == crowd.users
    named = {name for own in users for name, _, _ in own}
    assert named <= set(crowd.gestures)
    assert ("swipe_left" in crowd.gestures) == (crowd.apart[0] >= 1.2)


def test_scripts_fill_the_time():
    """Steps are added until a script is long enough; what would not be over in time is not begun."""
    person = Person(script=(Action(stand=1.0),))
    made = fitted(person, 20.0, 5, lambda: [Action(gesture="push"), Action(stand=1.5)], (0.0, 0.0))
    timeline = Timeline(made, 5)
    gestures = [s for s in timeline.segments if s.gesture is not None]
    assert timeline.end > 20.0
    assert gestures[-1].end <= 20.0
    longer = dataclasses.replace(person, script=(*made.script[:-1], Action(gesture="push"), Action(stand=1.5)))
    assert Timeline(longer, 5).end > 20.0


# Clouds on disk


def test_words_about_code_do_not_change_its_digest():
    code = '"""Say one."""\ndef f(x):  # one\n    """Two."""\n    return x + 1\n'
    assert code_of(code) == code_of('"""Say other."""\n\n\ndef f( x ):\n    return x + 1\n')
    assert code_of(code) != code_of(code.replace("x + 1", "x + 2"))


def small_scene():
    """One push of somebody 2.2 m away."""
    person = Person(position=(2.2, 0.1), script=(Action(stand=1.0), Action(gesture="push", at=2.7)))
    rng = np.random.default_rng(2)
    return dataclasses.replace(scene_of(rng, [person], 9.0, [lambda: [Action(stand=5.0)]]), duration=3.9)


@pytest.fixture(scope="module")
def filled(tmp_path_factory):
    """A store with the small scene."""
    store, scene = StreamStore(tmp_path_factory.mktemp("clouds")), small_scene()
    assert store.fill([scene], progress=False) > 0
    return store, scene


@pytest.mark.long
def test_stored_clouds_are_those_of_the_simulator(filled):
    """Every frame is there once; points and truth are what simulator and baseband give, and nothing is simulated twice."""
    store, scene = filled
    moments = list(store.moments(scene))
    simulator = Simulator(scene)
    assert [m.cloud.sequence for m in moments] == list(range(simulator.n_frames))
    made = simulator.process(145)
    cloud = Baseband(BasebandConfig(), simulator.info).process(made.frame).to_room(simulator.info.mount)
    stored = moments[145]
    assert stored.cloud.stamp_ns == cloud.stamp_ns == stored.truth.stamp_ns == made.truth.stamp_ns
    for name in ("x", "y", "z", "range", "radial_speed", "snr", "azimuth", "elevation"):
        np.testing.assert_array_equal(getattr(stored.cloud, name), getattr(cloud, name))
    assert made.truth.gesture[0] == stored.truth.gesture[0] == PUSH
    np.testing.assert_allclose(stored.truth.hand_velocity, made.truth.hand_velocity, rtol=1e-6, atol=1e-9)  # kept as float32
    assert math.isnan(store.fill([scene], progress=False))


@pytest.mark.long
def test_a_simulated_push_is_found(filled):
    """The real chain finds the one gesture: its event overlaps the true fast time, and errors are below the 0.25 s that end an event."""
    store, scene = filled
    run = follow(store, scene, load_model())
    judged = judge(run)
    (outcome,) = judged.outcomes
    assert outcome.true.label == PUSH
    assert outcome.found is not None
    assert outcome.found.person_id == scene.people[0].id
    figures = gesture_figures([judged])
    assert figures["gestures"] == 1
    assert figures["start_error_s"] < 0.25
    assert figures["end_error_s"] < 0.25
    assert len(run.times_ms) == len(run.truths) == len(run.tracked) == 195  # 3.9 s at 50 Hz


@pytest.mark.long
def test_whose_a_gesture_is_can_be_asked_by_the_first_definition(filled):
    """One person alone is both on whom the track was and who is nearest; in an empty room nobody is."""
    store, scene = filled
    by = {association: follow(store, scene, load_model(), association=association) for association in ("matching", "nearest")}
    assert [f.person_id for f in by["matching"].found] == [f.person_id for f in by["nearest"].found] == [scene.people[0].id]
    assert by["matching"].matching.ghost_track_frames == 0


# Whole benchmarks, on next to nothing


@pytest.mark.long
def test_streams_without_a_gesture_have_no_recall(tmp_path):
    """Half a second of each kind: whatever has nothing to divide by is None, and all the rest is there."""
    result = gesture_streams.measure(Plan(seeds=1, idle=("standing",), idle_seeds=1, duration=0.5), tmp_path, load_model(), progress=False)
    assert result["event_recall"] is None
    assert result["unknown_rejected"] is None
    assert result["false_per_hour"] == 0.0
    assert result["seconds_per_minute_of_stream"] > 0
    assert result["choices"][0]["time_ms"]["median"] > 0
    assert len(result["choices"]) == 1  # nothing to name again


@pytest.mark.long
def test_crowds_measure(tmp_path, monkeypatch):
    """Two users for one round, through the real chain: every gesture is counted once."""
    pair = Crowd(2, (1.2, 2.0), bystander=False)
    monkeypatch.setattr(gesture_scenes, "LEAD", 2.5)
    monkeypatch.setattr(gesture_scenes, "ROUND", 2.2)
    result = gesture_crowds.measure(gesture_crowds.Plan(seeds=1, rounds=1, crowds=(pair,)), tmp_path, progress=False)
    row = result["crowds"][pair.name]
    assert row["performed"] == 2
    assert row["wrong"] + row["missed"] + 2 * row["accuracy"] == pytest.approx(2)
    assert result["two_users_accuracy"] == row["accuracy"]
    assert result["features_two_users_accuracy"] is not None
    assert result["three_users_accuracy"] is result["cross_talk_with_bystander"] is None


@pytest.mark.long
def test_both_basebands_are_timed_on_the_same_frames():
    """Three frames each after the ten that compile; no time is asserted beyond being one."""
    for baseband in gesture_crowds.BASEBANDS.values():
        times = gesture_crowds.frame_times(baseband, 13)
        assert len(times) == 3
        assert min(times) > 0
