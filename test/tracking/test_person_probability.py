"""The probability that a track is a person, as tracks have it."""

import numpy as np
import pytest
from blobs import Blobs, Person, walking

from radar_core import RadarInfo
from radar_tracking import PeopleTracker, TrackerConfig, TrackStatus
from radar_tracking.poisson.tracker import PoissonTracker, _probability


def test_who_walks_is_likely_a_person_and_the_default_tracker_does_not_say():
    """A walker's clouds: confirmed tracks are rather people than not, every probability is the sigmoid of the table's log odds."""
    blobs = Blobs([Person(walking((2.0, -1.0), (3.0, 1.0), 1.0))])
    tracker = PoissonTracker(TrackerConfig(tracker="poisson_bernoulli"), RadarInfo())
    other = PeopleTracker(TrackerConfig(tracker="group_clustering"), RadarInfo())
    for number in range(100):
        cloud = blobs.cloud(number)
        tracks, silent = tracker.process(cloud), other.process(cloud)
    told = [track.person for track in tracks.tracks]
    np.testing.assert_allclose(told, 1.0 / (1.0 + np.exp(-tracker.table.rows["person"])), atol=1e-12)
    confirmed = [track.person for track in tracks.tracks if track.status is not TrackStatus.TENTATIVE]
    assert confirmed
    assert min(confirmed) > 0.25
    assert all(np.isnan(track.person) for track in silent.tracks)
    assert silent.tracks


@pytest.mark.parametrize("odds", [-1e9, -30.0, 0.0, 30.0, 1e9])
def test_odds_of_any_size(odds):
    """Neither overflow nor certainty."""
    assert 0.0 < _probability(odds) < 1.0
    assert _probability(odds) + _probability(-odds) == pytest.approx(1.0)
