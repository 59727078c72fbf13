"""Stored clouds read again: equal to what simulation found, and what settings, frame rates and transmitters change."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from small_sets import INFO, PLAN, make, stroke_clouds

from radar_core import GESTURES, ConfigError, DataError, RadarInfo
from radar_gestures.events import EventConfig
from radar_gestures.features import FEATURE_NAMES, FeatureConfig
from radar_gestures.stage import GestureConfig
from radar_lab.datasets import readings, synthesis
from radar_lab.datasets.samples import SampleSet, pack_clouds, read_samples, unpack_clouds
from radar_lab.evaluation.scoring import TruthSegment
from radar_lab.training.encoder import EncoderConfig

N = 6
PUSH = GESTURES.index("push")
STROKE = TruthSegment(4, PUSH, 1_600_000_000, 2_100_000_000)
"""Of `stroke_clouds`."""


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    place = tmp_path_factory.mktemp("set")
    make(place, N, one_tx=True, plan=dataclasses.replace(PLAN, n_subjects=2))
    return place


def path_length(reading):
    """Features of our own for `collect`: how many clouds, and the sum of speeds."""
    return np.array([len(reading.clouds), sum(abs(one.speed) for one in reading.samples)])


def test_clouds_come_back_as_they_were():
    """Every kept field bit by bit; what is not kept is NaN."""
    clouds = stroke_clouds()
    sample = {"stamp_ns": np.array([c.stamp_ns for c in clouds]), "radar": np.array("{}"), "number": np.array(0), **pack_clouds(clouds)}
    for given, got in zip(clouds, unpack_clouds(sample), strict=True):
        assert (got.stamp_ns, got.frame_id, len(got)) == (given.stamp_ns, "radar", len(given))
        for name in ("x", "y", "z", "range", "azimuth", "elevation", "radial_speed", "snr", "azimuth_std"):
            np.testing.assert_array_equal(getattr(got, name), getattr(given, name))
        assert np.isnan(got.noise).all()
    with pytest.raises(DataError, match="generate with --one-tx"):
        unpack_clouds(sample, "one")


@pytest.mark.long
def test_reading_again_gives_what_simulation_found(folder):
    """Features, event and walked way are those in the files; `collect` gives them in order."""
    samples = list(read_samples(folder))
    for sample in samples:
        for name, value in readings.read(sample).columns.items():
            np.testing.assert_array_equal(value, sample[name], err_msg=name)
    again, stored = readings.collect(folder), synthesis.feature_samples(folder)
    for name in ("features", "label", "person", "walked", "missed"):
        np.testing.assert_array_equal(getattr(again, name), getattr(stored, name), err_msg=name)
    assert again.config == stored.config
    assert set(again.person.tolist()) == {0, 1}
    assert len(again.label) + again.missed.sum() == N


def test_an_event_is_found_with_its_times_and_signals():
    """An arm that moves at -1.5 m/s and more from 0.6 to 1.1 s: the event is that, within a frame; the maximum speed is the fastest's."""
    reading = readings.read_stroke(RadarInfo(), stroke_clouds(), np.tile([2.0, 0.0, 1.2], (90, 1)), STROKE, GestureConfig(), padded=False)
    assert reading.event is not None
    assert abs(reading.event.event.start_ns - STROKE.start_ns) <= 20_000_000
    assert abs(reading.event.event.end_ns - STROKE.end_ns) <= 20_000_000
    assert (reading.gesture, reading.person) == ("push", 4)
    assert reading.features[FEATURE_NAMES.index("min_speed")] == pytest.approx(-1.5, abs=0.01)
    # 25 frames with motion, and 0.1 s of margin on each side.
    assert len(reading.clouds) == len(reading.samples) == 35
    assert sum(one.speed < 0 for one in reading.samples) == 25


@pytest.mark.parametrize("every", [1, 2, 3, 5])
def test_frame_rates_change_the_event_by_a_frame_at_most(every):
    """50, 25, 17 and 10 Hz."""
    clouds = stroke_clouds()[::every]
    reading = readings.read_stroke(RadarInfo(), clouds, np.tile([2.0, 0.0, 1.2], (len(clouds), 1)), STROKE, GestureConfig(), padded=False)
    assert reading.event is not None
    assert abs(reading.event.event.start_ns - STROKE.start_ns) <= every * 20_000_000
    assert abs(reading.event.event.end_ns - STROKE.end_ns) <= every * 20_000_000


def test_clouds_of_the_stroke_alone_are_continued_at_rest():
    """Cut to the stroke and 0.2 s about it, nothing is found unless there is time for a track to settle and the event to end."""
    clouds = [c for c in stroke_clouds() if STROKE.start_ns - 2e8 <= c.stamp_ns <= STROKE.end_ns + 2e8]
    places = np.tile([2.0, 0.0, 1.2], (len(clouds), 1))
    assert readings.read_stroke(RadarInfo(), clouds, places, STROKE, GestureConfig(), padded=False).event is None
    padded = readings.read_stroke(RadarInfo(), clouds, places, STROKE, GestureConfig())
    whole = readings.read_stroke(RadarInfo(), stroke_clouds(), np.tile([2.0, 0.0, 1.2], (90, 1)), STROKE, GestureConfig(), padded=False)
    assert padded.event is not None
    assert dataclasses.replace(padded.event.event, rested_ns=0) == dataclasses.replace(whole.event.event, rested_ns=0)


def test_an_event_of_somebody_else_is_not_the_gesture():
    """The person stands 1.5 m beside the track: missed; where nobody knows where they are, it counts."""
    for place, found in (([2.0, 1.5, 1.2], False), ([np.nan] * 3, True)):
        reading = readings.read_stroke(RadarInfo(), stroke_clouds(), np.tile(place, (90, 1)), STROKE, GestureConfig(), padded=False)
        assert (reading.event is not None) == found
        assert np.isfinite(reading.features).all() == found
    late = dataclasses.replace(STROKE, start_ns=STROKE.end_ns + 10**9, end_ns=STROKE.end_ns + 2 * 10**9)
    elsewhere = readings.read_stroke(RadarInfo(), stroke_clouds(), np.tile([2.0, 0.0, 1.2], (90, 1)), late, GestureConfig(), padded=False)
    assert elsewhere.event is None
    assert elsewhere.clouds == elsewhere.samples == ()


@pytest.mark.long
def test_settings_frame_rate_and_transmitters_without_simulating_again(folder):
    """A threshold that no hand reaches misses all; half the frames and one transmitter find about as much, with other features."""
    none = readings.collect(folder, GestureConfig(events=EventConfig(threshold=15.0)))
    assert len(none.label) == 0
    assert none.features.shape == (0, 13)
    assert none.missed.sum() == N
    full = readings.collect(folder)
    for more in ({"every": 2}, {"one_tx": True}, {"config": GestureConfig(features=FeatureConfig(angles="sensor"))}):
        other = readings.collect(folder, **more)
        assert len(other.label) >= N - 3
        assert not np.array_equal(other.features, full.features)
    with pytest.raises(ConfigError, match="every is 0"):
        readings.collect(folder, every=0)


def test_other_features_have_names_of_their_own(folder):
    full, own = readings.collect(folder), readings.collect(folder, vector=path_length, names=("n_clouds", "path"))
    assert own.n_features == 2
    assert own.names == ("n_clouds", "path")
    np.testing.assert_array_equal(own.label, full.label)
    assert (own.features > 0).all()
    with pytest.raises(DataError, match="1 names, but features"):
        SampleSet(own.features, own.label, own.person, own.walked, own.missed, {}, names=("path",))


@pytest.mark.long
def test_processes_change_nothing(folder):
    one, two = readings.collect(folder), readings.collect(folder, n_jobs=2)
    np.testing.assert_array_equal(one.features, two.features)
    np.testing.assert_array_equal(one.label, two.label)


@pytest.mark.long
def test_cubes_of_a_data_set_have_labels_and_people(folder):
    found, full = readings.cubes(folder), readings.collect(folder)
    assert found.cube.shape == (len(full.label), 5, 50, 50)
    assert found.cube.dtype == np.float32
    np.testing.assert_array_equal(found.label, full.label)
    np.testing.assert_array_equal(found.person, full.person)
    small = readings.cubes(folder, encoder=EncoderConfig(n_detections=3, n_frames=10, relative=True))
    assert small.cube.shape == (len(full.label), 5, 3, 10)
    # The hand is within an arm of the body, all 2 to 3 m away from the radar.
    assert np.abs(small.cube[:, 1]).max() < 1.2 < 1.5 < found.cube[:, 1].max()
    snr = found.cube[:, 0]
    assert (np.diff(snr, axis=1) <= 0).all()  # strongest first, every frame
    approaching = np.array([np.abs(c[2][c[2] < -0.6]).sum() > np.abs(c[2][c[2] > 0.6]).sum() for c in found.cube])
    np.testing.assert_array_equal(approaching, found.label == PUSH)


@pytest.mark.long
def test_maps_of_a_data_set_show_where_the_hand_goes(folder):
    """As many as cubes, of the same samples; a push is on the side of negative range rates; directions stand where something is."""
    found, cubes = readings.network_maps(folder), readings.cubes(folder)
    assert found.cube.shape == (len(cubes.label), 3, 65, 50)
    assert found.cube.dtype == np.float32
    for name in ("label", "person", "missed"):
        np.testing.assert_array_equal(getattr(found, name), getattr(cubes, name))
    snr, speed = found.cube[:, 0], (np.arange(65) - 32) * 0.13
    np.testing.assert_array_equal(snr.max(axis=1), cubes.cube[:, 0].max(axis=1))  # the strongest of a frame is in both
    approaching = snr[:, speed < -0.6].sum(axis=(1, 2)) > snr[:, speed > 0.6].sum(axis=(1, 2))
    np.testing.assert_array_equal(approaching, found.label == PUSH)
    assert not found.cube[:, 1:][np.repeat((snr == 0)[:, None], 2, axis=1)].any()
    assert np.abs(found.cube[:, 1:]).max() < np.pi / 2
    wide = GestureConfig(features=FeatureConfig(gate=0.26))
    assert readings.network_maps(folder, wide, encoder=EncoderConfig(n_frames=10)).cube.shape[2:] == (33, 10)


def test_one_transmitter_is_described(folder):
    """The radar of the second set of clouds has half the channels, and the same speeds and times."""
    sample = next(iter(read_samples(folder)))
    one = readings.info_of(sample, "one")
    assert readings.info_of(sample) == INFO
    assert (one.waveform.n_tx, one.array.n_tx) == (1, 1)
    assert one.waveform.max_speed == pytest.approx(INFO.waveform.max_speed)
    assert one.waveform.acquisition_ns == INFO.waveform.acquisition_ns
