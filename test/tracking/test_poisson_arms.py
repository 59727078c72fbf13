"""Arms in the Poisson tracker: they give more points than the body behind them, and are nobody of their own."""

import numpy as np
import pytest
from blobs import Blobs, Person, standing

from radar_tracking import TrackerConfig, Tracks, TrackStatus
from radar_tracking.poisson.tracker import PoissonTracker

FRAME_NS = 20_000_000
WALK, FIRST, PERIOD, STROKE = 2.5, 5.0, 2.0, 0.6  # s


def arrives(x: float, y: float):
    """Somebody who walks up to a place and stands there."""
    stay = standing(x, y)
    return lambda t: stay(t) + np.array([max(WALK - t, 0.0), 0.0, 0.0])


def swipes(width: float):
    """A hand that hangs at rest and swipes across in front of the body every two seconds."""

    def hand(t: float) -> np.ndarray:
        s = ((t - FIRST) % PERIOD) / STROKE
        if t < FIRST or s > 1.0:
            return np.array([0.0, 0.25, -0.2])
        return np.array([-0.55, width * (s - 0.5), 0.3])

    return hand


def swiped(t: float) -> bool:
    """Whether a stroke goes on."""
    return t >= FIRST and (t - FIRST) % PERIOD < STROKE


def followed(width: float) -> tuple[Blobs, list[Tracks]]:
    """Twenty seconds of somebody with four points of the body and twelve of the arm, and what the tracker says of each cloud."""
    blobs = Blobs([Person(arrives(2.5, 0.3), swipes(width), points=4.0, arm_points=12.0)], clutter=0.0, miss=0.0, frame_ns=FRAME_NS)
    tracker = PoissonTracker(TrackerConfig(tracker="poisson_bernoulli"))
    return blobs, [tracker.process(blobs.cloud(k)) for k in range(20 * 50)]


@pytest.mark.long
@pytest.mark.parametrize(("width", "most"), [(0.8, 0.3), (1.2, 0.45)])
def test_an_arm_draws_nobody_away_and_is_nobody(width, most):
    """Who stands and swipes is one person all the time, within 0.4 of a stroke's width; nine in ten points of the strokes are theirs."""
    blobs, results = followed(width)
    stood = range(round(4.0 * 50), len(results))
    people = [[t for t in results[k].tracks if t.status is not TrackStatus.TENTATIVE] for k in stood]
    assert {len(now) for now in people} == {1}
    assert len({now[0].id for now in people}) == 1
    gaps = [np.hypot(*(now[0].position[:2] - blobs.truth(k)[0, :2])) for k, now in zip(stood, people, strict=True)]
    assert max(gaps) < most
    own = [results[k].point_track_id == people[0][0].id for k in stood if swiped(k * FRAME_NS * 1e-9)]
    assert np.mean(np.concatenate(own)) > 0.9
