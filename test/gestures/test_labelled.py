"""Recordings with labels: cut where the labels say, read as simulated samples are, and mistakes named with their line."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from small_sets import contents, stroke_clouds

from radar_core import GESTURES, ConfigError, DataError, Pose, RadarInfo
from radar_gestures.events import EventConfig
from radar_gestures.stage import GestureConfig
from radar_lab.datasets import labelled, readings
from radar_lab.datasets.labelled import Moment, import_labelled, read_labels
from radar_lab.datasets.samples import read_samples
from radar_lab.evaluation.scoring import TruthSegment

S = 10**9
PUSH = GESTURES.index("push")
LABEL = TruthSegment(4, PUSH, 1_600_000_000, 2_100_000_000)
"""Of `stroke_clouds`."""


def long_recording(places=None):
    """Three strokes, four seconds apart, approaching, receding, approaching; clouds all along."""
    moments = []
    for k, speed in enumerate((-1.5, 1.5, -1.5)):
        for cloud in stroke_clouds(speed=speed, end=4.0):
            moved = dataclasses.replace(cloud, stamp_ns=cloud.stamp_ns + 4 * k * S, sequence=200 * k + cloud.sequence)
            moments.append(Moment(moved, places={} if places is None else places))
    return moments


LABELS = [
    dataclasses.replace(LABEL, label=1 + (k + 1) % 2, start_ns=LABEL.start_ns + 4 * k * S, end_ns=LABEL.end_ns + 4 * k * S)
    for k in range(3)
]


def test_labels_are_read(tmp_path):
    """Seconds from the first stamp, columns in any order, sorted by start; spaces and a byte-order mark do no harm."""
    path = tmp_path / "labels.csv"
    path.write_text("﻿person, gesture, start, end\n2, pull, 4.25, 5\n1, push, 0.5, 1.5\n", encoding="utf-8")
    assert read_labels(path, 10 * S) == (
        TruthSegment(1, PUSH, 10 * S + S // 2, 11 * S + S // 2),
        TruthSegment(2, GESTURES.index("pull"), 10 * S + 17 * S // 4, 15 * S),
    )


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", r"labels\.csv:1: the first line has to name the columns start,end,gesture,person; it lacks start, end, gesture, person"),
        ("start,end,gesture\n", "it lacks person"),
        ("start,end,gesture,person\n1,2,push,1\n3,4,pusch,1\n", r"labels\.csv:3: gesture is 'pusch' \(did you mean 'push'\?\)"),
        ("start,end,gesture,person\n2,1,push,1\n", r"labels\.csv:2: start is 2 and end 1"),
        ("start,end,gesture,person\n-1,1,push,1\n", "seconds of the recording"),
        ("start,end,gesture,person\nsoon,1,push,1\n", "start is 'soon', which is no number"),
        ("start,end,gesture,person\nnan,1,push,1\n", "start is 'nan'"),
        ("start,end,gesture,person\n0,1,push,1.5\n", r"person is 1\.5; give a whole number"),
        ("start,end,gesture,person\n0,1\n", "person is None"),
    ],
)
def test_mistakes_in_labels_are_named(tmp_path, text, words):
    path = tmp_path / "labels.csv"
    path.write_text(text)
    with pytest.raises(DataError, match=words):
        read_labels(path, 0)
    with pytest.raises(DataError, match="cannot be read"):
        read_labels(tmp_path / "none.csv", 0)


@pytest.mark.long
def test_a_recording_becomes_samples(tmp_path):
    """Each stroke in a file with a second before and after; the event is found, and reading again gives the same."""
    report = import_labelled(tmp_path, RadarInfo(), long_recording(), LABELS, source="room")
    assert report == labelled.ImportReport(n_written=3, n_known=0, n_found=3, n_outside=0)
    samples = list(read_samples(tmp_path))
    assert [str(sample["gesture"]) for sample in samples] == ["push", "pull", "push"]
    for number, (sample, label) in enumerate(zip(samples, LABELS, strict=True)):
        assert (int(sample["number"]), int(sample["subject"])) == (number, 4)
        assert sample["stamp_ns"][0] == max(label.start_ns - S, S)  # the recording begins at 1 s
        assert sample["stamp_ns"][-1] == label.end_ns + S
        assert np.abs(sample["event_ns"] - sample["stroke_ns"]).max() <= 20_000_000
        assert str(sample["scene"]) == ""
        for name, value in readings.read(sample).columns.items():
            np.testing.assert_array_equal(value, sample[name], err_msg=name)
    read = readings.collect(tmp_path)
    assert read.label.tolist() == [PUSH, GESTURES.index("pull"), PUSH]
    assert read.person.tolist() == [4, 4, 4]


@pytest.mark.long
def test_importing_again_adds_nothing_and_another_recording_goes_on(tmp_path):
    import_labelled(tmp_path, RadarInfo(), long_recording(), LABELS[:2], source="room")
    before = contents(tmp_path)
    again = import_labelled(tmp_path, RadarInfo(), long_recording(), LABELS, source="room")
    assert (again.n_written, again.n_known) == (1, 2)
    assert {name: data for name, data in contents(tmp_path).items() if name in before} == before
    other = import_labelled(tmp_path, RadarInfo(), long_recording(), LABELS[:1], source="kitchen")
    assert other.n_written == 1
    assert [int(sample["number"]) for sample in read_samples(tmp_path)] == [0, 1, 2, 3]
    for more in ({"info": RadarInfo(mount=Pose(z=1.0))}, {"config": GestureConfig(events=EventConfig(threshold=1.0))}, {"one_tx": True}):
        given = {"info": RadarInfo()} | more
        with pytest.raises(ConfigError, match="other settings"):
            import_labelled(tmp_path, given.pop("info"), long_recording(), LABELS[:1], source="hall", **given)


def test_labels_outside_of_the_recording_are_counted(tmp_path):
    """Before it, after it, and between two of its clouds."""
    outside = [dataclasses.replace(LABEL, start_ns=start, end_ns=start + 5_000_000) for start in (0, 100 * S, S + 5_000_000)]
    report = import_labelled(tmp_path, RadarInfo(), long_recording(), [*outside, LABEL], source="room")
    assert (report.n_written, report.n_outside) == (1, 3)


@pytest.mark.long
def test_the_truth_of_a_recording_says_where_people_are(tmp_path):
    """The person is at the track: found; 1.5 m beside it: somebody else's event."""
    for name, y, found in (("here", 0.0, 3), ("beside", 1.5, 0)):
        moments = long_recording({4: np.array([2.0, y, 1.2])})
        report = import_labelled(tmp_path / name, RadarInfo(), moments, LABELS, source="room")
        assert (report.n_written, report.n_found) == (3, found)
        sample = next(iter(read_samples(tmp_path / name)))
        np.testing.assert_array_equal(sample["position"], np.tile([2.0, y, 1.2], (len(sample["stamp_ns"]), 1)))


def test_levelled_clouds_give_the_same_sample(tmp_path):
    """Clouds that the recording holds in the room are stored in the sensor frame, to the rounding of float32 at 3 m."""
    info = RadarInfo(mount=Pose(z=1.2, yaw=0.2, tilt=-0.1))
    sensor, room = tmp_path / "sensor", tmp_path / "room"
    import_labelled(sensor, info, map(Moment, stroke_clouds()), [LABEL], source="x")
    import_labelled(room, info, (Moment(cloud.to_room(info.mount)) for cloud in stroke_clouds()), [LABEL], source="x")
    one, two = (next(iter(read_samples(folder))) for folder in (sensor, room))
    for axis in "xyz":
        np.testing.assert_allclose(two[f"cloud_{axis}"], one[f"cloud_{axis}"], atol=1e-6)
    np.testing.assert_allclose(two["features"], one["features"], atol=1e-4)


def test_overlapping_labels_share_their_clouds():
    """Two people at once: each label gets all the clouds about it, whoever's."""
    second = dataclasses.replace(LABEL, person_id=5, start_ns=LABEL.start_ns + S // 5, end_ns=LABEL.end_ns + S // 5)
    cuts = dict(labelled.cut_out(long_recording(), [second, LABEL]))
    for label, cut in cuts.items():
        stamps = [moment.cloud.stamp_ns for moment in cut]
        assert stamps == list(range(max(label.start_ns - S, S), label.end_ns + S + 1, 20_000_000))


def test_what_cannot_be_imported_is_said(tmp_path):
    with pytest.raises(ConfigError, match="there is no label"):
        import_labelled(tmp_path / "new", RadarInfo(), long_recording(), [], source="room")
    assert not (tmp_path / "new").exists()
    with pytest.raises(DataError, match="older than the one before"):
        import_labelled(tmp_path, RadarInfo(), reversed(long_recording()), LABELS, source="room")
    with pytest.raises(DataError, match="have no cloud of one transmitter"):
        import_labelled(tmp_path / "one", RadarInfo(), long_recording(), LABELS, source="room", one_tx=True)
