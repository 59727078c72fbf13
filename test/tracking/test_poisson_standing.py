"""How long somebody without points is believed depends on how often those who stand give points to this radar, which is learned."""

import numpy as np
import pytest

from radar_core import PointCloud
from radar_tracking import TrackerConfig
from radar_tracking.poisson.tracker import PoissonTracker

DT = 0.05  # s


def cloud(k: int, place: float | None, speed: float, rng: np.random.Generator) -> PointCloud:
    """Ten points of a person so far ahead [m]; none: an empty cloud."""
    n = 0 if place is None else 10
    points = (np.array([place or 0.0, 0.0, 1.0]) + rng.normal(0.0, [0.08, 0.08, 0.15], (n, 3))).astype(np.float32)
    columns = {"radial_speed": (speed + rng.normal(0.0, 0.02, n)).astype(np.float32), "snr": np.full(n, 30.0, np.float32)}
    return PointCloud(round(k * DT * 1e9), k, "room", *points.T.copy(), **columns)


def believed(walks: float, stands: float, stood: tuple[float, float] | None = None) -> float:
    """Seconds that a person is shown without points after so many seconds of walking and standing; ``stood`` replaces what was learned."""
    tracker, rng, k = PoissonTracker(TrackerConfig(tracker="poisson_bernoulli")), np.random.default_rng(2), 0
    while k * DT < walks + stands:
        t = min(k * DT, walks)
        tracker.process(cloud(k, 1.5 + 0.8 * t, 0.8 * (k * DT < walks), rng))
        k += 1
    if stood is not None:
        tracker.table.stood = np.array(stood)
    end = k
    while tracker.process(cloud(k, None, 0.0, rng)).people and (k - end) * DT < 60.0:
        k += 1
    return (k - end) * DT


def test_who_vanishes_while_walking_has_stopped_where_radars_do_not_show_who_stands():
    """Where those who stand give points half of the time, a walker is believed for seconds; where always, not for one and a half."""
    assert believed(3.0, 0.0, (5.0, 10.0)) > 4.0
    assert believed(3.0, 0.0, (99.0, 100.0)) < 1.5


def test_who_stands_is_believed_for_less_time_the_surer_the_radar_shows_them():
    """In sight for eight seconds: as long as ever at first and before radars that often show nothing, and shorter where points are sure."""
    usual = believed(3.0, 5.0, (9.0, 10.0))
    assert believed(3.0, 5.0, (50.0, 100.0)) == pytest.approx(usual, rel=0.1)
    sure = believed(3.0, 5.0, (999.0, 1000.0))
    assert 2.0 < sure < 0.6 * usual


def test_the_share_is_learned_from_who_stands():
    """Ten seconds of standing with points raise it; a walker changes nothing; `reset` forgets it."""
    tracker, rng = PoissonTracker(TrackerConfig(tracker="poisson_bernoulli")), np.random.default_rng(2)
    for k in range(60):
        tracker.process(cloud(k, 1.5 + 0.04 * k, 0.8, rng))
    np.testing.assert_allclose(tracker.table.stood, (9.0, 10.0), atol=0.5)
    for k in range(60, 280):
        tracker.process(cloud(k, 3.9, 0.0, rng))
    assert tracker.table.stood[0] / tracker.table.stood[1] > 0.94
    assert tracker.table.stood[1] == pytest.approx(20.0, abs=1.5)
    tracker.reset()
    np.testing.assert_array_equal(tracker.table.stood, (9.0, 10.0))
