"""CLEAR-MOT and IDF1: hand-made runs with known counts, brute force, and Stone Soup on the same runs."""

import datetime
import itertools
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from radar_core import ConfigError
from radar_tracking.metrics import ClearMot, ClearMotConfig, ObjectSet

START = datetime.datetime(2024, 1, 1)


def at(**places):
    """Objects on the x axis by identity: at(_1=2.0) is number 1 at x = 2 m."""
    return ObjectSet.of(np.array([[x, 0.0] for x in places.values()]).reshape(-1, 2), [int(name[1:]) for name in places])


def run(moments, radius=0.5):
    metric = ClearMot(ClearMotConfig(radius=radius))
    steps = [metric.process(truth, estimate) for truth, estimate in moments]
    return steps, metric.summary()


def test_counts_of_a_run_made_by_hand():
    """One person missed for two of ten moments, a ghost for three, positions 0.1 m off: MOTA is 1 - (2 + 3) / 20."""
    moments = []
    for k in range(10):
        tracks = {"_7": 1.1} | ({"_8": 4.1} if k >= 2 else {}) | ({"_9": 8.0} if k < 3 else {})
        moments.append((at(_1=1.0, _2=4.0), at(**tracks)))
    steps, summary = run(moments)
    assert (summary.truths, summary.matches, summary.misses, summary.false_positives, summary.switches) == (20, 18, 2, 3, 0)
    assert summary.mota == pytest.approx(1 - 5 / 20)
    assert summary.motp == pytest.approx(0.1)
    assert summary.rms == pytest.approx(0.1)
    assert summary.idf1 == pytest.approx(2 * 18 / (20 + 21))
    assert summary.people[2].tracked_fraction == pytest.approx(0.8)
    assert steps[0].missed.tolist() == [2]
    assert steps[0].false.tolist() == [9]


def test_a_swap_is_two_switches_and_half_the_identities():
    """Tracks change places for good at half time: one switch each; every track is of its person for half of the time."""
    moments = [(at(_1=1.0, _2=4.0), at(_7=1.0, _8=4.0) if k < 5 else at(_8=1.0, _7=4.0)) for k in range(10)]
    steps, summary = run(moments)
    assert summary.switches == 2
    assert steps[5].switched.tolist() == [1, 2]
    assert [person.switches for person in summary.people.values()] == [1, 1]
    assert summary.mota == pytest.approx(1 - 2 / 20)
    assert summary.idf1 == pytest.approx(0.5)


def test_a_new_identity_after_a_gap_is_a_switch():
    """Figure 6.2 (c) of the thesis: the track is lost for a while and comes back under another number."""
    moments = [(at(_1=1.0), at(**({"_0": 1.0} if k < 4 else {"_13": 1.0} if k > 6 else {}))) for k in range(10)]
    _, summary = run(moments)
    assert (summary.misses, summary.switches) == (3, 1)


def test_a_pair_is_kept_while_it_is_within_the_radius():
    """A nearer newcomer does not take a person away from their track; beyond the radius it does. The radius itself is within."""
    moments = [
        (at(_1=0.0), at(_7=0.0)),
        (at(_1=0.0), at(_7=0.5, _8=0.0)),
        (at(_1=0.0), at(_7=0.5 + 1e-9, _8=0.0)),
        (at(_1=0.0), at(_7=0.0, _8=0.3)),
    ]
    steps, summary = run(moments)
    assert [step.estimate_id.tolist() for step in steps] == [[7], [7], [8], [8]]
    assert (summary.switches, summary.false_positives) == (1, 3)


def test_as_many_pairs_as_possible():
    """The middle track is nearest to both; giving it to the first person alone would leave two unpaired."""
    (step,), _ = run([(at(_1=0.0, _2=0.5), at(_7=0.1, _8=-0.4))])
    assert dict(zip(step.truth_id.tolist(), step.estimate_id.tolist(), strict=True)) == {1: 8, 2: 7}


def test_a_track_that_was_given_away_is_not_taken_back():
    """Person 1 lost track 7 to person 2; when both are near again, it is person 2 who keeps it."""
    moments = [
        (at(_1=0.0, _2=2.0), at(_7=0.0)),
        (at(_1=0.0, _2=2.0), at(_7=2.0)),
        (at(_1=2.0, _2=2.2), at(_7=2.0)),
    ]
    steps, _ = run(moments)
    assert steps[2].truth_id.tolist() == [2]


def test_people_who_do_not_count():
    """Hidden: no miss, no hit, no false track; the identity they come back with is compared with the one they left with, once."""
    metric = ClearMot()
    for k in range(12):
        hidden = 4 <= k < 8
        track = {} if k in (4, 5) else {7 if k < 4 else 8: 1.0}
        truth = ObjectSet.of([[1.0, 0.0]], [1], [not hidden])
        metric.process(truth, ObjectSet.of([[x, 0.0] for x in track.values()] or np.empty((0, 2)), list(track)))
    summary = metric.summary()
    assert (summary.truths, summary.matches, summary.misses, summary.false_positives) == (8, 8, 0, 0)
    assert summary.switches == 1
    assert summary.idf1 == pytest.approx(2 * 4 / 16)


def test_people_who_count_come_first():
    """A new track between a hidden person and one in view is of the one in view, though the hidden one is nearer."""
    metric = ClearMot()
    step = metric.process(ObjectSet.of([[0.0, 0.0], [0.6, 0.0]], [1, 2], [True, False]), at(_7=0.4))
    assert step.truth_id.tolist() == [1]


def test_an_empty_run_claims_nothing():
    """No moments, or moments without anybody: ratios are NaN, counts 0."""
    metric = ClearMot()
    assert math.isnan(metric.summary().mota)
    metric.process(at(), at())
    summary = metric.summary()
    assert summary.moments == 1
    assert all(math.isnan(ratio) for ratio in (summary.mota, summary.motp, summary.rms, summary.idf1))
    metric.process(at(), at(_3=1.0))
    assert metric.summary().false_positives == 1
    assert metric.summary().idf1 == 0.0
    metric.reset()
    assert metric.summary().moments == 0


def test_a_radius_of_nothing_is_refused():
    """The error names the knob."""
    with pytest.raises(ConfigError, match=r"ClearMotConfig\.radius"):
        ClearMotConfig(radius=0.0)


crowd = st.lists(st.tuples(st.integers(0, 4), st.integers(-8, 8)), max_size=5, unique_by=lambda pair: pair[0])


@settings(max_examples=80, deadline=None)
@given(moments=st.lists(st.tuples(crowd, crowd), min_size=1, max_size=8), hidden=st.integers(-1, 4))
def test_counts_agree_with_each_other(moments, hidden):
    """Truth is hits and misses, estimates are hits and false ones but for the excused; pairs lie within the radius; one to one."""
    metric, estimates, excused = ClearMot(), 0, 0
    for real, found in moments:
        truth = ObjectSet.of(np.array([[x / 8, 0.0] for _, x in real]).reshape(-1, 2), [n for n, _ in real], [n != hidden for n, _ in real])
        estimate = ObjectSet.of(np.array([[x / 8, 0.0] for _, x in found]).reshape(-1, 2), [n for n, _ in found])
        step = metric.process(truth, estimate)
        assert np.all(step.distance <= 0.5)
        assert len(set(step.truth_id.tolist())) == len(step.truth_id)
        assert len(set(step.estimate_id.tolist())) == len(step.estimate_id)
        estimates += len(found)
        excused += int((~step.visible).sum())
    summary = metric.summary()
    assert summary.truths == summary.matches + summary.misses
    assert estimates == summary.matches + summary.false_positives + excused
    assert summary.truths == sum(n != hidden for real, _ in moments for n, _ in real)
    assert math.isnan(summary.mota) or summary.mota <= 1
    assert math.isnan(summary.idf1) or 0 <= summary.idf1 <= 1


def stone_soup(truths, tracks, associator=None, pairs=()):
    """MOTP and MOTA of Stone Soup, of paths ``{identity: {moment: place}}``, with its own pairing or with ours."""
    from stonesoup.measures import Euclidean
    from stonesoup.metricgenerator.clearmotmetrics import ClearMotMetrics
    from stonesoup.metricgenerator.manager import MultiManager
    from stonesoup.types.association import AssociationSet, SingleTimeAssociation
    from stonesoup.types.groundtruth import GroundTruthPath
    from stonesoup.types.state import State
    from stonesoup.types.track import Track

    def path(kind, places):
        return kind([State(np.reshape(p, (-1, 1)), timestamp=START + datetime.timedelta(seconds=k)) for k, p in places.items()])

    real = {name: path(GroundTruthPath, places) for name, places in truths.items()}
    found = {name: path(Track, places) for name, places in tracks.items()}

    class Given:
        def associate_tracks(self, *_):
            return AssociationSet(
                {SingleTimeAssociation({real[i], found[j]}, timestamp=START + datetime.timedelta(seconds=k)) for k, i, j in pairs}
            )

    manager = MultiManager([ClearMotMetrics(distance_measure=Euclidean())], associator=associator or Given())
    manager.add_data({"groundtruth_paths": set(real.values()), "tracks": set(found.values())})
    metrics = manager.generate_metrics()["clearmot_generator"]
    return metrics["MOTP"].value, metrics["MOTA"].value


def compare(truths, tracks, length, radius):
    """Score the same paths by ours."""
    metric, steps = ClearMot(ClearMotConfig(radius=radius)), []
    for k in range(length):
        real = {n: p[k] for n, p in truths.items() if k in p}
        found = {n: p[k] for n, p in tracks.items() if k in p}
        sets = [ObjectSet.of(np.array(list(s.values())).reshape(-1, 2), list(s)) for s in (real, found)]
        steps.append(metric.process(*sets))
    return steps, metric.summary()


def test_clear_mot_equals_stone_soup_from_end_to_end():
    """Three people with errors, a swap, a track that goes on under another number, a late start, a ghost: the same MOTA and MOTP.

    People are a metre apart or more where pairs are made, so that Stone Soup's pairing (which does not cut distances at the radius) has no
    other choice than ours, and nobody changes tracks across a gap (see below).
    """
    from stonesoup.dataassociator.clearmot import ClearMotAssociator

    rng, n = np.random.default_rng(7), 60
    truths = {i: {k: np.array([2.0 + 2 * i, -2 + 0.05 * k]) for k in range(n)} for i in range(3)}
    noisy = {i: {k: p + rng.normal(0, 0.08, 2) for k, p in path.items()} for i, path in truths.items()}
    tracks = {
        10: {k: noisy[0 if k < 30 else 1][k] for k in range(n)},
        11: {k: noisy[1 if k < 30 else 0][k] for k in range(n)},
        12: {k: noisy[2][k] for k in range(8, 40)},
        13: {k: noisy[2][k] for k in range(40, n)},
        14: {k: np.array([9.0, 5.0]) for k in range(20, 30)},
    }
    steps, ours = compare(truths, tracks, n, 0.5)
    motp, mota = stone_soup(truths, tracks, ClearMotAssociator(association_threshold=0.5))
    assert (ours.misses, ours.false_positives, ours.switches) == (8, 10, 3)
    assert ours.mota == pytest.approx(mota, abs=1e-9)
    assert ours.motp == pytest.approx(motp, abs=1e-9)
    assert len(steps[35].truth_id) == 3


@pytest.mark.parametrize("seed", range(8))
def test_clear_mot_equals_stone_soup_given_the_pairs(seed):
    """Random paths with gaps: MOTP, and MOTA but for switches across a gap, which Stone Soup does not see.

    It compares a person's track with that of the moment before only; Bernardin and Stiefelhagen, and we, with the last one known.
    """
    rng, n = np.random.default_rng(seed), 25
    truths = {i: {k: rng.uniform(0, 1.5, 2) for k in range(n) if rng.random() < 0.8} for i in range(4)}
    tracks = {10 + j: {k: rng.uniform(0, 1.5, 2) for k in range(n) if rng.random() < 0.7} for j in range(5)}
    steps, ours = compare(truths, tracks, n, 0.5)
    maps = [dict(zip(s.truth_id.tolist(), s.estimate_id.tolist(), strict=True)) for s in steps]
    pairs = [(k, i, j) for k, held in enumerate(maps) for i, j in held.items()]
    motp, mota = stone_soup(truths, tracks, pairs=pairs)
    at_once = sum(i in after and after[i] != j for before, after in itertools.pairwise(maps) for i, j in before.items())
    assert ours.switches > at_once > 0
    assert ours.motp == pytest.approx(motp, abs=1e-9)
    assert ours.mota + (ours.switches - at_once) / ours.truths == pytest.approx(mota, abs=1e-9)


def test_idf1_is_the_best_assignment_of_whole_tracks():
    """Random overlaps against brute force over all assignments of tracks to people."""
    rng = np.random.default_rng(11)
    for _ in range(10):
        metric, overlap, people, found = ClearMot(), np.zeros((3, 4), int), 0, 0
        for _ in range(30):
            real, tracks = rng.uniform(0, 1.2, (3, 2)), rng.uniform(0, 1.2, (4, 2))
            metric.process(ObjectSet.of(real), ObjectSet.of(tracks))
            overlap += np.linalg.norm(real[:, None] - tracks[None], axis=-1) <= 0.5
            people, found = people + 3, found + 4
        best = max(sum(overlap[i, j] for i, j in enumerate(chosen)) for chosen in itertools.permutations(range(4), 3))
        assert metric.summary().idf1 == pytest.approx(2 * best / (people + found), abs=1e-12)
