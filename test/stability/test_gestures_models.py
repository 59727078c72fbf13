"""Hard cases of classifiers: nothing detected, huge and unknown numbers, few samples, constant features, one label always, sure nets."""

from __future__ import annotations

import math

import numpy as np
import pytest

from radar_core import ConfigError, DataError, PointCloud
from radar_gestures.classifiers.perceptron import GestureModel
from radar_lab.datasets.samples import SampleSet
from radar_lab.training.calibration import calibration_error, choose_reject, fit_distance, fit_temperature, soften
from radar_lab.training.encoder import EncoderConfig, encode
from radar_lab.training.training import TrainingConfig, train_on

BRIEF = TrainingConfig(hidden=(4,), max_iterations=20, folds=2)


def cloud(stamp_ns, n, **fields):
    zero = np.zeros(n, np.float32)
    return PointCloud(stamp_ns, 0, "radar", zero, zero, zero, **{name: np.full(n, value, np.float32) for name, value in fields.items()})


def samples(features, label, person=None):
    n = len(label)
    person = np.arange(n) % 4 if person is None else person
    names = tuple(f"f{i}" for i in range(features.shape[1]))
    return SampleSet(features, label, person, np.zeros(n), np.zeros(10, np.int64), {}, names=names)


@pytest.mark.parametrize("clouds", [[], [cloud(0, 0)], [cloud(i, 0) for i in range(5)]])
def test_nothing_detected_gives_an_empty_cube(clouds):
    assert not encode(clouds, EncoderConfig()).any()


@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf, 3e38])
@pytest.mark.parametrize("name", ["snr", "range", "radial_speed", "azimuth", "elevation"])
def test_a_cube_is_finite_whatever_a_point_holds(name, value):
    fields = {"snr": 20.0, "range": 2.0, "radial_speed": 1.0, "azimuth": 0.0, "elevation": 0.0} | {name: value}
    cube = encode([cloud(0, 3, **fields)], EncoderConfig())
    assert np.isfinite(cube).all()
    assert np.abs(cube).max() <= 1000.0


def test_what_the_sensor_does_not_measure_is_zero():
    cube = encode([cloud(0, 2, snr=10.0, range=2.0, radial_speed=1.0, azimuth=0.1)], EncoderConfig())
    assert not cube[4].any()
    assert cube[3, 0, 0] == pytest.approx(0.1)


@pytest.mark.parametrize("step", [1_000_000, 1_000_000_000])
def test_clouds_at_1_khz_and_at_1_hz(step):
    """1 kHz: 20 clouds share a frame and their strongest points fill it. 1 Hz: the cube holds the last second, hence one cloud."""
    clouds = [cloud(1_800_000_000_000_000_000 + i * step, 4, snr=10.0 + i % 7, range=2.0) for i in range(200 if step < 10**8 else 5)]
    cube = encode(clouds, EncoderConfig())
    assert np.isfinite(cube).all()
    assert np.count_nonzero(cube[0].any(axis=0)) == (11 if step < 10**8 else 1)
    assert cube[0].max() <= 16.0


def test_stamps_that_jump_back_or_a_year_ahead_cost_nothing():
    clouds = [cloud(stamp, 2, snr=10.0) for stamp in (10**18, 0, 5, 10**18 + 31_536_000_000_000_000)]
    assert np.count_nonzero(encode(clouds, EncoderConfig())[0]) == 2


def test_many_points_in_one_frame():
    assert np.count_nonzero(encode([cloud(0, 100_000, snr=10.0)], EncoderConfig())[0]) == 50


@pytest.mark.parametrize("value", [1e12, -1e12, 0.0, 1e-300])
def test_the_largest_features_and_weights_give_probabilities(value):
    """Weights at the end of float32, three layers: sums reach 1e160, far from the end of a double."""
    top = np.finfo(np.float32).max
    weights = (np.full((2, 4), top), np.full((4, 4), -top), np.full((4, 3), top))
    model = GestureModel(
        np.zeros(2), np.full(2, 1e-30), weights, (np.zeros(4), np.ones(4), np.arange(3.0)), labels=("a", "b", "c"), names=("x", "y")
    )
    for found in (model.probabilities(np.full(2, value)), model.probabilities_numpy(np.full((5, 2), value))):
        assert np.isfinite(found).all()
        np.testing.assert_allclose(found.sum(axis=-1), 1.0)


def test_no_samples_at_once_give_no_probabilities():
    model = GestureModel(np.zeros(2), np.ones(2), (np.ones((2, 3)),), (np.zeros(3),), labels=("a", "b", "c"), names=("x", "y"))
    assert model.probabilities(np.empty((0, 2))).shape == (0, 3)


def test_constant_features_train():
    rng = np.random.default_rng(0)
    features = np.column_stack([rng.normal(size=80), np.full(80, 7.0), np.zeros(80)])
    report = train_on(samples(features, np.arange(80) % 2), BRIEF, labels=("push", "pull"))
    assert np.isfinite(report.model.probabilities(features)).all()
    assert np.isfinite(report.model.score(features, report.model.probabilities(features))).all()


def test_deviations_of_zero_are_refused_where_they_would_divide():
    """A scale of zero, or none at all: the model says so when it is made, not when it is used."""
    weights, biases = (np.zeros((2, 3)),), (np.zeros(3),)
    for scale in ([1.0, 0.0], [1.0, -1.0], [1.0, math.nan]):
        with pytest.raises(ConfigError, match="scale has"):
            GestureModel(np.zeros(2), np.array(scale), weights, biases, labels=("a", "b", "c"), names=("x", "y"))


def test_huge_and_tiny_scales_of_features_train_alike():
    """Standardisation takes scales away: micrometres and light years give what metres give, to rounding."""
    rng = np.random.default_rng(1)
    label = np.arange(80) % 2
    features = rng.normal(size=(80, 2)) + 3 * label[:, None]
    plain = train_on(samples(features, label), BRIEF, labels=("push", "pull"))
    scaled = train_on(samples(features * [1e-6, 1e9], label), BRIEF, labels=("push", "pull"))
    assert scaled.validation.accuracy == pytest.approx(plain.validation.accuracy, abs=0.03)


def test_two_samples_of_a_label_and_many_of_another_train():
    rng = np.random.default_rng(2)
    label = np.repeat([0, 1], [200, 8])
    features = rng.normal(size=(208, 3)) + 5 * label[:, None]
    report = train_on(samples(features, label, np.arange(208) % 2), BRIEF, labels=("random", "push"))
    assert np.isfinite(report.model.probabilities(features)).all()


def test_one_sample_of_a_label_is_refused_with_its_name():
    label = np.repeat([0, 1], [20, 1])
    with pytest.raises(DataError, match="push"):
        train_on(samples(np.zeros((21, 2)), label), BRIEF, labels=("random", "push"))


def test_features_that_tell_nothing_give_a_limit_all_the_same():
    """Two labels out of the same noise: the limit stays a probability."""
    rng = np.random.default_rng(3)
    report = train_on(samples(rng.normal(size=(40, 2)), np.arange(40) % 2), BRIEF, labels=("push", "pull"))
    assert 0.0 <= report.model.reject <= 1.0


def test_certainty_that_is_wrong_stays_finite():
    """Probability 0 for the truth: the loss is bounded, and the temperature goes to its end."""
    p, label = np.eye(2)[np.zeros(10, np.int64)], np.ones(10, np.int64)
    assert math.isfinite(fit_temperature(p, label))
    assert calibration_error(p, label) == 1.0
    assert np.isfinite(soften(p, 0.05)).all()
    assert choose_reject(np.zeros(10)) == 0.0


def test_scores_far_away_vanish_without_a_warning():
    rng = np.random.default_rng(4)
    rejector = fit_distance(rng.normal(size=(40, 13)), np.arange(40) % 2, 2)
    far = np.full((3, 13), 1e150)
    assert (rejector.score(far, np.eye(2)[[0, 1, 0]], None) == 0.0).all()
    assert rejector.score(np.zeros((0, 13)), np.empty((0, 2)), None).shape == (0,)
