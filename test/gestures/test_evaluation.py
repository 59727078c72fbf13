"""The judge of a run is judged: tracks and gestures made from known truth get the marks they deserve."""

import math

import numpy as np
import pytest

from radar_core import GESTURES, NO_GESTURE, Pose
from radar_gestures.evaluation import Evaluator
from radar_gestures.recognizer import Gesture
from radar_sim import Truth
from radar_tracking import HandTrack, Track, Tracks
from radar_tracking.tracks import TrackStatus

SECOND = 10**9


def truth(k, positions, gesture=None, drawing=False):
    n = len(positions)
    position = np.array([[*p, 0.9] for p in positions], float).reshape(n, 3)
    return Truth(
        stamp_ns=k * SECOND // 50,
        sequence=k,
        frame_id="room",
        person_id=np.arange(1, n + 1, dtype=np.uint32),
        position=position,
        velocity=np.zeros((n, 3)),
        hand_position=position + np.array([-0.5, 0, 0.3]),
        hand_velocity=np.zeros((n, 3)),
        gesture=np.full(n, NO_GESTURE if gesture is None else GESTURES.index(gesture), np.uint8),
        gesture_index=np.zeros(n, np.uint32),
        walking=np.zeros(n, bool),
        drawing=np.full(n, drawing),
    )


def tracks(k, placed):
    made = tuple(
        Track(i, TrackStatus.CONFIRMED, 1.0, 0.0, 5, np.array([x, y, 0.9]), np.zeros(3), np.full(3, 0.1), np.eye(6))
        for i, (x, y) in placed.items()
    )
    return Tracks(k * SECOND // 50, k, "room", made, np.empty(0, np.int32))


def evaluator():
    return Evaluator(Pose(), math.radians(120), 6.4)


def gesture(name, track_id, start, end):
    label = GESTURES.index(name)
    return Gesture(end, "room", track_id, label, name, 0.9, np.eye(10)[label], start, end, np.zeros(13))


def test_a_perfect_run_with_a_known_offset():
    """Tracks 0.1 m off: rms is 0.1, everyone is tracked, nobody switches."""
    judge = evaluator()
    for k in range(200):
        judge.add(tracks(k, {7: (2.1, 0.5), 8: (3.0, -0.9)}), truth(k, [(2.0, 0.5), (3.0, -1.0)]))
    report = judge.report()
    for person in report["people"].values():
        assert person["tracked_fraction"] == 1.0
        assert person["identity_switches"] == 0
        assert person["position_rms_m"] == pytest.approx(0.1)
    assert report["ghost_tracks"] == 0


def test_a_swap_of_identities_is_two_switches():
    """Two people whose tracks change places: one switch each."""
    judge = evaluator()
    for k in range(200):
        a, b = ((2.0, 0.5), (3.0, -1.0)) if k < 100 else ((3.0, -1.0), (2.0, 0.5))
        judge.add(tracks(k, {7: a, 8: b}), truth(k, [(2.0, 0.5), (3.0, -1.0)]))
    assert [p["identity_switches"] for p in judge.report()["people"].values()] == [1, 1]


def test_untracked_time_and_ghosts():
    """Half of the time after the first second without a track; a track where nobody is counts as a ghost."""
    judge = evaluator()
    for k in range(250):
        placed = {7: (2.0, 0.0)} if k < 150 else {}
        judge.add(tracks(k, placed | {9: (5.0, 2.0)}), truth(k, [(2.0, 0.0)]))
    report = judge.report()
    assert report["people"]["1"]["tracked_fraction"] == pytest.approx(0.5, abs=0.01)
    assert report["ghost_tracks"] == 1


def test_people_out_of_view_do_not_count():
    """Behind the radar, too far to the side, or beyond the unambiguous range nobody can be tracked."""
    judge = evaluator()
    for k in range(100):
        judge.add(tracks(k, {}), truth(k, [(-2.0, 0.0), (1.0, 3.0), (7.0, 0.0)]))
    assert all(p["tracked_fraction"] is None for p in judge.report()["people"].values())


def test_gestures_of_the_right_and_of_the_wrong_person():
    """The right label for the right person is a hit; for the other person it is a miss and a false alarm."""
    judge = evaluator()
    for k in range(150):
        state = truth(k, [(2.0, 0.5), (3.0, -1.0)], "push" if 50 <= k < 80 else None)
        state.gesture[1] = NO_GESTURE
        judge.add(tracks(k, {7: (2.0, 0.5), 8: (3.0, -1.0)}), state)
    judge.add_gesture(gesture("push", 7, SECOND, SECOND * 8 // 5))
    judge.add_gesture(gesture("push", 8, SECOND, SECOND * 8 // 5))
    score = judge.score()
    assert (score.hits, score.wrong, score.misses, score.false_alarms) == (1, 0, 0, 1)
    outcome = judge.report()["gestures"]["outcomes"][0]
    assert (outcome["person"], outcome["performed"], outcome["recognised"]) == (1, "push", "push")


def test_hand_counts_only_while_drawing():
    """A hand 0.1 m off while drawing; elsewhere while not, which does not count."""
    judge = evaluator()
    for k in range(100):
        state = truth(k, [(2.0, 0.0)], drawing=k >= 50)
        judge.add(tracks(k, {7: (2.0, 0.0)}), state)
        offset = [0.0, 0.1, 0.0] if k >= 50 else [0.0, 3.0, 0.0]
        hand = HandTrack(state.stamp_ns, k, "room", 7, True, 3, 0.0, state.hand_position[0] + offset, np.zeros(3), np.eye(6), 0.5)
        judge.add_hand(hand, state)
    report = judge.report()
    assert report["hand"]["rms_m"] == pytest.approx(0.1)
    assert report["hand"]["tracked_fraction"] == 1.0


def test_an_empty_run_has_no_figures_but_no_errors():
    """No frames, no people: nothing is claimed."""
    report = evaluator().report()
    assert report["people"] == {}
    assert report["hand"]["rms_m"] is None
    assert report["gestures"]["total"] == 0
