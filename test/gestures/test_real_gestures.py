"""Gestures of real people, where the recordings are there: a small part of them, read, trained on and judged."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from benchmarks import gesture_studies as real
from benchmarks import gestures_shipped
from benchmarks.gesture_model import model_file
from benchmarks.gestures_people import FEWEST, REACH, accuracy_without, alone, closing_figures, from_the_end, nobody_there
from benchmarks.recordings import folder
from radar_core import DataError
from radar_gestures.curves import CURVE_NAMES, Curves
from radar_lab.training.operations import operations
from radar_lab.training.validation import Validation

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


def test_others_are_in_every_training(made: real.Study) -> None:
    """Without a push in the training no push is named; with those of other people, who are no rows of the set, most are."""
    people = np.unique(made.data.person)
    own, others = (np.isin(made.data.person, part) for part in (people[::2], people[1::2]))
    push = made.data.labels.index("push")
    ours, theirs = (replace(made, data=made.data.select(who), plain=made.plain[who], changed=made.changed[:, who]) for who in (own, others))
    rows = ours.data.number != push
    alone_named = ours.fit(rows).probabilities(ours.plain[~rows]).argmax(axis=-1)
    named = ours.fit(rows, theirs).probabilities(ours.plain[~rows]).argmax(axis=-1)
    assert not (alone_named == push).any()
    assert np.mean(named == push) > 0.5


def test_the_model_keeps_to_its_size(made: real.Study) -> None:
    """At most 200 kB and 1 MFLOP."""
    model = made.fit()
    assert len(model_file(model)) <= 200_000
    assert operations(model) <= 1_000_000


def test_the_last_segment_of_each_recording_is_marked() -> None:
    """Three recordings of 3, 2 and 1 segments: a change of gesture, person or distance ends one; the one before needs two segments."""
    label = np.array(["a", "a", "a", "a", "a", "b"])
    person, distance = np.array([1, 1, 1, 2, 2, 2]), np.ones(6)
    np.testing.assert_array_equal(from_the_end(label, person, distance), [False, False, True, False, True, True])
    np.testing.assert_array_equal(from_the_end(label, person, distance, 1), [False, True, False, True, False, False])
    np.testing.assert_array_equal(from_the_end(label, person, np.arange(6.0)), np.ones(6, bool))
    with pytest.raises(DataError):
        from_the_end(label, person, distance[:2])


def test_accuracy_leaves_out_what_is_marked() -> None:
    """Of four samples three are tested: right, right, wrong; without the wrong one all are right, without a right one half are."""
    probabilities = np.array([[0.9, 0.1], [0.2, 0.8], [0.7, 0.3]])
    found = Validation("subjects", ("a", "b"), probabilities, np.array([0, 1, 1]), np.array([1, 2, 2]), 2)
    folds = [np.array([True, False, False, False]), np.array([False, False, True, True])]
    assert accuracy_without(found, folds, np.array([False, False, False, True])) == 1.0
    assert accuracy_without(found, folds, np.array([True, True, False, False])) == 0.5


def test_segments_alone_tell_what_they_hold() -> None:
    """Vectors with the label in them are recognised for other people, vectors of noise at chance: one in four +- 3 sigma of 240 draws."""
    rng = np.random.default_rng(3)
    number, person = np.tile(np.arange(4), 60), np.repeat(np.arange(4), 60)
    noise = rng.standard_normal((240, 12)).astype(np.float32)
    chosen = np.ones(240, bool)
    assert (
        abs(alone(noise, number, person, chosen) - 0.25) < 3 * np.sqrt(0.25 * 0.75 / 240) + 0.02
    )  # folds of one data set are not independent
    noise[:, :6] += 8 * number[:, None]
    assert alone(noise, number, person, chosen) > 0.97


def test_a_segment_in_which_nobody_is_there_is_marked(tmp_path: Path) -> None:
    """Of four segments with the person at 2 m: enough detections there; one too few; many beyond a wall; none at all."""
    near, far = [0, 2_000 - int(900 * REACH), 0], [0, 8_000, 0]
    xyz = np.array([near] * FEWEST + [near] * (FEWEST - 1) + [far] * 50, np.int16)
    offset = np.array([0, FEWEST, 2 * FEWEST - 1, len(xyz), len(xyz)], np.uint32)
    np.savez(tmp_path / "segments.npz", xyz_mm=xyz, offset=offset, distance_m=np.full(4, 2.0, np.float32))
    np.testing.assert_array_equal(nobody_there(tmp_path / "segments.npz"), [False, True, True, True])


@pytest.mark.long
def test_the_ceiling_is_what_segments_without_a_gesture_leave() -> None:
    """A fifth of the segments are noise, half of them the last ones: the ceiling is 0.8 and what guessing one in four adds."""
    rng = np.random.default_rng(4)
    number, person, place = np.tile(np.arange(4), 150), np.repeat(np.arange(6), 100), np.arange(600) % 10
    vectors = rng.standard_normal((600, 12)).astype(np.float32)
    vectors[place > 1, :6] += 8 * number[place > 1, None]
    found = closing_figures(vectors, number, person, place == 0, place == 1, place == 5)
    assert found["closing_share"] == found["nobody_share"] == pytest.approx(0.1)
    assert found["others_alone"] == 1.0
    assert found["without_alone"] < 0.4  # one in four +- four sigma of 120 draws
    assert found["ceiling"] == pytest.approx(0.8 + 0.2 * found["without_alone"])


@pytest.mark.long
@pytest.mark.parametrize("kind", ["mhomeges", "mtranssee"])
def test_recordings_end_with_a_walk_to_the_radar(kind: str) -> None:
    """From the first to the last third of its points a closing segment comes nearer by decimetres in the median, all others stay."""
    try:
        path = folder() / kind / "segments.npz"
    except DataError as error:
        pytest.skip(str(error))
    with np.load(path) as file:
        data = {name: file[name] for name in ("label", "subject", "distance_m", "offset", "xyz_mm")}
    last = from_the_end(data["label"], data["subject"], data["distance_m"])
    distance = np.linalg.norm(data["xyz_mm"] * 1e-3, axis=1)
    moved = np.full(len(last), np.nan)
    for k in range(len(last)):
        own = distance[data["offset"][k] : data["offset"][k + 1]]
        own = own[(own > 0.3) & (own < 6.0)]  # what is farther came over a wall
        if len(own) >= 12 and (last[k] or k % 10 == 0):
            third = len(own) // 3
            moved[k] = np.median(own[-third:]) - np.median(own[:third])
    assert np.nanmedian(moved[last]) < -0.3
    assert abs(np.nanmedian(moved[~last])) < 0.05


@pytest.mark.long
def test_the_shipped_model_before_real_people_is_counted(some: real.RealSet) -> None:
    """Every gesture that we know is right, another, or missed; a minute of each stream gives rates that are finite."""
    found = gestures_shipped.segments("mhomeges", 12)
    assert found["segments"] == 10  # two of each of five people whom no shipped model learned from
    assert found["right"] + found["other"] + found["missed"] == found["known"] > 0
    assert 0.0 <= found["with_event"] <= 1.0
    assert found["features_right_share"] + found["features_other_share"] <= 1.0
    rates = gestures_shipped.daily(100)
    assert rates["features_named_a_minute"] <= rates["features_events_a_minute"] < 60
    assert rates["strangers_minutes"] < rates["minutes"]
