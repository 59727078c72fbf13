"""Persons by how they look: features are what their definition says, and tell a walker from what creeps."""

import math

import numpy as np
import pytest

from radar_core import PointCloud
from radar_tracking import TrackerConfig
from radar_tracking.poisson.person import FEATURES, features, person_odds
from radar_tracking.poisson.table import N_STATES, RECORD, Table
from radar_tracking.poisson.tracker import PoissonTracker


def followed(place, speed, seconds: float = 8.0) -> Table:
    """The table after clouds of 8 points each 50 ms about ``place(t)``, shape (3,), with range rates ``speed(t, rng)``, shape (8,)."""
    tracker, rng = PoissonTracker(TrackerConfig(tracker="poisson_bernoulli")), np.random.default_rng(3)
    for k in range(round(seconds / 0.05)):
        t = 0.05 * k
        points = place(t) + rng.normal(0, [0.08, 0.08, 0.15], (8, 3))
        columns = {"radial_speed": speed(t, rng).astype(np.float32), "snr": np.full(8, 15.0, np.float32)}
        tracker.process(PointCloud(k * 50_000_000, k, "room", *points.astype(np.float32).T.copy(), **columns))
    return tracker.table


def test_features_are_their_definition():
    """One track of 4 points at 12 dB, of which one is fast, 1 m high on average and 0.6 m tall, 1.5 m from its birthplace."""
    table, row = Table(), np.zeros(1, RECORD)
    row["look"] = [4.0, 48.0, 1.0, 4.0, 4.0, 4.0 * (1.0 + 0.36)]
    row["behind"], row["alone"], row["hits"], row["moved"], row["birthplace"], row["haunt"] = True, 0.6, 0.5, 4.0, (1.5, 0.0), (3.0, 0.0)
    table.add(row, np.array([3.0, 0, 0, 0, 0, 0, 0]), np.eye(N_STATES))
    expected = {
        "points": math.log(4.1), "snr": 12.0, "height": 0.0, "tall": 0.1, "fast": 0.2, "behind": 1.0, "same": 0.0,
        "alone": math.log(2.0), "hits": 0.0, "went": 1.5, "stuck": 1.5,
    }  # fmt: skip
    assert dict(zip(FEATURES, features(table)[0].tolist(), strict=True)) == pytest.approx(expected)


def test_what_creeps_on_the_floor_looks_less_like_a_person():
    """Of the same points and strength: somebody who walks to and fro is clearly a person, a thing on the floor by at least 2 nat less."""
    walker = followed(lambda t: np.array([3.0 - np.cos(t), 0.0, 1.0]), lambda t, rng: np.sin(t) + rng.normal(0, 0.2, 8))
    creeps = followed(lambda t: np.array([2.0 + 0.3 * t, 0.0, 0.05]), lambda t, rng: 0.3 + rng.normal(0, 0.02, 8))
    assert walker.rows["confirmed"].sum() == 1
    assert person_odds(walker)[0] > 2.0
    assert person_odds(creeps).max() < person_odds(walker)[0] - 2.0
    assert features(walker)[0][FEATURES.index("stuck")] == 0.0
