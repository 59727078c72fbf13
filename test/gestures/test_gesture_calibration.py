"""Calibration against known distortions, rejection against known geometry."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from radar_core import ConfigError, DataError
from radar_gestures.classifiers.rejection import ByDistance, ByProbability, make_rejector
from radar_lab.training.calibration import calibration_error, choose_reject, fit_distance, fit_temperature, log_loss, reliability, soften
from radar_lab.training.operations import rejection_operations


def honest(n=20_000, n_labels=5, seed=0):
    """Probabilities, and labels drawn with exactly these."""
    rng = np.random.default_rng(seed)
    p = rng.dirichlet(np.full(n_labels, 0.4), n)
    label = (p.cumsum(axis=1) < rng.random((n, 1))).sum(axis=1)
    return p, np.minimum(label, n_labels - 1)


@pytest.mark.parametrize("distortion", [0.4, 1.0, 2.5])
def test_the_temperature_undoes_a_known_distortion(distortion):
    """Scores multiplied by 1 / T need temperature 1 / T back; 20,000 draws fix it to about 1 %, so 4 % is four deviations."""
    p, label = honest()
    assert fit_temperature(soften(p, distortion), label) == pytest.approx(1 / distortion, rel=0.04)


def test_the_temperature_makes_the_truth_likelier_and_changes_no_label():
    p, label = honest()
    sharp = soften(p, 0.3)
    soft = soften(sharp, fit_temperature(sharp, label))
    assert log_loss(soft, label) < log_loss(sharp, label)
    np.testing.assert_array_equal(soft.argmax(axis=1), p.argmax(axis=1))


def test_honest_probabilities_have_no_calibration_error():
    """About 1,300 samples a bin: each share is off by about 0.5 / sqrt(1300) = 1.4 %, their mean error less; sharpened, it is large."""
    p, label = honest()
    assert calibration_error(p, label) < 0.015
    assert calibration_error(soften(p, 0.3), label) > 0.1


def test_the_calibration_error_of_a_liar_is_its_lie():
    """Always 90 % sure, right half of the time: off by 0.4."""
    p = np.tile([0.9, 0.1], (1000, 1))
    label = np.arange(1000) % 2
    assert calibration_error(p, label) == pytest.approx(0.4)
    confidence, right, share = reliability(p, label)
    assert (confidence, right, share) == (pytest.approx([0.9]), pytest.approx([0.5]), pytest.approx([1.0]))


def test_full_certainty_falls_into_the_last_bin():
    assert calibration_error(np.eye(3), np.arange(3)) == 0.0


def test_nothing_to_calibrate_on_is_refused():
    with pytest.raises(DataError, match="at least one"):
        fit_temperature(np.empty((0, 3)), np.empty(0, np.int64))


@given(st.lists(st.floats(0, 1), min_size=1, max_size=200), st.floats(0, 1))
def test_the_limit_loses_no_more_than_allowed_and_could_not_be_higher(score, lost):
    score = np.array(score)
    limit = choose_reject(score, lost)
    assert np.count_nonzero(score < limit) <= lost * len(score) + 1e-6
    if limit < score.max():
        assert np.count_nonzero(score < np.nextafter(limit, 2)) > lost * len(score) - 1e-6


def test_no_known_gestures_mean_no_limit():
    assert choose_reject(np.empty(0)) == 0.0


def cloud(n=4000, seed=1):
    """Two labels with covariances of their own."""
    rng = np.random.default_rng(seed)
    label = np.arange(n) % 2
    spread = np.array([[1.0, 0.2, 0.5], [0.3, 2.0, 1.0]])
    middle = np.array([[0.0, 0.0, 0.0], [5.0, 0.0, 1.0]])
    return middle[label] + spread[label] * rng.normal(size=(n, 3)), label, middle, spread


def test_the_distance_is_mahalanobis_to_the_most_probable_label():
    """4,000 samples fix mean and covariance to a few per cent; the score at k deviations is p exp(-w k^2)."""
    x, label, middle, spread = cloud()
    rejector = fit_distance(x, label, 2, weight=0.1)
    p = np.array([[0.8, 0.2], [0.1, 0.9]])
    for k in (0.0, 1.0, 3.0):
        at = middle + k * spread * [0.0, 1.0, 0.0]
        np.testing.assert_allclose(rejector.score(at, p, None), [0.8 * np.exp(-0.1 * k**2), 0.9 * np.exp(-0.1 * k**2)], rtol=0.1)


def test_squared_distances_of_a_label_average_to_the_number_of_features():
    """Chi square with 3 degrees of freedom: the mean of 2,000 is 3 +- 0.05; the ridge of 1e-3 on a variance of 0.04 takes 1 %."""
    x, label, _, _ = cloud()
    rejector = fit_distance(x, label, 2, weight=1.0)
    square = -np.log(rejector.score(x, np.eye(2)[label], None))
    for number in (0, 1):
        assert square[label == number].mean() == pytest.approx(3.0, abs=0.2)


def test_one_covariance_for_all_labels_is_their_mean():
    x, label, middle, spread = cloud()
    rejector = fit_distance(x, label, 2, weight=1.0, shared=True)
    assert rejector.factors.shape == (1, 6)
    square = -np.log(rejector.score(middle[:1] + np.eye(3)[:1], np.array([[1.0, 0.0]]), None))
    assert square[0] == pytest.approx(1 / np.mean(spread[:, 0] ** 2), rel=0.1)


def test_single_events_and_many_score_alike():
    x, label, _, _ = cloud(40)
    p = np.random.default_rng(0).dirichlet(np.ones(2), 40)
    for rejector in (fit_distance(x, label, 2), fit_distance(x, label, 2, shared=True), ByProbability()):
        np.testing.assert_allclose(rejector.score(x, p, None), [rejector.score(a, b, None) for a, b in zip(x, p, strict=True)])


def test_random_never_counts_as_the_best_gesture():
    p = np.array([0.7, 0.2, 0.1])
    assert ByProbability().score(np.zeros(3), p, 0) == 0.2
    assert ByProbability().score(np.zeros(3), p, None) == 0.7
    rejector = ByDistance(np.zeros((3, 2), np.float32), np.zeros((1, 3), np.float32), np.array(1.0, np.float32))
    assert rejector.score(np.ones(2), p, 0) == pytest.approx(0.2)


def test_a_feature_that_never_varies_gives_finite_scores():
    x, label, _, _ = cloud(40)
    x[:, 1] = 2.0
    rejector = fit_distance(x, label, 2)
    assert np.isfinite(rejector.score(x, np.eye(2)[label], None)).all()
    assert np.isfinite(rejector.score(np.full((1, 3), 1e12), np.eye(2)[:1], None)).all()


def test_operations_of_the_distance_are_those_of_one_triangle():
    x, label, _, _ = cloud(40)
    assert rejection_operations(fit_distance(x, label, 2)) == 3 + 12 + 5 + 3
    assert rejection_operations(ByProbability()) == 0


def test_a_rejector_is_made_again_from_its_arrays():
    x, label, _, _ = cloud(40)
    rejector = fit_distance(x, label, 2)
    again = make_rejector("distance", rejector.arrays())
    np.testing.assert_array_equal(again.score(x, np.eye(2)[label], None), rejector.score(x, np.eye(2)[label], None))
    for name, arrays in (("distance", {}), ("probability", rejector.arrays()), ("other", {})):
        with pytest.raises(ConfigError, match="train the model again"):
            make_rejector(name, arrays)


@pytest.mark.parametrize(
    "bad", [{"means": np.zeros((2, 4))}, {"factors": np.zeros((3, 6))}, {"weight": np.array(-1.0)}, {"means": np.full((2, 3), np.nan)}]
)
def test_arrays_that_do_not_fit_are_refused(bad):
    x, label, _, _ = cloud(40)
    arrays = fit_distance(x, label, 2).arrays() | {name: array.astype(np.float32) for name, array in bad.items()}
    with pytest.raises(ConfigError, match="rejector"):
        make_rejector("distance", arrays).check(3, 2)
