"""The benchmarks of streams and crowds count what they say: by runs that the test made by hand."""

from __future__ import annotations

import dataclasses
import math
from types import SimpleNamespace

import numpy as np
import pytest

from benchmarks import gesture_causes, gesture_streams
from benchmarks.gesture_causes import Judged, Outcome, Surplus, count, is_crossed, judge, why_random
from benchmarks.gesture_clouds import Found, Run
from benchmarks.gesture_scenes import scene_of
from benchmarks.gesture_streams import gesture_figures, idle_figures, rejection
from benchmarks.report import Tally, rate_interval, share_interval
from radar_core import GESTURES, NO_GESTURE, PointCloud
from radar_gestures.classifiers.perceptron import GestureModel
from radar_gestures.events import Event
from radar_gestures.gesture import Gesture
from radar_gestures.stage import SensorView, TrackEvent
from radar_lab.evaluation.matching import Matching
from radar_lab.evaluation.scoring import RecognisedGesture, TruthSegment
from radar_lab.evaluation.truth_events import TrueEvent
from radar_sim import Action, Person, Truth
from radar_tracking import Track, TrackedCloud, Tracks, TrackStatus

S = 1_000_000_000
STEP = 20_000_000
PUSH, PULL, WAVE = (GESTURES.index(name) for name in ("push", "pull", "wave"))


def gesture(label, start, end, track_id=1, probability=0.9):
    probabilities = np.full(len(GESTURES), (1 - probability) / (len(GESTURES) - 1))
    probabilities[label] = probability
    start_ns, end_ns = round(start * S), round(end * S)
    return Gesture(end_ns + S // 4, "room", track_id, label, GESTURES[label], probability, probabilities, start_ns, end_ns, np.zeros(13))


def found(label, start, end, person=1, probability=0.9, walked=0.0):
    named = gesture(label, start, end, probability=probability)
    return Found(person, named, TrackEvent(1, Event(named.start_ns, named.end_ns), walked, (SensorView("", named.features),)))


def hand_made(strokes, events, *, tracked=True, fast=True, owned=True, snr=30.0, duration=6.0):
    """A run of one person at (2, 0), whose hand is fast during strokes (label, start, end)."""
    scene = scene_of(np.random.default_rng(1), [Person(position=(2.0, 0.0))], duration, [lambda: [Action(stand=10.0)]])
    clouds, truths = [], []
    for k in range(round(duration * S / STEP)):
        now = [(i, label) for i, (label, start, end) in enumerate(strokes) if start <= k * STEP / S <= end]
        number, label = now[0] if now else (0, NO_GESTURE)
        speed = 1.5 if now else 0.0
        body, hand, motion = np.array([[2.0, 0.0, 1.0]]), np.array([[1.6, 0.0, 1.2]]), np.array([[speed, 0.0, 0.0]])
        who, no = np.array([1], np.uint32), np.zeros(1, bool)
        gestures, index = np.array([label], np.uint8), np.array([number], np.uint32)
        truths.append(Truth(k * STEP, k, "room", who, body, 0 * body, hand, motion, gestures, index, no, no))
        x, y, z = (np.full(1, value, np.float32) for value in hand[0])
        points = PointCloud(
            k * STEP, k, "room", x, y, z, range=x, azimuth=y, elevation=y, radial_speed=np.full(1, speed if fast else 0.3, np.float32),
            snr=np.full(1, snr, np.float32),
        )  # fmt: skip
        track = Track(7, TrackStatus.CONFIRMED, 1.0, 0.0, 1, body[0], np.zeros(3), np.zeros(3), np.eye(6))
        owner = np.array([7 if owned else -1], np.int32)
        clouds.append(TrackedCloud(points, Tracks(k * STEP, k, "room", (track,) if tracked else (), owner)))
    matching = Matching()
    for tracked_cloud, now in zip(clouds, truths, strict=True):
        matching.process(tracked_cloud.tracks, now, np.ones(1, bool))
    return Run(scene, clouds, truths, events, [0.1] * len(clouds), matching)


ONE = [(PUSH, 1.0, 1.6)]


def test_matching_by_overlap():
    """Each gesture gets the event that overlaps it most, each event one gesture; the rest is surplus, false when it has a name."""
    events = [found(PUSH, 0.9, 1.1), found(PULL, 1.1, 1.7), found(0, 3.0, 3.5), found(WAVE, 4.0, 4.5), found(PUSH, 1.0, 1.6, person=2)]
    judged = judge(hand_made(ONE, events[:4]))
    (outcome,) = judged.outcomes
    assert outcome.found is events[1]
    assert [(s.found, s.false) for s in judged.surplus] == [(events[0], True), (events[2], False), (events[3], True)]
    assert judged.hours == pytest.approx(6 / 3600)
    assert judge(hand_made(ONE, [found(PUSH, 1.7, 2.0)])).outcomes[0].found is None  # touches the stroke nowhere


@pytest.mark.parametrize(
    ("why", "changes"),
    [
        ("person has no track", {"tracked": False}),
        ("hand gives no fast points", {"fast": False}),
        ("fast points are not the person's", {"owned": False}),
        ("fast points are left out as weak", {"snr": 3.0}),
        ("too short, or with breaks", {}),
    ],
)
def test_causes_of_missed_gestures(why, changes):
    """What was lost first on the way from hand to event is the cause."""
    (outcome,) = judge(hand_made(ONE, [], **changes)).outcomes
    assert (outcome.found, outcome.cause) == (None, why)


def test_causes_in_the_detector():
    """Two gestures in one event; and one too soon after the event before."""
    both = hand_made([(PUSH, 1.0, 1.6), (PULL, 1.8, 2.3)], [found(PUSH, 1.0, 2.3)])
    assert [o.cause for o in judge(both).outcomes] == ["", "one event with another gesture"]
    soon = hand_made([(PUSH, 1.0, 1.6), (PULL, 1.8, 2.3)], [found(PUSH, 1.0, 1.6)])
    assert [o.cause for o in judge(soon).outcomes] == ["", "too soon after another event"]


def test_why_events_are_random():
    """No features, somebody who walks, the classifier, and a rejected gesture; a name needs no reason."""
    walks = dataclasses.replace(gesture(0, 1.0, 1.5), probabilities=np.eye(len(GESTURES))[0])
    assert why_random(walks) == "track moved, as if walking"
    assert why_random(dataclasses.replace(walks, features=np.full(13, np.nan))) == "too few moving samples"
    assert why_random(gesture(0, 1.0, 1.5)) == "most probably random"
    assert why_random(dataclasses.replace(gesture(PUSH, 1.0, 1.5), label=0)) == "rejected as unknown"
    assert why_random(gesture(PUSH, 1.0, 1.5)) == ""


def true(label, start, end, *, meets=True, person=1):
    a, b = round(start * S), round(end * S)
    return TrueEvent(person, label, a, b, a, b, (b - a) / S, (b - a) / S, 1.5, meets)


def test_figures_of_streams():
    """Recall over gestures that meet the criterion, errors with and without their signs, false ones per hour."""
    judged = Judged(
        [
            Outcome(true(PUSH, 1.0, 1.5), found(PUSH, 1.1, 1.7)),
            Outcome(true(PULL, 3.0, 3.5), found(WAVE, 2.9, 3.6)),
            Outcome(true(WAVE, 5.0, 6.0), None, "too short, or with breaks"),
            Outcome(true(WAVE, 8.0, 9.0, meets=False), None, "hand gives no fast points"),
            Outcome(true(0, 10.0, 11.0), found(PUSH, 10.0, 11.0)),
        ],
        [Surplus(found(PUSH, 20.0, 21.0), "walk"), Surplus(found(0, 30.0, 31.0), "walk")],
        0.5,
    )
    figures = gesture_figures([judged])
    assert (figures["gestures"], figures["gestures_that_meet"]) == (4, 3)
    assert figures["event_recall"] == pytest.approx(2 / 3)
    assert figures["event_recall_others"] == 0.0
    assert figures["recognised"] == pytest.approx(1 / 3)
    assert figures["recognised_all"] == pytest.approx(1 / 4)
    assert figures["start_error_s"] == pytest.approx(0.1)
    assert figures["start_bias_s"] == pytest.approx(0.0, abs=1e-9)
    assert figures["end_error_s"] == pytest.approx(0.15)
    assert figures["end_bias_s"] == pytest.approx(0.15)
    assert figures["random_strokes_named"] == 1.0
    assert figures["false_per_hour_between_gestures"] == pytest.approx(2.0)
    idle = idle_figures({"walking": [dataclasses.replace(judged, outcomes=[])]})
    assert (idle["false_per_hour"], idle["idle_events_per_hour"], idle["idle_hours"]) == (2.0, 4.0, 0.5)
    assert idle["false_by_cause"] == {"push (walk)": 1}
    assert gesture_streams.gesture_tables([judged])["missed"] == {"too short, or with breaks": 1}


def test_events_named_again_by_other_rules():
    """Somebody who stands half a metre elsewhere is random by a rule of 0.3 m, and whatever the model says by the default one."""
    near, far = found(PUSH, 1.0, 1.5), found(PUSH, 3.0, 3.5, walked=0.5)
    judged = Judged([Outcome(true(PUSH, 1.0, 1.5), near)], [Surplus(far, "walk")], 0.1)
    seen = {}

    def figures(again):
        (one,) = again
        seen[len(seen)] = (one.outcomes[0].found.gesture, one.surplus[0].found.gesture)
        return "!", 1.0

    rows = gesture_causes.rows_of_rules("rules", "gestures", [judged], sure_of_push(), figures)
    names = list(gesture_causes.rules())
    assert [row["choice"] for row in rows] == [f"{name}!" for name in names]
    for k, name in enumerate(names):
        still, moved = seen[k]
        assert (still.name, still.start_ns, still.end_ns) == ("push", near.gesture.start_ns, near.gesture.end_ns)
        assert moved.name == ("random" if name in ("walk_distance=0.3", "walk_distance=0.45") else "push"), name


def sure_of_push():
    """A model that calls everything a push, beyond doubt."""
    return GestureModel(np.zeros(13), np.ones(13), (np.zeros((13, 10)),), (100.0 * np.eye(10)[PUSH],))


def test_rejection_at_five_percent_loss():
    """The limit is the probability that a twentieth of the known gestures does not reach; unknown ones below it are rejected."""
    model = SimpleNamespace(labels=GESTURES, score=lambda features, probabilities: probabilities.max(axis=-1))
    chances = np.linspace(0.5, 0.9, 101)
    known = Judged([Outcome(true(PUSH, 0, 1), found(PUSH, 0, 1, probability=p)) for p in chances], [], 1.0)
    strange = Judged(
        [Outcome(true(WAVE, 0, 1), found(PUSH, 0, 1, probability=p)) for p in (0.45, 0.51, 0.53, 0.8)],
        [Surplus(found(0, 2, 3, probability=0.99), "draw")],
        1.0,
    )
    figures = rejection(model, [known], [strange])
    assert figures["unknown_limit"] == pytest.approx(0.52)
    assert figures["unknown_rejected"] == pytest.approx(3 / 5)
    assert figures["unknown_rejected_as_shipped"] == pytest.approx(1 / 5)
    assert rejection(model, [], [strange])["unknown_rejected"] is None


def test_crowds_count_by_person():
    """Right, wrong, missed, credited to a bystander, and credited to nobody, each once."""
    segments = [
        TruthSegment(1, PUSH, 1 * S, 2 * S),
        TruthSegment(2, PULL, 1 * S, 2 * S),
        TruthSegment(1, WAVE, 6 * S, 7 * S),
        TruthSegment(2, PUSH, 6 * S, 7 * S),
    ]
    outcomes = [
        Outcome(true(PUSH, 1, 2), found(PUSH, 1, 2)),
        Outcome(true(PULL, 1, 2, person=2), found(WAVE, 1, 2, person=2)),
        Outcome(true(WAVE, 6, 7), None),
        Outcome(true(PUSH, 6, 7, person=2), found(PUSH, 6, 7, person=2)),
    ]
    extra = [found(WAVE, 6, 7, person=3), found(0, 6, 7, person=3), found(PUSH, 1, 2, person=None), found(PUSH, 30, 31, person=3)]
    surplus = [Surplus(f, "stand") for f in extra]
    counts = count(Judged(outcomes, surplus, 0.5, track_frames=1000, ghost_track_frames=60))
    assert counts == Tally(
        minutes=30, performed=4, right=2, wrong=1, missed=1, false_gestures=3, ghost_gestures=1, crossed=1, track_frames=1000,
        ghost_track_frames=60,
    )  # fmt: skip
    figures = (counts + counts).figures()
    assert (figures["accuracy"], figures["performed"]) == (pytest.approx(0.5), 8)
    assert figures["false_gestures_per_minute"] == pytest.approx(0.1)
    assert (figures["ghost_track_frames_per_minute"], figures["ghost_share_of_track_frames"]) == pytest.approx((2.0, 0.06))
    assert counts.figures()["cross_talk"] == pytest.approx(0.25)
    assert not is_crossed(RecognisedGesture(1, PUSH, 1 * S, 2 * S), segments)
    assert not is_crossed(RecognisedGesture(None, PUSH, 1 * S, 2 * S), segments)
    assert Tally().figures()["accuracy"] is None


@pytest.mark.parametrize(("part", "whole"), [(0, 20), (10, 20), (20, 20), (3, 200)])
def test_intervals_cover_the_truth(part, whole):
    """An interval holds its share, and is as wide as its own ends demand: both are 1.96 standard errors from the share (Wilson)."""
    low, high = share_interval(part, whole)
    assert 0 <= low <= part / whole <= high <= 1
    for end in (low, high):
        if 0 < end < 1:
            assert abs(part / whole - end) == pytest.approx(1.96 * math.sqrt(end * (1 - end) / whole))
    assert share_interval(0, 0) == (0, 1)


@pytest.mark.parametrize("events", [0, 1, 7])
def test_intervals_of_rates(events):
    """With the rate at an end, so many events or more (or fewer) come with a chance of 2.5 %."""
    low, high = rate_interval(events, 2.0)
    fewer = sum(math.exp(-2 * high) * (2 * high) ** k / math.factorial(k) for k in range(events + 1))
    assert fewer == pytest.approx(0.025)
    if events:
        assert sum(math.exp(-2 * low) * (2 * low) ** k / math.factorial(k) for k in range(events)) == pytest.approx(0.975)
    assert rate_interval(events, 0.0) == (0.0, math.inf)
