"""Gestures of real people, where the recordings are there: a small part of them, read, trained on and judged."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks import gestures_real as real
from benchmarks.recordings import folder
from radar_core import DataError
from radar_gestures.curves import CURVE_NAMES, Curves

LIMIT = 900


@pytest.fixture(scope="module")
def some() -> real.RealSet:
    """Read 900 segments of mHomeGes, spread evenly."""
    try:
        folder()
        return real.read("mhomeges", LIMIT)
    except DataError as error:
        pytest.skip(str(error))


@pytest.fixture(scope="module")
def made(some: real.RealSet) -> real.Study:
    """Make its curves."""
    return real.study(some, real.PerceptronTraining(passes=12), n_copies=2)


def test_the_importer_gives_whole_segments(some: real.RealSet) -> None:
    """Ten gestures, many people, a row for each segment; none is longer than what the benchmark keeps, at 0.1 s a frame."""
    assert len(some.events) == len(some.label) == LIMIT
    assert len(some.labels) == 10
    assert len(np.unique(some.person)) >= 15
    assert some.events.duration.max() <= real.LONGEST + 1e-9
    np.testing.assert_allclose(np.diff(some.events.time)[np.diff(some.events.event) == 0], 0.1, atol=1e-9)


def test_people_are_found_where_they_stood(some: real.RealSet) -> None:
    """What is kept of a segment lies near the distance that the data set states: within 0.6 m for nine of ten (arms reach 0.5 m)."""
    event, seen = some.events.event, np.isfinite(some.events.maps[3])
    total = np.bincount(event, np.where(seen, some.events.maps[3], 0.0).sum(axis=1))
    count = np.bincount(event, seen.sum(axis=1))
    mean = total / np.maximum(count, 1)  # a few segments have nothing near where people stood
    assert np.mean(np.abs(mean - some.distance) < 0.6) > 0.9


def test_a_push_approaches_and_a_pull_recedes(some: real.RealSet) -> None:
    """The sign of the range rate is ours: the mean speed while moving differs by more than half a Doppler step."""
    values = Curves().process_many(some.events)
    steps = [k for k, name in enumerate(CURVE_NAMES) if name.startswith("moving_speed_") and "spread" not in name]
    mean = {label: values[some.label == label][:, steps].mean() for label in ("push", "pull")}
    assert mean["pull"] - mean["push"] > 0.18


def test_people_never_seen_are_recognised(made: real.Study) -> None:
    """Two folds of held-out people: far above one in ten, and above the thirteen features, from 1/20 of the data."""
    curves = made.held_out(2).accuracy
    assert curves > 0.6
    assert curves > real.thirteen(made.data, real.PerceptronTraining(passes=12)).held_out(2).accuracy


def test_the_model_keeps_to_its_size(made: real.Study) -> None:
    """At most 200 kB and 1 MFLOP."""
    model = made.fit()
    assert real.model_bytes(model) <= 200_000
    assert model.flop <= 1_000_000
