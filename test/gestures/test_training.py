"""Training on Gaussian clouds, where what is right can be computed."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from radar_core import GESTURES, ConfigError, DataError
from radar_gestures.classifiers.model import load_model, save_model
from radar_lab.datasets.samples import SampleSet
from radar_lab.training.training import TrainingConfig, config_of, describe, fit, of_labels, train_on, validate
from radar_lab.training.unknown import as_table, leave_one_gesture_out
from radar_lab.training.validation import random_split

QUICK = TrainingConfig(max_iterations=60, folds=3)


def gaussian(n=600, n_features=13, spread=1.0, names=None, seed=3):
    """One Gaussian cloud per label about 3 sqrt(2 n_features) apart, of twenty people."""
    rng = np.random.default_rng(seed)
    label = np.arange(n) % 10
    features = 3 * rng.normal(size=(10, n_features))[label] + spread * rng.normal(size=(n, n_features))
    more = {} if names is None else {"names": names}
    return SampleSet(features, label, rng.integers(20, size=n), np.zeros(n), np.zeros(10, np.int64), {"margin": 0.1}, **more)


@pytest.fixture(scope="module")
def samples():
    return gaussian()


@pytest.fixture(scope="module")
def report(samples):
    return train_on(samples, QUICK)


def test_training_separates_what_is_separable(report):
    """Ten clouds about 15 standard deviations apart: nearly nothing is confused."""
    assert report.validation.accuracy > 0.97
    assert report.model.figures["accuracy"] == report.validation.accuracy
    assert report.validation.confusion.sum() == 600


def test_overlapping_clouds_reach_the_bayes_rate_and_no_more():
    """Two labels, one feature, means 2 deviations apart: the best rule is right in Phi(1) = 84.1 %; 1,000 samples tell it to +-1.2 %."""
    rng = np.random.default_rng(0)
    label = np.arange(1000) % 2
    x = (2.0 * label + rng.normal(size=1000))[:, None]
    samples = SampleSet(x, label, np.arange(1000) % 9, np.zeros(1000), np.zeros(10, np.int64), {}, names=("x",))
    settings = TrainingConfig(hidden=(8,), max_iterations=80, folds=3)
    report = train_on(samples, settings, labels=("left", "right"))
    assert report.validation.accuracy == pytest.approx(0.841, abs=0.04)
    # Two labels leave scikit-learn's net with one output: the model must say the same as the logistic truth, 2 x - 2.
    at = np.array([[0.0], [1.0], [2.0]])
    np.testing.assert_allclose(report.model.probabilities(at)[:, 1], 1 / (1 + np.exp([2.0, 0.0, -2.0])), atol=0.12)


def test_training_is_reproducible_byte_for_byte(samples, report, tmp_path):
    save_model(report.model, tmp_path / "a.npz")
    save_model(train_on(samples, QUICK).model, tmp_path / "b.npz")
    assert (tmp_path / "a.npz").read_bytes() == (tmp_path / "b.npz").read_bytes()
    other = fit(samples, np.ones(600, np.bool_), TrainingConfig(max_iterations=5, seed=2))
    assert not np.array_equal(other.weights[0], fit(samples, np.ones(600, np.bool_), TrainingConfig(max_iterations=5)).weights[0])


@pytest.mark.parametrize(("seed", "gain"), [(2, 0.1), (4, 0.0), (6, 0.2)])
def test_of_several_starts_the_one_with_the_least_loss_is_kept(samples, seed, gain):
    """More starts never end higher: the cross-entropy with the penalty, which training minimises, of tiny networks stopped early.

    What is compared is the mean over the batches of the last pass, the loss before its last steps: 1 % off.
    """
    every, settings = np.ones(600, np.bool_), TrainingConfig(hidden=(4,), max_iterations=60, seed=seed)

    def loss(starts):
        model = fit(samples, every, dataclasses.replace(settings, starts=starts))
        right = model.probabilities(samples.features)[np.arange(600), samples.label]
        penalty = sum(float((weights.astype(np.float64) ** 2).sum()) for weights in model.weights)
        return -np.log(right).mean() + settings.regularisation / 2 / 600 * penalty

    losses = [loss(starts) for starts in (1, 2, 4)]
    assert losses[0] * 1.01 > losses[1]
    assert losses[1] * 1.01 > losses[2]
    assert losses[2] <= (1.0 - gain) * losses[0]


def test_the_limit_loses_what_was_asked_for(report):
    """540 gestures of people left out: at most 5 % are lost, and nearly that many, as the scores hardly tie."""
    assert 0.03 <= report.lost <= 0.05
    assert 0.0 < report.model.reject < 1.0


def test_the_temperature_does_not_make_calibration_worse(report):
    assert report.calibration_error[1] <= report.calibration_error[0] + 0.01


def test_a_model_knows_how_it_was_trained(report, tmp_path):
    save_model(report.model, tmp_path / "m.npz")
    assert config_of(load_model(tmp_path / "m.npz")) == QUICK
    bare = dataclasses.replace(report.model, figures={})
    assert config_of(bare) == TrainingConfig()


def test_any_features_and_layers_can_be_trained():
    samples = gaussian(300, 4, names=("a", "b", "c", "d"))
    model = fit(samples, np.ones(300, np.bool_), TrainingConfig(hidden=(16, 8), max_iterations=20, rejector="probability"))
    assert model.names == ("a", "b", "c", "d")
    assert [weights.shape for weights in model.weights] == [(4, 16), (16, 8), (8, 10)]
    assert model.rejector.name == "probability"


def test_a_random_split_is_judged_too(samples):
    found = validate(samples, random_split(600, 0.5), TrainingConfig(max_iterations=40), split="random")
    assert found.split == "random"
    assert found.accuracy > 0.95


def test_a_label_without_samples_is_refused(samples):
    few = of_labels(samples, [name for name in GESTURES if name != "rotate"])
    few = dataclasses.replace(few, label=np.where(few.label >= 7, few.label + 1, few.label), labels=GESTURES)
    with pytest.raises(DataError, match="rotate"):
        train_on(few, QUICK)


def test_labels_are_chosen_by_name(samples):
    chosen = of_labels(samples, ("push", "random"))
    assert len(chosen.label) == 120
    np.testing.assert_array_equal(chosen.features[chosen.label == 1], samples.features[samples.label == 0])
    np.testing.assert_array_equal(chosen.features[chosen.label == 0], samples.features[samples.label == GESTURES.index("push")])


@pytest.mark.parametrize("labels", [("push",), ("push", "push"), ("push", "salute"), ()])
def test_labels_that_make_no_sense_are_refused(samples, labels):
    with pytest.raises(ConfigError, match="labels"):
        of_labels(samples, labels)


def test_a_gesture_never_seen_is_rejected(samples):
    """The clouds are far apart, so nearly every event of the missing one lies far from all others; a net alone is sure of many of them."""
    distance, probability = leave_one_gesture_out(samples, QUICK, unknown=("wave", "push"))
    assert (distance.rejector, probability.rejector) == ("distance", "probability")
    assert distance.mean > 0.95
    assert distance.mean >= probability.mean
    assert distance.lost <= 0.05
    assert "| wave | " in as_table([distance, probability])


def test_a_gesture_that_is_not_there_cannot_be_played(samples):
    with pytest.raises(DataError, match="salute"):
        leave_one_gesture_out(samples, QUICK, unknown=("salute",))


def test_the_description_holds_the_figures(report):
    text = describe(report)
    assert f"temperature {report.model.temperature:.2f}" in text
    assert "push_pull" in text
