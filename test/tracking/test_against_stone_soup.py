"""Stone Soup as a peer: the same pairs and the same means on linear problems, and a tracker on the same clouds."""

import numpy as np
import pytest
from blobs import FRAME_NS, Blobs, Person, make_cloud, standing, walking
from scoring import Score

pytest.importorskip("stonesoup", reason="Stone Soup is not installed (pip install stonesoup)")

from benchmarks.stone_soup import (
    DT,
    GATE,
    StoneSoupConfig,
    StoneSoupTracker,
    difference,
    drawn,
    models,
    our_estimator,
    our_inputs,
    our_step,
    over_stone_soup,
    their_inputs,
    their_step,
)
from radar_core import DataError
from radar_tracking import TrackStatus


def parts():
    """Stone Soup's filter and association with our knobs."""
    knobs = StoneSoupConfig()
    return models(knobs.process_noise, knobs.position_std, knobs.gate)


@pytest.mark.parametrize("seed", range(25))
def test_same_pairs_and_same_means(seed):
    """Ten tracks, ten detections in another order: every pair equal, every mean to 1e-9 (both are the same linear algebra in doubles)."""
    assert difference(seed, parts(), StoneSoupConfig()) < 1e-9


@pytest.mark.parametrize("dimensions", [2, 3])
def test_same_covariances(dimensions):
    """Updated covariances of (x, y, vx, vy) agree too; the height stays apart."""
    draw = drawn(3)
    tracks, detections = their_inputs(*draw)
    their_step(parts(), tracks, detections)
    belief, _ = our_step(our_estimator(dimensions), *our_inputs(*draw, 0.1, dimensions))
    index = np.array([0, 1, dimensions, dimensions + 1])
    for row, track in enumerate(tracks):
        theirs = np.asarray(track.covar, np.float64)[np.ix_([0, 2, 1, 3], [0, 2, 1, 3])]
        np.testing.assert_allclose(belief.covariance[row, 0][np.ix_(index, index)], theirs, atol=1e-9)


@pytest.mark.parametrize("lost", [1, 4, 10])
def test_same_choice_of_missed_tracks(lost):
    """Some detections moved far away: both leave the same tracks without, and only predict those."""
    mean, covariance, seen = drawn(5)
    seen = seen.copy()
    seen[:lost] += 100.0
    tracks, detections = their_inputs(mean, covariance, seen)
    hypotheses = their_step(parts(), tracks, detections)
    chosen = [[row, detections.index(h.measurement)] for row, h in enumerate(hypotheses) if h]
    belief, pairs = our_step(our_estimator(3), *our_inputs(mean, covariance, seen, 0.1, 3))
    assert pairs.tolist() == chosen
    assert len(pairs) == 10 - lost
    theirs = np.array([np.ravel(track.state_vector).astype(float)[[0, 2, 1, 3]] for track in tracks])
    np.testing.assert_allclose(belief.mean[:, 0][:, [0, 1, 3, 4]], theirs, atol=1e-9)


def test_same_choice_where_tracks_compete():
    """Tracks crowded into half a metre: the assignment decides, by both in the same way, also who stays without."""
    shared = 0
    for seed in range(10):
        mean, covariance, _ = drawn(seed)
        rng = np.random.default_rng(seed)
        mean[:, :2] = rng.uniform(2.0, 2.5, (10, 2))
        seen = mean[:6, :2] + DT * mean[:6, 2:] + rng.normal(0, 0.1, (6, 2))
        tracks, detections = their_inputs(mean, covariance, seen)
        hypotheses = their_step(parts(), tracks, detections)
        chosen = [[row, detections.index(h.measurement)] for row, h in enumerate(hypotheses) if h]
        _, pairs = our_step(our_estimator(3), *our_inputs(mean, covariance, seen, 0.1, 3), GATE)
        assert pairs.tolist() == chosen
        shared += len(pairs)
    assert shared >= 50  # of 60 detections: else nothing was decided here


def test_peer_tracks_two_people():
    """A fair peer: two walkers 3 m apart keep one identity each, confirmed after ten updates and within 0.15 m rms of the truth."""
    people = [Person(walking((1.5, 1.5), (4.5, 1.5), 1.0)), Person(walking((4.5, -1.5), (1.5, -1.5), 1.0))]
    blobs, tracker, score = Blobs(people, clutter=0.0, miss=0.05), StoneSoupTracker(), Score()
    for k in range(300):
        tracks = tracker.process(blobs.cloud(k))
        if k < 9:
            assert tracks.people_count == 0
        if k >= 30:
            score.add(blobs.truth(k), tracks)
    assert score.switches == 0
    assert score.tracked > 0.99
    # the centroid of eight points, each 0.1 to 0.14 m off, and a filter that lags by some centimetres
    assert score.rms < 0.15
    assert not score.false_ids


def test_peer_says_which_points_are_whose():
    """Point labels, number of points, coasting and deletion after a second."""
    blobs, tracker = Blobs([Person(standing(3.0, 0.5), points=12.0)], clutter=0.0, miss=0.0), StoneSoupTracker()
    for k in range(40):
        cloud = blobs.cloud(k)
        tracks = tracker.process(cloud)
    (track,) = tracks.tracks
    assert track.status is TrackStatus.CONFIRMED
    assert track.age == pytest.approx(39 * 0.02)
    assert np.isfinite(track.covariance).all()
    own = tracks.point_track_id == track.id
    assert track.n_points == own.sum() > 5
    for k in range(40, 95):
        tracks = tracker.process(make_cloud(np.empty((0, 3)), k))
        assert [t.id for t in tracks.tracks] == ([track.id] if (k - 39) * FRAME_NS <= 1_000_000_000 else [])
        assert all(t.status is TrackStatus.COASTING and t.unseen == pytest.approx((k - 39) * 0.02) for t in tracks.tracks)


def test_peer_repeats_itself_after_reset():
    """The same clouds give the same tracks, though Stone Soup's sets have no order."""

    def positions():
        blobs = Blobs([Person(standing(2.0, 0.8)), Person(standing(3.0, -0.8))], clutter=2.0)
        return [[(t.id, *t.position) for t in tracker.process(blobs.cloud(k)).tracks] for k in range(60)]

    tracker = StoneSoupTracker()
    first = positions()
    tracker.reset()
    assert positions() == first
    assert len(first[-1]) == 2


def test_peer_wants_the_room():
    """A cloud in another frame is refused."""
    cloud = Blobs([]).cloud(0)
    with pytest.raises(DataError, match="room"):
        StoneSoupTracker().process(type(cloud)(0, 0, "radar", cloud.x, cloud.y, cloud.z))


def test_benchmark_gives_its_figures():
    """Ratio and choices; how fast is not asserted here."""
    found = over_stone_soup(quick=True)
    assert 0 < found["over_stone_soup"] < 1
    assert {row["choice"] for row in found["choices"]} == {"Stone Soup", "ours, 2-D", "ours, 3-D"}
    assert all(row["accuracy"]["value"] < 1e-9 for row in found["choices"])
