"""The statistics of section 5.3.3: by chance where two sets are alike, certain where they are not, and silent where they cannot speak."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from scipy import stats
from small_sets import random_set

from radar_core import GESTURES, DataError
from radar_gestures.features import FEATURE_NAMES
from radar_lab.evaluation import comparison
from radar_lab.evaluation.comparison import Comparison, ComparisonConfig, as_text, compare, most_different

LABELS = (1, 2, 5, 6, 7, 8, 9)
FAST = ComparisonConfig(max_iterations=60)


@pytest.fixture(scope="module")
def shifted():
    """The same seven gestures twice, once with features 3 and 8 shifted by two standard deviations."""
    a, b = random_set(60, LABELS, seed=1), random_set(40, LABELS, seed=2)
    moved = b.features.copy()
    moved[:, [3, 8]] += 2.0
    return a, dataclasses.replace(b, features=moved)


@pytest.fixture(scope="module")
def result(shifted):
    return compare(*shifted)


def test_values_are_those_of_scipy(shifted, result):
    """One of each test by hand."""
    a, b = shifted
    x, y = a.features[a.label == 5][:, 4], b.features[b.label == 5][:, 4]
    row = LABELS.index(5)
    assert result.kruskal[row, 4] == pytest.approx(stats.kruskal(x, y).pvalue)
    assert result.shapiro[0, 4] == pytest.approx(stats.shapiro(a.features[:, 4]).pvalue, rel=1e-6)
    medians = [np.median(one.features[one.label == 5], axis=0) for one in (a, b)]
    assert result.wilcoxon[row] == pytest.approx(stats.wilcoxon(*medians).pvalue)


def test_what_differs_is_found_and_nothing_else(result):
    """Two standard deviations with 60 and 40 samples: never missed. Of the 77 alike about 5 % are called different by chance."""
    different = result.kruskal < 0.05
    assert different[:, [3, 8]].all()
    rest = np.delete(different, [3, 8], axis=1)
    assert rest.sum() <= 10  # binomial, 77 trials of 0.05: more than 10 once in 800
    assert set(result.left_out) == {3, 8}


def test_medians_that_differ_by_chance_are_alike_and_shifted_ones_are_not():
    """Wilcoxon over thirteen pairs: of 140 tests of like medians about 5 % are below 0.05; all medians higher by 1: always the least p."""
    found = []
    for seed in range(20):
        a, b = random_set(60, LABELS, seed=100 + 2 * seed), random_set(40, LABELS, seed=101 + 2 * seed)
        found.append([wilcoxon_of(a, b, label) for label in LABELS])
        assert wilcoxon_of(a, dataclasses.replace(b, features=b.features + 1.0), LABELS[0]) == pytest.approx(2 / 2**13)
    # Binomial, 140 trials of 0.05: more than 16 once in 1,500.
    assert (np.array(found) < 0.05).sum() <= 16


def test_effect_sizes():
    """Two groups apart: most of the ranks' variance; alike: next to none. Medians all larger: 1, all smaller: -1, half and half: 0."""
    rng = np.random.default_rng(5)
    x = rng.normal(size=200)
    apart, alike = (stats.kruskal(x, y).statistic for y in (x + 100.0, rng.permutation(x)))
    assert comparison.eta_squared(np.array([apart, alike, np.nan]), 400)[:2] == pytest.approx([0.75, 0.0], abs=0.01)
    assert np.isnan(comparison.eta_squared(np.array([np.nan]), 400)[0])
    y = np.arange(8.0)
    assert comparison.rank_biserial(y + 1.0, y) == 1.0
    assert comparison.rank_biserial(y, y + 1.0) == -1.0
    assert comparison.rank_biserial(y, y) == 0.0
    assert comparison.rank_biserial(y + np.array([1, -1, 1, -1, 1, -1, 1, -1]), y) == 0.0


def test_effects_of_what_was_shifted_are_large(result):
    """Two standard deviations: more than half of the ranks' variance; the others a few hundredths."""
    assert (result.eta_squared[:, [3, 8]] > 0.4).all()
    assert np.median(np.delete(result.eta_squared, [3, 8], axis=1)) < 0.02


def wilcoxon_of(a, b, label):
    return comparison._wilcoxon(*(np.median(one.features[one.label == label], axis=0) for one in (a, b)))


def test_gaussian_mixtures_are_not_normal_but_a_single_gesture_is():
    """Means of seven gestures 3 apart: all rejected. One gesture alone: normal, rejected by chance only."""
    many = compare(random_set(60, LABELS, seed=1), random_set(60, LABELS, seed=2), FAST)
    assert np.median(many.shapiro) < 0.01
    single = compare(random_set(60, (2,), seed=1), random_set(60, (2,), seed=2))
    assert np.median(single.shapiro) > 0.2
    assert (single.shapiro < 0.001).sum() == 0  # 26 tests
    assert single.transfer is None
    assert "it takes two gestures" in single.notes[-1]


def test_p_values_of_alike_sets_are_even():
    """The same distribution: p-values of Kruskal-Wallis are uniform (Kolmogorov-Smirnov over 91 tests)."""
    even = compare(random_set(50, LABELS, seed=3), random_set(50, LABELS, seed=4), FAST)
    assert stats.kstest(even.kruskal.ravel(), "uniform").pvalue > 0.01


def test_a_classifier_learns_from_one_about_the_other(shifted, result):
    """Means about 15 apart over 13 axes: every sample right, whatever two shifts of 2 do; figures agree with the confusion matrix."""
    alike = compare(shifted[0], random_set(40, LABELS, seed=2), FAST)
    assert alike.transfer.accuracy == 1.0
    for found in (result.transfer, result.reduced):
        assert found.confusion.sum() == 280
        assert found.accuracy == pytest.approx(np.trace(found.confusion) / 280)
        np.testing.assert_allclose(found.recall, np.diag(found.confusion) / 40)
    assert result.reduced.accuracy > 0.95
    unknown = compare(random_set(60, LABELS, seed=1), random_set(60, LABELS, seed=2, spread=0.0), FAST)
    # Nothing in B says what it is: one in seven, give or take what one class takes from another.
    assert unknown.transfer.accuracy == pytest.approx(1 / 7, abs=0.1)


def test_the_same_call_gives_the_same_numbers(shifted, result):
    again = compare(*shifted)
    for field in dataclasses.fields(Comparison):
        if field.name not in ("transfer", "reduced"):
            np.testing.assert_array_equal(getattr(again, field.name), getattr(result, field.name))
    np.testing.assert_array_equal(again.transfer.confusion, result.transfer.confusion)


def test_the_most_different_are_those_of_the_largest_mean():
    statistic = np.array([[1.0, np.nan, 5.0], [2.0, 9.0, 0.0]])
    assert most_different(statistic, 2) == (1, 2)
    assert most_different(statistic, 0) == ()


def test_it_reads_as_text(result):
    """A line for every feature and gesture, the accuracies, and what was left out."""
    text = as_text(result)
    for name in (*FEATURE_NAMES, *(GESTURES[label] for label in LABELS)):
        assert sum(line.startswith(name + " ") for line in text.splitlines()) == 1
    assert text.count("one of the most different") == 2
    assert f"of 280 samples right; without {FEATURE_NAMES[result.left_out[0]]} and {FEATURE_NAMES[result.left_out[1]]}" in text
    assert "nan" not in text


def test_sets_that_cannot_be_compared_are_refused():
    a = random_set(5, (1, 2))
    with pytest.raises(DataError, match="no gesture in common"):
        compare(a, random_set(5, (3, 4)))
    with pytest.raises(DataError, match="different features"):
        compare(a, dataclasses.replace(a, names=tuple(f"f{k}" for k in range(13))))
