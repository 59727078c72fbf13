"""The judge of a run is judged: tracks and gestures made from known truth get the marks they deserve."""

import math
from dataclasses import replace

import numpy as np
import pytest

from radar_core import GESTURES, NO_GESTURE, DataError, Pose, RadarInfo
from radar_gestures.gesture import Gesture
from radar_lab.evaluation.matching import Visibility
from radar_lab.evaluation.run import EvaluationConfig, Evaluator
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


def tracks(k, placed, covariance=None):
    spread = np.eye(6) if covariance is None else covariance
    made = tuple(
        Track(i, TrackStatus.CONFIRMED, 1.0, 0.0, 5, np.array([x, y, 0.9]), np.zeros(3), np.full(3, 0.1), spread)
        for i, (x, y) in placed.items()
    )
    return Tracks(k * SECOND // 50, k, "room", made, np.empty(0, np.int32))


def evaluator():
    return Evaluator(RadarInfo(mount=Pose()))


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
    assert report["ghost_track_frames"] == 250
    assert report["ghost_track_frames_per_minute"] == pytest.approx(3000)  # one ghost all the time, 50 moments a second


def test_a_ghost_that_hits_a_person_later_is_still_a_ghost():
    """Half of the time the only track is 2 m from the only person, then it is theirs: every track-frame of the first half is a ghost."""
    judge = evaluator()
    for k in range(200):
        judge.add(tracks(k, {7: (4.0, 0.0) if k < 100 else (2.0, 0.0)}), truth(k, [(2.0, 0.0)]))
    report = judge.report()
    assert (report["ghost_track_frames"], report["track_frames"]) == (100, 200)
    assert report["minutes"] == pytest.approx(200 * 0.02 / 60)
    assert report["ghost_track_frames_per_minute"] == pytest.approx(1500)
    assert report["ghost_tracks"] == 0  # the first definition leaves it out: the track was on somebody once
    assert report["mota"] == pytest.approx(1 - (50 + 100) / 150)  # ghosts are MOTA's false positives; a second to settle


def test_hidden_people_neither_hit_nor_make_ghosts():
    """Who shows the radar less than the least cross-section does not count; their track is excused while it is within the gate."""
    judge, rule = evaluator(), Visibility(RadarInfo(mount=Pose()), EvaluationConfig(settle=0.0))
    for k in range(200):
        shown = np.array([0.2, 0.001 if k >= 100 else 0.2], np.float32)
        state = replace(
            truth(k, [(2.0, 0.5), (4.0, -1.0)]),
            scatterer_position=np.zeros((2, 3), np.float32), scatterer_owner=np.array([0, 1], np.int32), scatterer_rcs=shown,
        )  # fmt: skip
        place = (4.0, -1.0) if k < 150 else (4.0, -2.5)
        judge.add(tracks(k, {7: (2.0, 0.5), 8: place}), state)
        assert rule.process(state).tolist() == [True, k < 100]
    report = judge.report()
    assert report["ghost_track_frames"] == 50  # beyond the gate of a hidden person, a track is on nobody
    assert report["people"]["2"]["tracked_fraction"] == 1.0
    assert report["mota"] == pytest.approx(1 - 50 / (150 + 50))


def test_the_last_range_bins_are_out_of_view():
    """Unambiguous range 6.4 m less the margin of 0.2 m."""
    judge = evaluator()
    for k in range(100):
        judge.add(tracks(k, {}), truth(k, [(6.3, 0.0)]))
    assert judge.report()["mota"] is None


def test_a_gesture_of_a_track_on_nobody_is_false():
    """Nobody is within the gate of the track that published it: false, also when the track hits the performer later."""
    for later in ((5.0, 2.0), (2.0, 0.0)):
        judge = evaluator()
        for k in range(150):
            place = (5.0, 2.0) if k < 120 else later
            judge.add(tracks(k, {9: place}), truth(k, [(2.0, 0.0)], "push" if 50 <= k < 80 else None))
        judge.add_gesture(gesture("push", 9, SECOND, SECOND * 8 // 5))
        judge.add_gesture(gesture("random", 9, SECOND, SECOND * 8 // 5))
        report = judge.report()["gestures"]
        assert (report["hits"], report["misses"], report["false_gestures"]) == (0, 1, 1)
        assert report["false_gestures_per_minute"] == pytest.approx(20)  # one in three seconds
    assert report["false_alarms"] == 0  # the first definition credits the person whom the track hit later


def test_a_gesture_belongs_to_whom_the_track_was_on_while_it_was_performed():
    """A track that goes from one person to the other after a push: the push is the first one's."""
    judge = evaluator()
    for k in range(150):
        state = truth(k, [(2.0, 0.5), (3.0, -1.0)], "push" if 50 <= k < 80 else None)
        state.gesture[1] = NO_GESTURE
        judge.add(tracks(k, {7: (2.0, 0.5) if k < 85 else (3.0, -1.0)}), state)
    judge.add_gesture(gesture("push", 7, SECOND, SECOND * 8 // 5))
    assert judge.score().hits == 1


@pytest.mark.parametrize(("others", "hits"), [({}, 1), ({8: (2.1, 0.1)}, 0)])
def test_a_gesture_of_a_tentative_track_belongs_to_whom_it_is_on_who_has_no_other(others, hits):
    """Nobody is confirmed on the performer: the gesture is theirs. Where somebody is, the tentative track is a second one, or an arm."""
    judge = evaluator()
    for k in range(150):
        state = tracks(k, {7: (2.0, 0.1), **others})
        early = replace(state.tracks[0], status=TrackStatus.TENTATIVE)
        judge.add(replace(state, tracks=(early, *state.tracks[1:])), truth(k, [(2.0, 0.0), (4.0, 1.0)], "push" if 50 <= k < 80 else None))
    judge.add_gesture(gesture("push", 7, SECOND, SECOND * 8 // 5))
    assert judge.score().hits == hits
    assert judge.score().false_alarms == 1 - hits


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
    assert report["mota"] is None
    assert report["gospa"]["mean_m"] is None
    assert report["nees"]["mean"] is None
    assert report["hand"]["rms_m"] is None
    assert report["gestures"]["total"] == 0


def test_mota_and_gospa_of_a_run_with_known_faults():
    """Fifty of two hundred moments that count without a track, a ghost all the time: both figures in closed form."""
    judge = evaluator()
    live = [judge.add(tracks(k, ({7: (2.0, 0.1)} if k >= 100 else {}) | {9: (5.0, 2.0)}), truth(k, [(2.0, 0.0)])) for k in range(250)]
    report = judge.report()
    # The first 50 moments (one second) do not count for the person: 50 misses, 150 hits, 250 false tracks, 200 truths.
    assert report["mota"] == pytest.approx(1 - (50 + 250) / 200)
    assert report["gospa"]["missed"] == pytest.approx(0.5 * 50 / 250)
    assert report["gospa"]["false_tracks"] == pytest.approx(0.5)
    assert report["gospa"]["localisation"] == pytest.approx(0.01 * 150 / 250)
    assert report["gospa"]["power_mean_m"] ** 2 == pytest.approx(0.1 + 0.5 + 0.006)
    assert report["gospa"]["mean_m"] == pytest.approx(np.mean([g.distance for g in live]))
    assert (live[0].n_truth, live[60].n_truth, live[60].n_estimates, live[-1].n_pairs) == (0, 1, 1, 1)


def test_time_to_settle_and_gate_are_knobs():
    """Without time to be found, the first moments are misses; with a small gate, a track 0.3 m off is of nobody."""
    judge = Evaluator(RadarInfo(mount=Pose()), EvaluationConfig(settle=0.0, gate=0.2))
    for k in range(10):
        judge.add(tracks(k, {7: (2.0, 0.3)}), truth(k, [(2.0, 0.0)]))
    assert judge.report()["mota"] == pytest.approx(1 - 20 / 10)
    assert judge.report()["people"]["1"]["tracked_fraction"] == 0.0


def test_a_track_on_somebody_out_of_view_is_no_ghost():
    """It is on a person, though not on one who counts."""
    judge = evaluator()
    for k in range(100):
        judge.add(tracks(k, {7: (7.0, 0.2)}), truth(k, [(7.0, 0.0)]))
    report = judge.report()
    assert report["ghost_tracks"] == 0
    assert report["gospa"]["mean_m"] == 0.0
    assert report["mota"] is None


def test_an_identity_after_an_absence_is_compared_with_the_one_before():
    """Somebody leaves the view and comes back as another track: one switch."""
    judge = evaluator()
    for k in range(300):
        away = 100 <= k < 150
        judge.add(tracks(k, {} if away else {7 if k < 100 else 8: (2.0, 0.0)}), truth(k, [(9.0 if away else 2.0, 0.0)]))
    assert judge.report()["people"]["1"]["identity_switches"] == 1


@pytest.mark.long
def test_nees_of_the_position_on_the_ground():
    """Errors drawn from the covariance the tracks claim: 1 per degree of freedom; claims that are too good show, none are left out."""
    rng, root = np.random.default_rng(2), np.array([[0.2, 0.0], [0.1, 0.05]])
    claimed = np.eye(6)
    claimed[:2, :2] = root @ root.T
    for claim, mean in ((claimed, 1.0), (claimed / 4, 4.0)):
        judge = evaluator()
        for k in range(1050):
            judge.add(tracks(k, {7: root @ rng.normal(size=2) + [2.0, 0.0]}, claim), truth(k, [(2.0, 0.0)]))
        report = judge.report()["nees"]
        # Errors beyond 0.8 m (3.6 sigma) would be left out. Mean of 1000 samples of 2 degrees of freedom: standard deviation 3 %.
        assert report["mean"] == pytest.approx(mean, rel=0.12)
        assert (report["samples"], report["refused"]) == (1000, 0)
    judge = evaluator()
    for k in range(100):
        judge.add(tracks(k, {7: (2.0, 0.0)}, np.full((6, 6), np.nan) if k < 75 else np.zeros((6, 6))), truth(k, [(2.0, 0.0)]))
    assert judge.report()["nees"] == {"mean": None, "samples": 0, "refused": 25}


def test_a_moment_that_makes_no_sense_is_left_out():
    """A track at NaN: refused by name, and the run goes on as if it had not been."""
    judge = evaluator()
    for k in range(100):
        judge.add(tracks(k, {7: (2.0, 0.0)}), truth(k, [(2.0, 0.0)]))
        with pytest.raises(DataError, match=r"ObjectSet\.position"):
            judge.add(tracks(k, {7: (math.nan, 0.0)}), truth(k, [(2.0, 0.0)]))
    report = judge.report()
    assert report["moments"] == 100
    assert report["mota"] == 1.0
    assert report["gospa"]["mean_m"] == 0.0
