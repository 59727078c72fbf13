"""The recogniser against synthetic tracked clouds: what it keeps, what it forgets, and what it calls random."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from radar_core import GESTURES, ConfigError, PointCloud, Pose
from radar_gestures.classifiers.perceptron import GestureModel
from radar_gestures.features import FEATURE_NAMES, MotionSample
from radar_gestures.maps import MapConfig
from radar_gestures.recognizer import GestureRecognizer
from radar_gestures.stage import EventStage, GestureConfig, walked
from radar_tracking.tracks import Track, TrackedCloud, Tracks, TrackStatus

SETTINGS = GestureConfig()
MOUNT = Pose(z=1.2)
PULL, PUSH = GESTURES.index("pull"), GESTURES.index("push")


def sign_model(labels=GESTURES, **knobs):
    """A perceptron written by hand: push when the fastest motion approaches, pull when it recedes."""
    n, k = len(FEATURE_NAMES), len(labels)
    hidden = np.zeros((n, 2))
    hidden[FEATURE_NAMES.index("max_speed"), 0] = 1.0
    hidden[FEATURE_NAMES.index("min_speed"), 1] = -1.0
    output = np.zeros((2, k))
    output[0, labels.index("pull")] = output[1, labels.index("push")] = 10.0
    return GestureModel(np.zeros(n), np.ones(n), (hidden, output), (np.zeros(2), np.zeros(k)), labels=labels, **knobs)


def person(track_id, position=(2.0, 0.0, 1.0), status=TrackStatus.CONFIRMED):
    return Track(track_id, status, 1.0, 0.0, 6, np.array(position), np.zeros(3), np.full(3, 0.2), np.eye(6))


def tracked(stamp_ns, people, speeds, sequence=0):
    """Three body points at rest and three arm points at the given speed, for every person."""
    points = []
    for track, speed in zip(people, speeds, strict=True):
        points += [(track.id, track.position, 0.0, 30.0)] * 3 + [(track.id, track.position, speed, 25.0)] * 3
    owner = np.array([p[0] for p in points], np.int32)
    place = np.array([p[1] for p in points], np.float32).reshape(-1, 3)
    away = place - MOUNT.origin.astype(np.float32)
    f32 = [np.array([p[i] for p in points], np.float32) for i in (2, 3)]
    cloud = PointCloud(
        stamp_ns,
        sequence,
        "room",
        *place.T.copy(),
        range=np.linalg.norm(away, axis=1),
        azimuth=np.arctan2(away[:, 1], away[:, 0]),
        elevation=np.arctan2(away[:, 2], np.hypot(away[:, 0], away[:, 1])),
        radial_speed=f32[0],
        snr=f32[1],
    )
    return TrackedCloud(cloud, Tracks(stamp_ns, sequence, "room", tuple(people), owner))


def run(recognizer, speed_of, people_of=lambda t: [person(1)], end=4.0, dt=0.02):
    found = []
    for i in range(round(end / dt)):
        t = i * dt
        people = people_of(t)
        found += recognizer.process(tracked(round(t * 1e9), people, [speed_of(t, p.id) for p in people], i))
    return found


def burst(start, end, value):
    return lambda t, _: value if start <= t < end else 0.0


def test_one_push_is_one_gesture_with_its_time():
    (gesture,) = run(GestureRecognizer(SETTINGS, sign_model(), MOUNT), burst(1.0, 1.5, -2.0))
    assert (gesture.label, gesture.name, gesture.track_id, gesture.frame_id) == (PUSH, "push", 1, "room")
    # One frame of 20 ms: the limits are the first and last stamp above the threshold, the decision comes 0.25 s of rest later.
    assert gesture.start_ns == pytest.approx(1.0e9, abs=20e6)
    assert gesture.end_ns == pytest.approx(1.5e9, abs=21e6)
    assert gesture.stamp_ns == pytest.approx(1.75e9, abs=21e6)
    assert gesture.latency == pytest.approx((gesture.stamp_ns - gesture.end_ns) * 1e-9)
    assert gesture.latency == pytest.approx(0.26, abs=0.011)  # the first cloud at least 0.25 s after the last fast one
    assert gesture.known
    assert gesture.probabilities.sum() == pytest.approx(1.0)
    assert gesture.confidence == gesture.probabilities[PUSH]
    assert gesture.features[FEATURE_NAMES.index("min_speed")] == pytest.approx(-2.0)


def test_two_people_at_once_keep_their_own_gestures():
    """Section 7.2: what tracking separates, gestures must not mix."""
    people = [person(1), person(2, (2.0, 1.5, 1.0))]
    found = run(
        GestureRecognizer(SETTINGS, sign_model(), MOUNT),
        lambda t, who: burst(1.0, 1.5, -2.0 if who == 1 else 2.0)(t, who),
        lambda t: people,
    )
    assert {g.track_id: g.name for g in found} == {1: "push", 2: "pull"}


def test_a_track_that_is_gone_is_forgotten():
    recognizer = GestureRecognizer(SETTINGS, sign_model(), MOUNT)
    run(recognizer, burst(0.5, 1.0, 2.0), lambda t: [person(1), person(2, (2.0, 1.5, 1.0))] if t < 0.7 else [person(1)], end=1.0)
    assert recognizer.track_ids == (1,)


def test_a_tentative_track_gives_no_gesture():
    people = [person(1, status=TrackStatus.TENTATIVE)]
    assert run(GestureRecognizer(SETTINGS, sign_model(), MOUNT), burst(1.0, 1.5, 2.0), lambda t: people) == []


def test_a_walking_person_gives_only_random():
    """Walking at 1 m/s: legs move faster than the threshold without a rest, the track moves by more than walk_distance."""
    found = run(GestureRecognizer(SETTINGS, sign_model(), MOUNT), burst(0.5, 3.0, 1.5), lambda t: [person(1, (1.0 + t, 0.0, 1.0))])
    assert [g.name for g in found] == ["random"]
    quiet = GestureRecognizer(GestureConfig(publish_random=False), sign_model(), MOUNT)
    assert run(quiet, burst(0.5, 3.0, 1.5), lambda t: [person(1, (1.0 + t, 0.0, 1.0))]) == []


def stepping(t, moved, start=1.5, duration=0.5):
    """Somebody 2 m away who comes nearer by ``moved`` [m] from ``start`` on [s]."""
    return [person(1, (2.0 - moved * float(np.clip((t - start) / duration, 0.0, 1.0)), 0.0, 1.0))]


def test_the_longest_event_still_knows_where_it_began():
    """A body that has come 0.65 m in the 0.7 s before its legs were fast: the memory reaches back to where it stood before."""
    longest = SETTINGS.events.max_duration
    recognizer = GestureRecognizer(SETTINGS, sign_model(), MOUNT)
    found = run(recognizer, burst(1.5, 1.7 + longest, -2.0), lambda t: stepping(t, 0.65, start=0.8, duration=0.7))
    assert [gesture.name for gesture in found] == ["random"]


@pytest.mark.parametrize(("moved", "temperature", "name"), [(0.4, 1.0, "push"), (0.4, 20.0, "random"), (0.2, 20.0, "push")])
def test_a_step_that_looks_a_little_like_a_push_is_unknown(moved, temperature, name):
    """Somebody who stands 0.4 m elsewhere afterwards has made a step, unless it is a push beyond doubt; 0.2 m is an arm that pulls."""
    recognizer = GestureRecognizer(SETTINGS, sign_model(temperature=temperature), MOUNT)
    (found,) = run(recognizer, burst(1.5, 2.0, -2.0), lambda t: stepping(t, moved))
    assert (found.name, found.known) == (name, name == "push")


def test_a_step_does_not_hide_another_gesture():
    """Only pushes and pulls look like a step."""
    labels = tuple("rotate" if name == "push" else "push" if name == "rotate" else name for name in GESTURES)
    model = sign_model(temperature=20.0)
    other = GestureModel(model.mean, model.scale, model.weights, model.biases, labels=labels, temperature=20.0)
    (found,) = run(GestureRecognizer(SETTINGS, other, MOUNT), burst(1.5, 2.0, -2.0), lambda t: stepping(t, 0.4))
    assert (found.name, found.known) == ("rotate", True)


def test_a_young_track_has_walked_too():
    """One that began 0.1 s before its event has no place from before it set off; the first that it has is taken instead."""
    found = run(GestureRecognizer(SETTINGS, sign_model(), MOUNT), burst(0.1, 1.2, 1.5), lambda t: [person(1, (1.0 + t, 0.0, 1.0))])
    assert [g.name for g in found] == ["random"]


def test_an_unknown_gesture_is_random():
    """Even probabilities, 0.1 each, are below the model's own limit, or below ``min_confidence``; without either the first label wins."""
    flat = {"temperature": 1e6}
    for settings, reject in ((SETTINGS, 0.4), (GestureConfig(min_confidence=0.4), 0.0)):
        (gesture,) = run(GestureRecognizer(settings, sign_model(reject=reject, **flat), MOUNT), burst(1.0, 1.5, -2.0))
        assert (gesture.name, gesture.known) == ("random", False)
        assert gesture.confidence == pytest.approx(0.1, abs=0.02)
    (gesture,) = run(GestureRecognizer(SETTINGS, sign_model(**flat), MOUNT), burst(1.0, 1.5, -2.0))
    assert (gesture.name, gesture.known) == ("push", True)


def test_a_movement_that_the_model_calls_random_is_known():
    """Random movements are a label of their own; only what the model does not know at all is not known."""
    model = sign_model()
    calm = GestureModel(model.mean, model.scale, model.weights, (model.biases[0], 100.0 * np.eye(10)[0]), reject=0.4)
    (gesture,) = run(GestureRecognizer(SETTINGS, calm, MOUNT), burst(1.0, 1.5, -2.0))
    assert (gesture.name, gesture.known, gesture.confidence) == ("random", True, pytest.approx(1.0))


def test_a_model_of_fewer_gestures_in_another_order():
    """Seven classes, say (section 5.3): probabilities come in the order of `GESTURES` all the same, 0 for those that it does not know."""
    recognizer = GestureRecognizer(SETTINGS, sign_model(("push", "wave", "pull")), MOUNT)
    (gesture,) = run(recognizer, burst(1.0, 1.5, -2.0))
    assert (gesture.label, gesture.name) == (PUSH, "push")
    assert np.flatnonzero(gesture.probabilities).tolist() == sorted([PULL, PUSH, GESTURES.index("wave")])


def test_a_gesture_of_one_s_own_follows_the_ten():
    """The ten keep their numbers; probabilities have one more."""
    recognizer = GestureRecognizer(
        SETTINGS, dataclasses.replace(sign_model(("push", "wave", "pull")), labels=("knock", "wave", "pull")), MOUNT
    )
    assert recognizer.labels == (*GESTURES, "knock")
    (gesture,) = run(recognizer, burst(1.0, 1.5, -2.0))
    assert (gesture.label, gesture.name, gesture.labels) == (10, "knock", recognizer.labels)
    assert np.flatnonzero(gesture.probabilities).tolist() == [PULL, GESTURES.index("wave"), 10]


def test_a_model_of_other_features_or_with_strange_names_is_refused():
    with pytest.raises(ConfigError, match="'a knock' cannot be the name of a gesture"):
        GestureRecognizer(SETTINGS, dataclasses.replace(sign_model(("push", "pull", "wave")), labels=("push", "pull", "a knock")), MOUNT)
    model = sign_model()
    other = GestureModel(model.mean, model.scale, model.weights, model.biases, names=tuple(f"curve_{i}" for i in range(13)))
    with pytest.raises(ConfigError, match="takes other features"):
        GestureRecognizer(SETTINGS, other, MOUNT)


def test_events_carry_their_maps():
    """From ``margin`` before to ``margin`` after: the fast gate is lit during the burst only, that of the body at rest all the time."""
    recognizer, events = GestureRecognizer(SETTINGS, sign_model(), MOUNT), []
    for i in range(120):
        events += recognizer.find(tracked(i * 20_000_000, [person(1)], [burst(1.0, 1.5, -2.0)(i * 0.02, 1)], i))
    ((maps, start, end),) = [(e.maps, e.event.start_ns, e.event.end_ns) for e in events]
    assert maps.stamp_ns[0] == start - 100_000_000
    assert maps.stamp_ns[-1] == end + 100_000_000
    fast = np.flatnonzero(np.abs(maps.speed + 2.0) < 0.5 * SETTINGS.features.gate)
    lit = maps.micro_doppler[:, fast].ravel()
    np.testing.assert_array_equal(lit, np.where((maps.stamp_ns >= start) & (maps.stamp_ns <= end), 25.0, 0.0))
    still = maps.speed == 0.0
    np.testing.assert_array_equal(maps.micro_doppler[:, still], 30.0)
    # The person stands 2 m ahead, their middle 0.2 m below the sensor.
    np.testing.assert_allclose(maps.distance[:, still], np.hypot(2.0, 0.2), rtol=1e-6)
    np.testing.assert_allclose(maps.elevation[:, still], np.arctan2(-0.2, 2.0), rtol=1e-6)


def test_maps_of_a_fixed_length_by_settings():
    """The thesis's 50 frames (section 4.2); the features do not change."""
    stages = [EventStage(settings, MOUNT) for settings in (SETTINGS, GestureConfig(maps=MapConfig(length=1.0)))]
    found = [[], []]
    for i in range(120):
        item = tracked(i * 20_000_000, [person(1)], [burst(1.0, 1.5, -2.0)(i * 0.02, 1)], i)
        for stage, events in zip(stages, found, strict=True):
            events += stage.process(item)
    (plain,), (long,) = found
    assert long.maps.micro_doppler.shape == (50, 65)
    np.testing.assert_array_equal(long.features, plain.features)
    n = len(plain.maps.stamp_ns)
    np.testing.assert_array_equal(long.maps.micro_doppler[:n], plain.maps.micro_doppler)
    assert not long.maps.micro_doppler[n:].any()


def test_an_event_seen_in_too_few_frames_is_random_without_features():
    found = run(GestureRecognizer(SETTINGS, sign_model(), MOUNT), burst(1.0, 1.5, -2.0), dt=0.24)
    assert [g.name for g in found] == ["random"]
    assert np.isnan(found[0].features).all()
    assert not found[0].known


def test_lost_frames_do_not_change_the_gesture():
    rng = np.random.default_rng(1)
    recognizer, speed, found = GestureRecognizer(SETTINGS, sign_model(), MOUNT), burst(1.0, 1.6, -2.0), []
    for i in range(150):
        if rng.random() > 0.3:
            found += recognizer.process(tracked(i * 20_000_000, [person(1)], [speed(i * 0.02, 1)], i))
    assert [g.name for g in found] == ["push"]


def test_the_same_clouds_give_the_same_gestures():
    a, b = (run(GestureRecognizer(SETTINGS, sign_model(), MOUNT), burst(1.0, 1.5, -2.0)) for _ in range(2))
    np.testing.assert_array_equal(a[0].features, b[0].features)


def test_a_model_trained_with_other_settings_is_refused():
    model = sign_model()
    settings = {"margin": 0.3, "events": {"threshold": 0.8}}
    other = GestureModel(model.mean, model.scale, model.weights, model.biases, settings=settings)
    with pytest.raises(ConfigError, match=r"margin = 0\.3 \(now 0\.1\)"):
        GestureRecognizer(SETTINGS, other, MOUNT)


def motion(t, distance):
    """One motion sample at t [s] of a body straight ahead, its azimuth 0.3 rad."""
    return MotionSample(round(t * 1e9), 1.0, 1.0, 2.0, 0.0, 0.0, (distance, 0.3, 0.0))


def test_walked_is_from_where_the_track_was_to_where_it_is():
    """What an arm does to the track meanwhile is not asked for, and single outliers do not count; who walked 0.8 m did."""
    before = [motion(0.02 * k, 9.0 if k == 7 else 2.0) for k in range(20)]
    after = [motion(1.0 + 0.02 * k, 9.0 if k == 3 else 2.8) for k in range(10)]
    assert walked(before, after) == pytest.approx(0.8, abs=1e-9)
    assert walked(before, before) == 0.0


def test_walked_is_zero_when_it_is_unknown():
    """No samples before or after, or a track that has no place."""
    here = [motion(0.0, 2.0)]
    assert walked([], here) == walked(here, []) == 0.0
    assert walked(here, [motion(1.0, np.nan)]) == 0.0
