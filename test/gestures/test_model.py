"""The perceptron against scikit-learn's, and its file against damage."""

from __future__ import annotations

import numpy as np
import pytest

from radar_core import GESTURES, ConfigError, DataError
from radar_gestures.features import FEATURE_NAMES
from radar_gestures.model import GestureModel, load_model, save_model
from radar_gestures.samples import SampleSet
from radar_gestures.training import fit, split_by_person


@pytest.fixture(scope="module")
def samples():
    """Ten Gaussian clouds, one per label, of twenty people."""
    rng = np.random.default_rng(3)
    label = np.repeat(np.arange(10), 60)
    features = 3 * rng.normal(size=(10, 13))[label] + rng.normal(size=(600, 13))
    return SampleSet(features, label, rng.integers(20, size=600), np.zeros(600), np.zeros(10, np.int64), {"margin": 0.1})


@pytest.fixture(scope="module")
def report(samples):
    return fit(samples, split_by_person(samples.person, 0.2, 1), hidden=32, regularisation=1e-3, max_iterations=60, seed=1)


@pytest.fixture
def model(report):
    return report.model


def test_inference_equals_scikit_learn(samples):
    """Same weights, same numbers: both are float64, so only the order of summation differs."""
    from sklearn.exceptions import ConvergenceWarning
    from sklearn.neural_network import MLPClassifier

    mean, scale = samples.features.mean(0), samples.features.std(0)
    network = MLPClassifier((32,), max_iter=5, random_state=1)
    with pytest.warns(ConvergenceWarning):
        network.fit((samples.features - mean) / scale, samples.label)
    ours = GestureModel(mean, scale, network.coefs_[0], network.intercepts_[0], network.coefs_[1], network.intercepts_[1])
    theirs = network.predict_proba((samples.features - mean) / scale)
    np.testing.assert_allclose(ours.probabilities(samples.features), theirs, atol=1e-12)


def test_training_separates_what_is_separable(report):
    """Ten clouds about 10 standard deviations apart: nearly nothing is confused, and figures tell the same."""
    assert report.accuracy > 0.97
    assert report.confusion.sum() == report.n_test
    assert report.model.figures["accuracy"] == report.accuracy


def test_training_is_reproducible(samples, report):
    again = fit(samples, split_by_person(samples.person, 0.2, 1), hidden=32, regularisation=1e-3, max_iterations=60, seed=1)
    np.testing.assert_array_equal(again.model.hidden_weights, report.model.hidden_weights)


def test_no_person_is_in_both_parts(samples):
    test = split_by_person(samples.person, 0.2, 1)
    assert not set(samples.person[test]) & set(samples.person[~test])
    assert 0 < test.sum() < len(test)


def test_a_label_without_samples_is_refused(samples):
    few = SampleSet(*(a[samples.label != 7] for a in (samples.features, samples.label, samples.person, samples.walked)), samples.missed, {})
    with pytest.raises(DataError, match="rotate"):
        fit(few, split_by_person(few.person, 0.2, 1), hidden=4, regularisation=0.0, max_iterations=1, seed=1)


def test_a_saved_model_comes_back_as_it_was(model, samples, tmp_path):
    save_model(model, tmp_path / "new" / "model.npz")
    back = load_model(tmp_path / "new" / "model.npz")
    np.testing.assert_array_equal(back.probabilities(samples.features), model.probabilities(samples.features))
    assert back.settings == {"margin": 0.1}
    assert back.figures == model.figures


def test_probabilities_are_probabilities_even_far_out(model):
    far = model.probabilities(np.full((1, 13), 1e6))
    assert far.shape == (1, 10)
    assert far.sum() == pytest.approx(1.0)


@pytest.mark.parametrize("bad", [np.full(13, np.nan), np.zeros(12), np.zeros((2, 14))])
def test_bad_features_are_refused(model, bad):
    with pytest.raises(DataError, match="features"):
        model.probabilities(bad)


def rewrite(path, **changes):
    with np.load(path) as file:
        content = {key: file[key] for key in file.files} | changes
    np.savez(path, **{key: value for key, value in content.items() if value is not None})


@pytest.mark.parametrize(
    "changes",
    [
        {"format": np.int64(999)},
        {"format": None},
        {"mean": np.zeros(12)},
        {"scale": np.zeros(13)},
        {"output_bias": np.full(10, np.nan)},
        {"hidden_weights": np.zeros((13, 5))},
        {"hidden_bias": np.zeros((2, 2))},
        {"about": np.array("{}")},
        {"about": np.array("no json")},
        {"about": np.array('{"labels": ["a"], "features": [], "settings": {}, "figures": {}}')},
        {"mean": np.array(["x"] * 13)},
    ],
)
def test_a_wrong_file_gives_one_clear_error(model, tmp_path, changes):
    path = tmp_path / "model.npz"
    save_model(model, path)
    rewrite(path, **changes)
    with pytest.raises(ConfigError, match=r"model\.npz: .*handwave train"):
        load_model(path)


@pytest.mark.parametrize("content", [b"", b"hello", b"PK\x03\x04 cut off", b"\x80\x04pickle"])
def test_a_file_that_is_no_model_gives_one_clear_error(tmp_path, content):
    (tmp_path / "model.npz").write_bytes(content)
    with pytest.raises(ConfigError, match="handwave train"):
        load_model(tmp_path / "model.npz")


def test_a_pickle_is_never_unpickled(model, tmp_path):
    path = tmp_path / "model.npz"
    save_model(model, path)
    with np.load(path) as file:
        content = {key: file[key] for key in file.files}
    np.savez(path, **(content | {"mean": np.array([object()] * 13, dtype=object)}))
    with pytest.raises(ConfigError, match="handwave train"):
        load_model(path)


def test_an_unknown_name_lists_ours():
    with pytest.raises(ConfigError, match="models: "):
        load_model("no_such_model")


def test_names_and_labels_have_the_thesis_numbers():
    assert (len(FEATURE_NAMES), len(GESTURES)) == (13, 10)
