"""Scoring against small cases counted by hand."""

from __future__ import annotations

import math
from types import SimpleNamespace

import numpy as np
import pytest

from radar_core import GESTURES, NO_GESTURE
from radar_lab.datasets.scenes import nearest_person
from radar_lab.evaluation.scoring import RecognisedGesture, TruthSegment, score_gestures, truth_segments

S = 1_000_000_000
PULL, PUSH, WAVE = (GESTURES.index(name) for name in ("pull", "push", "wave"))


def segment(label, start, end, person=0):
    return TruthSegment(person, label, round(start * S), round(end * S))


def found(label, start, end, person=0):
    return RecognisedGesture(person, label, round(start * S), round(end * S))


def counts(score):
    return (score.hits, score.wrong, score.misses, score.false_alarms)


def test_hits_wrong_misses_and_false_alarms():
    truth = [segment(PULL, 1, 2), segment(PUSH, 4, 5), segment(WAVE, 7, 8), segment(PULL, 10, 11)]
    got = [found(PULL, 1.1, 1.9), found(WAVE, 4, 5), found(0, 7, 8), found(PUSH, 20, 21), found(0, 30, 31)]
    score = score_gestures(truth, got)
    assert counts(score) == (1, 1, 2, 1)
    assert score.rate == pytest.approx(0.25)
    assert score.confusion[WAVE, 0] == 1
    assert score.confusion[PULL, -1] == 1
    assert [g.label if g else None for _, g in score.outcomes] == [PULL, WAVE, 0, None]


def test_another_persons_gesture_is_no_hit():
    assert counts(score_gestures([segment(PULL, 1, 2, person=0)], [found(PULL, 1, 2, person=1)])) == (0, 0, 1, 1)


@pytest.mark.parametrize(("start", "hits"), [(2.5, 1), (2.7, 0)])
def test_times_must_overlap_within_the_tolerance(start, hits):
    assert score_gestures([segment(PULL, 1, 2)], [found(PULL, start, 3)]).hits == hits


def test_the_right_label_is_matched_before_a_larger_overlap():
    """A random event and a second gesture in the same segment: the right one counts, the other gesture is a false alarm."""
    score = score_gestures([segment(PULL, 1, 2)], [found(0, 1, 2), found(WAVE, 1, 2), found(PULL, 1.8, 2.2)])
    assert counts(score) == (1, 0, 0, 1)


def test_each_event_serves_one_segment():
    assert counts(score_gestures([segment(PULL, 1, 2), segment(PULL, 2.1, 3)], [found(PULL, 1.5, 2.5)])) == (1, 0, 1, 0)


def test_nothing_performed_has_no_rate():
    assert math.isnan(score_gestures([], []).rate)


def test_random_segments_count_only_when_asked():
    truth, got = [segment(0, 1, 2), segment(PULL, 3, 4)], [found(0, 1, 2)]
    assert counts(score_gestures(truth, got)) == (0, 0, 1, 0)
    assert counts(score_gestures(truth, got, count_random=True)) == (1, 0, 1, 0)


def truth(stamp, gesture, index, person=(3, 4)):
    return SimpleNamespace(
        stamp_ns=stamp,
        person_id=np.array(person, np.uint32),
        position=np.array([[2.0, 0.0, 1.0], [2.0, 1.0, 1.0]]),
        gesture=np.array(gesture, np.uint8),
        gesture_index=np.array(index, np.uint32),
        labels=GESTURES,
    )


def test_segments_come_from_truth_frame_by_frame():
    """Two gestures of one label back to back are two segments, because the running number changes."""
    frames = [
        truth(0, [NO_GESTURE, WAVE], [0, 0]),
        truth(20, [PULL, WAVE], [0, 0]),
        truth(40, [PULL, WAVE], [1, 0]),
        truth(60, [PULL, NO_GESTURE], [1, 0]),
    ]
    assert truth_segments(frames) == (TruthSegment(4, WAVE, 0, 40), TruthSegment(3, PULL, 20, 20), TruthSegment(3, PULL, 40, 60))


def test_a_track_belongs_to_the_nearest_person_within_the_gate():
    now = truth(0, [NO_GESTURE, NO_GESTURE], [0, 0])
    assert nearest_person(now, np.array([2.1, 0.4, 0.0])) == 3
    assert nearest_person(now, np.array([2.1, 0.6, 0.0])) == 4
    assert nearest_person(now, np.array([4.0, 0.6, 0.0])) is None
