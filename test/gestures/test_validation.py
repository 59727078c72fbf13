"""Splits keep people apart, and figures equal those of scikit-learn."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from radar_core import ConfigError, DataError
from radar_lab.training.validation import Validation, as_text, cross_validate, leave_subjects_out, random_split


@given(
    st.lists(st.integers(0, 30), min_size=2, max_size=80).filter(lambda people: len(set(people)) > 1), st.integers(1, 4), st.integers(2, 12)
)
def test_everybody_is_left_out_once_and_never_alone_in_both_parts(people, n, most):
    person = np.array(people)
    folds = leave_subjects_out(person, n, most=most)
    assert (np.sum(folds, axis=0) == 1).all()
    assert len(folds) <= max(most, 2)
    for test in folds:
        assert not set(person[test]) & set(person[~test])
        assert test.any()
        assert not test.all()


def test_ten_subjects_are_left_out_two_by_two():
    """Accept 1 of the thesis's data set: five folds of two."""
    person = np.repeat(np.arange(10), 150)
    folds = leave_subjects_out(person)
    assert [len(set(person[test])) for test in folds] == [2] * 5
    assert {tuple(test) for test in folds} != {tuple(test) for test in leave_subjects_out(person, seed=2)}


def test_one_person_cannot_be_split():
    with pytest.raises(DataError, match="1 people"):
        leave_subjects_out(np.zeros(9, np.int64))


@pytest.mark.parametrize(("n", "fraction"), [(1500, 0.2), (7, 0.5), (11, 0.3)])
def test_a_random_split_tests_each_sample_once(n, fraction):
    folds = random_split(n, fraction)
    assert (np.sum(folds, axis=0) == 1).all()
    sizes = [test.sum() for test in folds]
    assert max(sizes) - min(sizes) <= 1
    assert len(folds) == round(1 / fraction)


@pytest.mark.parametrize("fraction", [0.0, 0.6, -1.0, float("nan")])
def test_a_fraction_that_is_none_is_refused(fraction):
    with pytest.raises(ConfigError, match="random split"):
        random_split(100, fraction)


def test_too_few_samples_for_a_random_split_are_refused():
    with pytest.raises(DataError, match="at least 5"):
        random_split(4)


def some(n=500, seed=0):
    rng = np.random.default_rng(seed)
    return Validation(
        "subjects", ("random", "push", "pull"), rng.dirichlet(np.ones(3), n), rng.integers(3, size=n), rng.integers(5, size=n), 5
    )


def test_figures_equal_scikit_learn():
    from sklearn.metrics import accuracy_score, confusion_matrix, precision_score, recall_score

    found = some()
    said = found.probabilities.argmax(axis=1)
    np.testing.assert_array_equal(found.confusion, confusion_matrix(found.label, said))
    np.testing.assert_allclose(found.recall, recall_score(found.label, said, average=None))
    np.testing.assert_allclose(found.precision, precision_score(found.label, said, average=None))
    assert found.accuracy == pytest.approx(accuracy_score(found.label, said))
    gesture = found.label > 0
    assert found.gesture_accuracy == pytest.approx(accuracy_score(found.label[gesture], said[gesture]))


def test_a_label_without_samples_has_no_recall_and_warns_of_nothing():
    found = Validation("all", ("random", "push", "pull"), np.eye(3)[[0, 1]], np.array([0, 1]), np.zeros(2, np.int64))
    assert np.isnan(found.recall[2])
    assert np.isnan(found.precision[2])
    assert found.figures()["recall"] == {"random": 1.0, "push": 1.0, "pull": None}
    assert "accuracy 100.0%" in as_text(found)


def test_only_random_samples_have_no_gesture_accuracy():
    found = Validation("all", ("random", "push"), np.eye(2)[[0]], np.array([0]), np.zeros(1, np.int64))
    assert found.figures()["gesture_accuracy"] is None
    assert "gestures" not in as_text(found)


def test_each_sample_is_judged_by_what_has_not_seen_it():
    """The judge says which samples it was trained on: none of those it judges."""
    label, person = np.arange(20) % 2, np.repeat(np.arange(10), 2)
    folds = leave_subjects_out(person)

    def judge(known, test):
        assert not (known & test).any()
        assert (known | test).all()
        return np.eye(2)[label[test]]

    found = cross_validate(label, person, folds, judge, labels=("a", "b"), split="subjects")
    assert found.accuracy == 1.0
    np.testing.assert_array_equal(found.label, label)
    assert found.n_folds == 5


def test_what_no_fold_tests_is_left_out():
    label, person = np.array([0, 1, 1]), np.array([4, 5, 6])
    found = cross_validate(
        label, person, [np.array([False, True, False])], lambda known, test: np.eye(2)[[1]], labels=("a", "b"), split="one"
    )
    assert (found.label.tolist(), found.person.tolist()) == ([1], [5])


def test_nothing_to_validate_is_refused():
    with pytest.raises(DataError, match="nothing to validate"):
        cross_validate(np.zeros(3, np.int64), np.zeros(3, np.int64), [], lambda known, test: np.empty((0, 1)), labels=("a",), split="none")
    with pytest.raises(DataError, match="probabilities"):
        Validation("x", ("a",), np.zeros((2, 2)), np.zeros(2, np.int64), np.zeros(2, np.int64))
