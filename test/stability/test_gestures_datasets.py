"""Hard cases of data sets: nothing there, one frame, unknown angles, huge strengths, very slow and fast clouds, stamps that jump."""

from __future__ import annotations

import dataclasses
import math
import sys
from pathlib import Path

import numpy as np
import pytest

from radar_core import GESTURES, DataError, PointCloud, RadarInfo
from radar_gestures.stage import GestureConfig
from radar_lab.datasets.labelled import Moment, cut_out, import_labelled
from radar_lab.datasets.readings import _surroundings, collect, cubes, maps_of, read, read_stroke
from radar_lab.datasets.samples import SampleSet, pack_clouds, read_samples, unpack_clouds
from radar_lab.evaluation import pictures
from radar_lab.evaluation.comparison import ComparisonConfig, as_text, compare
from radar_lab.evaluation.scoring import TruthSegment
from radar_lab.training.encoder import EncoderConfig, encode

sys.path.insert(0, str(Path(__file__).parents[1] / "gestures"))
from small_sets import random_set, stroke_clouds

STROKE = TruthSegment(4, GESTURES.index("push"), 1_600_000_000, 2_100_000_000)
EMPTY = PointCloud(0, 0, "radar", *np.zeros((3, 0), np.float32))
FAST = ComparisonConfig(max_iterations=5)


def reading(clouds, **more):
    return read_stroke(RadarInfo(), clouds, np.full((len(clouds), 3), np.nan), STROKE, GestureConfig(), **more)


@pytest.mark.parametrize("padded", [False, True])
@pytest.mark.parametrize("n", [0, 1, 40])
def test_empty_clouds_have_no_event(n, padded):
    got = reading([dataclasses.replace(EMPTY, stamp_ns=10**9 + k * 20_000_000) for k in range(n)], padded=padded)
    assert got.event is None
    assert np.isnan(got.features).all()


def test_one_frame_is_no_gesture():
    moving = next(cloud for cloud in stroke_clouds() if len(cloud) == 15)
    for padded in (False, True):
        assert reading([moving], padded=padded).event is None


def test_equal_stamps_are_continued_at_the_radar_s_frame_rate():
    """Clouds that all have one stamp say nothing of the time between them: 0.6 s of clouds before them, 20 ms apart, not millions."""
    still = [dataclasses.replace(cloud.to_room(RadarInfo().mount), stamp_ns=10**9) for cloud in stroke_clouds()[:2]]
    lead, rest = _surroundings(still, STROKE, GestureConfig(), 0.02)
    assert (len(lead), len(rest)) == (31, 14)
    assert np.diff([cloud.stamp_ns for cloud in lead]).tolist() == [20_000_000] * 30


@pytest.mark.parametrize("field", ["azimuth", "elevation", "snr", "azimuth_std", "range"])
def test_what_is_not_measured_leaves_finite_features(field):
    """One of the fields unknown everywhere: the event is found by its speed, its features and cube are finite."""
    clouds = [dataclasses.replace(c, **{field: np.full(len(c), np.nan, np.float32)}) for c in stroke_clouds()]
    got = reading(clouds, padded=False)
    assert got.event is not None
    assert np.isfinite(got.features).all()
    assert np.isfinite(encode(got.clouds, EncoderConfig())).all()


def test_huge_strengths_change_no_event():
    """SNRs of 3,000 dB and of minus that: amplitudes stay finite."""
    for level in (3000.0, -3000.0):
        clouds = [dataclasses.replace(c, snr=np.full(len(c), level, np.float32)) for c in stroke_clouds()]
        got = reading(clouds, padded=False)
        assert np.isfinite(got.features).all() == (level > 0)
        assert np.isfinite(encode(clouds, EncoderConfig())).all()


@pytest.mark.long
@pytest.mark.parametrize("step", [1.0, 0.1, 1e-3])
def test_any_frame_rate_gives_an_answer(step):
    """1 Hz sees at most a cloud of it: no event. 10 Hz and 1 kHz find it."""
    got = reading(stroke_clouds(step=step, end=1.5), padded=step < 0.5)
    assert (got.event is not None) == (step < 0.5)


def test_stamps_that_jump(tmp_path):
    """Forward by an hour: the event before it is found. Back: refused, by cutting out and by tracking."""
    clouds = stroke_clouds(end=2.4)
    later = [dataclasses.replace(c, stamp_ns=c.stamp_ns + 3600 * 10**9) for c in stroke_clouds(end=0.2)]
    assert reading([*clouds, *later], padded=False).event is not None
    assert import_labelled(tmp_path, RadarInfo(), map(Moment, [*clouds, *later]), [STROKE], source="x").n_found == 1
    with pytest.raises(DataError, match="older than the one before"):
        reading([*clouds, *stroke_clouds()], padded=False)
    with pytest.raises(DataError, match="older than the one before"):
        list(cut_out(map(Moment, [*clouds, *stroke_clouds()]), [STROKE]))


def test_a_sample_without_clouds_can_be_read_and_drawn(tmp_path):
    """A label longer than the recording's silence: one empty cloud in it."""
    import_labelled(tmp_path / "set", RadarInfo(), [Moment(dataclasses.replace(EMPTY, stamp_ns=STROKE.start_ns))], [STROKE], source="x")
    sample = next(iter(read_samples(tmp_path / "set")))
    assert len(unpack_clouds(sample)) == 1
    assert read(sample).event is None
    assert maps_of(sample).micro_doppler.shape[0] == 1
    pictures.draw_sample_maps(sample, tmp_path / "x.png")
    assert collect(tmp_path / "set").features.shape == (0, 13)
    assert collect(tmp_path / "set").missed.sum() == 1
    assert cubes(tmp_path / "set").cube.shape == (0, 5, 50, 50)


def test_no_clouds_are_packed_as_none():
    packed = pack_clouds([])
    assert packed["cloud_offset"].tolist() == [0]
    assert all(len(array) == 0 for name, array in packed.items() if name != "cloud_offset")


def constant(value=1.0, n=5, labels=(1, 2)):
    base = random_set(n, labels)
    return dataclasses.replace(base, features=np.full_like(base.features, value))


@pytest.mark.long
def test_constant_features_are_said_not_crashed_on(tmp_path):
    """No distribution to speak of: notes for every feature, no NaN in the text, pictures all the same."""
    a = constant()
    result = compare(a, a, FAST)
    assert np.isnan(result.shapiro).all()
    assert (result.kruskal == 1.0).all()
    assert (result.wilcoxon == 1.0).all()
    assert sum("constant" in note for note in result.notes) == 26 + 26
    assert "nan" not in as_text(result)
    assert len(pictures.draw_comparison(result, a, a, tmp_path)) == 5


@pytest.mark.parametrize("n", [1, 2])
def test_too_few_samples_are_said_not_crashed_on(n, tmp_path):
    a, b = random_set(n, (1, 2), seed=1), random_set(20, (1, 2), seed=2)
    for one, two in ((a, b), (b, a), (a, a)):
        result = compare(one, two, FAST)
        assert np.isnan(result.kruskal).all()
        assert sum("too few" in note for note in result.notes) >= 26
        assert result.transfer is not None
        assert "nan" not in as_text(result)
    pictures.draw_kruskal(compare(a, b, FAST), tmp_path / "kruskal.png")
    pictures.draw_boxes(a, b, 1, tmp_path / "box.png")
    pictures.draw_boxes(a, b, 9, tmp_path / "none.png")


@pytest.mark.parametrize("scale", [1e-150, 1e-9, 1e9, 1e150])
def test_any_unit_gives_the_same_statistics(scale):
    """Ranks do not know units; Shapiro's statistic is scaled before it is taken. The classifier standardises."""
    a, b = random_set(30, (1, 2), seed=1), random_set(30, (1, 2), seed=2)
    given, other = (compare(*(dataclasses.replace(s, features=s.features * k) for s in (a, b)), FAST) for k in (1.0, scale))
    np.testing.assert_allclose(other.kruskal, given.kruskal)
    np.testing.assert_allclose(other.shapiro, given.shapiro, rtol=1e-6)


def test_many_samples_are_thinned_for_shapiro():
    """scipy's p-value is known up to 5,000; more would warn, and warnings are errors here."""
    many = random_set(6000, (1,))
    assert np.isfinite(compare(many, many, FAST).shapiro).all()


def test_an_empty_set_has_nothing_in_common():
    none = SampleSet(np.empty((0, 13)), *np.empty((2, 0), np.int64), np.empty(0), np.zeros(10, np.int64), {})
    for a, b in ((none, none), (none, random_set(3, (1,))), (random_set(3, (1,)), none)):
        with pytest.raises(DataError, match="no gesture in common"):
            compare(a, b)


def test_one_feature_alone_can_be_compared():
    a, b = (
        dataclasses.replace(s, features=s.features[:, :1], names=("only",)) for s in (random_set(9, (1, 2)), random_set(9, (1, 2), seed=3))
    )
    result = compare(a, b, FAST)
    assert result.left_out == ()
    assert result.reduced is None
    assert math.isfinite(result.transfer.accuracy)
