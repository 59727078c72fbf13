"""Track statistics: the compiled loops equal their oracles in numpy, and an example by hand."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from oracles import tracking as oracle

from radar_tracking.people.track_table import RECORD, TorsoPoints, match, update_extents, update_torsos

SEEDS = st.integers(0, 2**32 - 1)
NUMBERS = ("surface", "doppler_residual", "range", "rate", "power", "activity")


def records_of(rng: np.random.Generator, n: int) -> np.ndarray:
    """Tracks with random statistics; the extent of some is not known."""
    records = np.zeros(n, RECORD)
    for name in (*NUMBERS, "spread", "dispersion"):
        records[name] = rng.normal(0.0, 0.2, records[name].shape)
    records["spread"][rng.random((n, 3)) < 0.2] = np.nan
    return records


def some_missing(rng: np.random.Generator, value: np.ndarray) -> np.ndarray:
    """Of every second case none, else many were not measured."""
    return np.where(rng.random(value.shape) < rng.choice([0.0, 0.7]), np.nan, value)


def equal(found: np.ndarray, expected: np.ndarray) -> None:
    """Whether two track tables are the same but for rounding."""
    for name in RECORD.names:
        np.testing.assert_allclose(found[name], expected[name], rtol=1e-12, atol=1e-14, err_msg=name)


def test_match():
    """Points 1, 3 and 4 update tracks 0 and 3; the others are nobody's."""
    matched = match(np.array([-1, 3, -1, 0, 3]), 5)
    found = [array.tolist() for array in (matched.rows, matched.own, matched.row, matched.group)]
    assert found == [[0, 3], [1, 3, 4], [3, 0, 3], [1, 0, 1]]
    assert len(match(np.full(3, -1), 2).own) == 0


@settings(max_examples=60, deadline=None)
@given(seed=SEEDS, n_tracks=st.integers(1, 8), n_points=st.integers(1, 60))
def test_torsos(seed, n_tracks, n_points):
    """Of tracks with points and of those without, with and without Doppler and power."""
    rng = np.random.default_rng(seed)
    matched = match(rng.integers(-1, n_tracks, n_points), n_tracks)
    n = len(matched.own)
    speed = some_missing(rng, rng.normal(0.0, 0.2, n))
    power = some_missing(rng, 10 ** rng.uniform(0, 3, n))
    seen = TorsoPoints(rng.uniform(1e-3, 1.0, n), rng.normal(0, 0.2, n), speed - rng.normal(), speed, rng.uniform(0.3, 9.0, n), power)
    keep, keep_activity = rng.random((2, len(matched.rows)))
    first = records_of(rng, n_tracks)
    second = first.copy()
    for update, records in ((update_torsos, first), (oracle.update_torsos, second)):
        update(records, matched.rows, matched.group, seen, keep, keep_activity, 0.1, -0.4, 0.05)
    equal(first, second)


@settings(max_examples=60, deadline=None)
@given(seed=SEEDS, n_tracks=st.integers(1, 8), n_points=st.integers(0, 60))
def test_extents(seed, n_tracks, n_points):
    """Of tracks with points and of those without, with and without heights."""
    rng = np.random.default_rng(seed)
    row, step = rng.integers(0, n_tracks, n_points), rng.normal(0, 0.3, (n_points, 3))
    step[:, 2] = some_missing(rng, step[:, 2])
    first = records_of(rng, n_tracks)
    second, keep = first.copy(), rng.random(n_tracks)
    update_extents(first, row, step, keep)
    oracle.update_extents(second, row, step, keep)
    equal(first, second)


def test_an_extent_by_hand():
    """Two points, 0.1 m on either side along (1, 1): half of the mean square is taken over, and all of it where nothing was known."""
    records = np.zeros(1, RECORD)
    records["spread"] = 0.0, np.nan, np.nan
    update_extents(records, np.zeros(2, np.int64), np.array([[0.1, 0.1, np.nan], [-0.1, -0.1, np.nan]]), np.array([0.5]))
    assert records["spread"][0] == pytest.approx([0.005, 0.01, np.nan], nan_ok=True)
    np.testing.assert_allclose(records["dispersion"][0], 0.005)
