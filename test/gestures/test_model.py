"""The perceptron against scikit-learn's and against its own reference, and its file against damage and malice."""

from __future__ import annotations

import dataclasses
import io
import json
import pickle
import zipfile
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from radar_core import GESTURES, ConfigError, DataError
from radar_core.paths import share_dir
from radar_gestures.classifiers.model import load_model, save_model
from radar_gestures.classifiers.perceptron import FORMAT, GestureModel
from radar_gestures.features import FEATURE_NAMES
from radar_lab.training.calibration import fit_distance
from radar_lab.training.operations import operations


def make(hidden=(32,), names=FEATURE_NAMES, labels=GESTURES, seed=0, **more):
    """A perceptron with random weights."""
    rng = np.random.default_rng(seed)
    sizes = [len(names), *hidden, len(labels)]
    weights = tuple(rng.normal(size=pair) for pair in pairwise(sizes))
    biases = tuple(rng.normal(size=n) for n in sizes[1:])
    return GestureModel(rng.normal(size=sizes[0]), rng.uniform(0.5, 2.0, sizes[0]), weights, biases, labels=labels, names=names, **more)


def distance(n_labels=10, n_features=13):
    rng = np.random.default_rng(1)
    label = np.arange(40 * n_labels) % n_labels
    return fit_distance(rng.normal(size=(40 * n_labels, n_features)), label, n_labels)


@pytest.fixture(scope="module")
def model():
    return make(temperature=1.5, reject=0.3, rejector=distance(), settings={"margin": 0.1}, figures={"accuracy": 0.9})


def test_inference_equals_scikit_learn():
    """Same weights, same numbers, but for ours being rounded to float32: 6e-8 of each of 13 + 32 terms of order 1."""
    from sklearn.exceptions import ConvergenceWarning
    from sklearn.neural_network import MLPClassifier

    rng = np.random.default_rng(3)
    x, label = rng.normal(size=(600, 13)), np.arange(600) % 10
    mean, scale = x.mean(0), x.std(0)
    network = MLPClassifier((32,), max_iter=5, random_state=1)
    with pytest.warns(ConvergenceWarning):
        network.fit((x - mean) / scale, label)
    ours = GestureModel(mean, scale, tuple(network.coefs_), tuple(network.intercepts_))
    np.testing.assert_allclose(ours.probabilities(x), network.predict_proba((x - mean) / scale), atol=2e-6)


@pytest.mark.parametrize("hidden", [(32,), (5, 7), ()])
def test_one_sample_equals_the_numpy_reference(hidden):
    """The compiled loop and the matrix products differ in the order of summation only."""
    model = make(hidden, temperature=0.7)
    x = np.random.default_rng(1).normal(size=(50, 13)) * 3
    both = model.probabilities_numpy(x)
    np.testing.assert_allclose([model.probabilities(row) for row in x], both, atol=1e-13)
    np.testing.assert_allclose(model.probabilities(x.reshape(5, 10, 13)), both.reshape(5, 10, 10), atol=1e-13)


@given(st.integers(1, 9), st.integers(1, 6), st.lists(st.integers(1, 8), max_size=3), st.integers(0, 2**32 - 1))
@settings(max_examples=40, deadline=None)
def test_any_shape_gives_probabilities(n_features, n_labels, hidden, seed):
    model = make(tuple(hidden), tuple(f"f{i}" for i in range(n_features)), tuple(f"l{i}" for i in range(n_labels)), seed)
    found = model.probabilities(np.random.default_rng(seed).normal(size=n_features))
    assert found.shape == (n_labels,)
    assert found.sum() == pytest.approx(1.0)
    assert (found >= 0).all()


def test_a_temperature_divides_the_scores():
    """p^(1/T), normalised, is the softmax of scores / T."""
    x = np.random.default_rng(2).normal(size=(20, 13))
    plain, soft = make().probabilities(x), make(temperature=2.0).probabilities(x)
    np.testing.assert_allclose(soft, np.sqrt(plain) / np.sqrt(plain).sum(axis=1, keepdims=True), atol=1e-12)


def test_operations_are_counted_as_documented(model):
    """13-32-10 by hand: 2 * 13 * 32 + 32 + 2 * 32 * 10 + (9 + 10 + 10 + 9 + 10); the thesis states 1602."""
    assert operations(model) == 832 + 32 + 640 + 48 == 1552
    assert operations(make(())) == 2 * 13 * 10 + 48


def test_the_largest_thesis_model_fits_into_16_kilobytes(model, tmp_path):
    """Random weights do not compress, and the rejector with a covariance for every label is the largest."""
    save_model(model, tmp_path / "model.npz")
    assert (tmp_path / "model.npz").stat().st_size <= 16_000


def test_known_is_a_gesture_whose_score_reaches_the_limit():
    sure = np.zeros(10)
    sure[2], sure[0] = 0.6, 0.4
    for reject, expected in ((0.5, True), (0.6, True), (0.61, False)):
        assert make(reject=reject).known(np.zeros(13), sure) is expected
    assert not make(reject=0.0).known(np.zeros(13), np.eye(10)[0])  # random, however sure


def test_a_model_without_random_knows_all_its_labels():
    model = make(names=("a",), labels=("left", "right"))
    assert model.random is None
    assert model.known(np.zeros(1), np.array([0.9, 0.1]))


@pytest.mark.parametrize(
    "bad", [np.full(13, np.nan), np.full((2, 13), np.inf), np.full(13, 1e13), np.zeros(12), np.zeros((2, 14)), np.zeros(())]
)
def test_bad_features_are_refused(model, bad):
    with pytest.raises(DataError, match="features"):
        model.probabilities(bad)


def test_a_saved_model_comes_back_as_it_was(model, tmp_path):
    save_model(model, tmp_path / "new" / "model.npz")
    back = load_model(tmp_path / "new" / "model.npz")
    x = np.random.default_rng(5).normal(size=(30, 13))
    p = model.probabilities(x)
    np.testing.assert_array_equal(back.probabilities(x), p)
    np.testing.assert_array_equal(back.score(x, p), model.score(x, p))
    for name in ("labels", "names", "temperature", "reject", "settings", "figures"):
        assert getattr(back, name) == getattr(model, name)
    assert back.weights[0].dtype == np.float32


def test_a_model_of_other_words_and_layers_comes_back(tmp_path):
    model = make((6, 4), ("a", "b"), ("left", "right", "ä"))
    save_model(model, tmp_path / "m.npz")
    back = load_model(tmp_path / "m.npz")
    assert (back.labels, back.names, len(back.weights)) == (("left", "right", "ä"), ("a", "b"), 3)


def test_the_same_model_gives_the_same_bytes(model, tmp_path):
    for name in ("a.npz", "b.npz"):
        save_model(model, tmp_path / name)
    assert (tmp_path / "a.npz").read_bytes() == (tmp_path / "b.npz").read_bytes()


def test_a_model_that_cannot_be_written_is_said(model, tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(DataError, match="cannot be written"):
        save_model(model, tmp_path / "file" / "model.npz")


def test_our_model_is_of_this_format_and_small():
    model = load_model("gestures")
    assert model.labels == GESTURES
    assert model.names == FEATURE_NAMES
    assert operations(model) <= 1650
    assert (share_dir() / "config" / "models" / "gestures.npz").stat().st_size <= 16_000


@pytest.mark.parametrize(
    "changes",
    [
        {"mean": np.zeros(12)},
        {"scale": np.zeros(13)},
        {"biases": (np.zeros(32), np.full(10, np.nan))},
        {"weights": (np.zeros((13, 5)), np.zeros((32, 10)))},
        {"weights": (np.full((13, 32), 1e39), np.zeros((32, 10)))},
        {"weights": ()},
        {"labels": ("a", "a")},
        {"names": ()},
        {"temperature": 0.0},
        {"temperature": True},
        {"reject": float("nan")},
        {"rejector": distance(9)},
    ],
)
def test_a_model_that_makes_no_sense_is_refused(changes):
    with pytest.raises(ConfigError):
        dataclasses.replace(make(), **changes)


def members(path):
    with zipfile.ZipFile(path) as archive:
        return {name: archive.read(name) for name in archive.namelist()}


def npy(array):
    file = io.BytesIO()
    np.save(file, array)
    return file.getvalue()


def text(**changes):
    about = {"labels": list(GESTURES), "features": list(FEATURE_NAMES), "n_layers": 2, "temperature": 1.0, "reject": 0.0}
    about |= {"rejector": "probability", "settings": {}, "figures": {}} | changes
    return npy(np.frombuffer(json.dumps(about).encode(), np.uint8))


class Evil:
    """Unpickled, it would leave a trace."""

    def __reduce__(self):
        return (exec, ("import builtins; builtins.handwave_was_here = True",))


PICKLED = b"\x93NUMPY\x01\x00v\x00" + b"{'descr': '|O', 'fortran_order': False, 'shape': (13,), }".ljust(117) + b"\n"
HUGE = b"\x93NUMPY\x01\x00v\x00" + b"{'descr': '<f4', 'fortran_order': False, 'shape': (1000000000000,), }".ljust(117) + b"\n"
CALL = b"\x93NUMPY\x01\x00v\x00" + b"{'descr': '<f4', 'fortran_order': False, 'shape': (exit(),), }".ljust(117) + b"\n"


@pytest.mark.parametrize(
    "changes",
    [
        {"format": npy(np.int64(999))},
        {"format": npy(np.array([2]))},
        {"format": None},
        {"mean": None},
        {"weights_1": None},
        {"mean": npy(np.zeros(12, np.float32))},
        {"mean": npy(np.zeros(13))},
        {"scale": npy(np.zeros(13, np.float32))},
        {"bias_1": npy(np.full(10, np.nan, np.float32))},
        {"weights_0": npy(np.zeros((13, 5), np.float32))},
        {"mean": npy(np.array(["x"] * 13))},
        {"mean": PICKLED + pickle.dumps([Evil()] * 13)},
        {"mean": HUGE},
        {"mean": CALL},
        {"mean": b"\x93NUMPY\x03\x00"},
        {"mean": b""},
        {"about": npy(np.frombuffer(b"no json", np.uint8))},
        {"about": npy(np.frombuffer(b"[" * 100_000, np.uint8))},
        {"about": npy(np.frombuffer(b'{"n_layers": ' + b"9" * 5000 + b"}", np.uint8))},
        {"about": text(labels=["a"])},
        {"about": text(labels=[1, 2])},
        {"about": text(n_layers=True)},
        {"about": text(n_layers=3)},
        {"about": text(temperature="1")},
        {"about": text(temperature=0.0)},
        {"about": text(reject=float("inf"))},
        {"about": text(rejector="os.system")},
        {"about": text(rejector=["x"])},
        {"about": text(settings=[])},
        {"rejector_means": npy(np.zeros((10, 13), np.float32))},
    ],
)
def test_a_wrong_or_hostile_file_gives_one_clear_error(tmp_path, changes):
    path = tmp_path / "model.npz"
    save_model(make(), path)
    content = members(path) | {f"{name}.npy": data for name, data in changes.items()}
    with zipfile.ZipFile(path, "w") as archive:
        for name, data in content.items():
            if data is not None:
                archive.writestr(name, data)
    with pytest.raises(ConfigError, match=r"model\.npz: .*(handwave train|train the model)"):
        load_model(path)
    import builtins

    assert not hasattr(builtins, "handwave_was_here")


def test_format_1_is_refused_in_one_sentence(tmp_path):
    np.savez(tmp_path / "old.npz", format=np.int64(1), about=np.array("{}"), mean=np.zeros(13))
    with pytest.raises(ConfigError, match=rf"old\.npz: model format 1, but this version of Handwave reads format {FORMAT}; make a new one"):
        load_model(tmp_path / "old.npz")


def test_a_bomb_is_refused_by_what_it_declares(tmp_path):
    """60 MB of zeros in 60 kB: nothing is unpacked."""
    path = tmp_path / "model.npz"
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("format.npy", npy(np.int64(FORMAT)))
        archive.writestr("mean.npy", bytes(60_000_000))
    assert path.stat().st_size < 100_000
    with pytest.raises(ConfigError, match="more than"):
        load_model(path)


def test_a_bomb_that_lies_about_its_size_is_refused(tmp_path):
    """The directory says 100 bytes, the data inflate to a million: reading stops there, and the checksum does not fit."""
    path = tmp_path / "model.npz"
    save_model(make(), path)
    content = members(path) | {"mean.npy": bytes(1_000_000)}
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, data in content.items():
            archive.writestr(name, data)
    raw = path.read_bytes().replace((1_000_000).to_bytes(4, "little"), (100).to_bytes(4, "little"))
    path.write_bytes(raw)
    with pytest.raises(ConfigError, match="handwave train"):
        load_model(path)


@pytest.mark.parametrize("kind", [zipfile.ZIP_BZIP2, zipfile.ZIP_LZMA])
def test_unusual_packing_is_refused(tmp_path, kind):
    """Their decoders take memory before the first byte comes out."""
    with zipfile.ZipFile(tmp_path / "model.npz", "w", kind) as archive:
        archive.writestr("format.npy", npy(np.int64(FORMAT)))
    with pytest.raises(ConfigError, match="unusual"):
        load_model(tmp_path / "model.npz")


def test_too_many_members_are_refused(tmp_path):
    with zipfile.ZipFile(tmp_path / "model.npz", "w") as archive:
        for number in range(100):
            archive.writestr(f"{number}.npy", b"")
    with pytest.raises(ConfigError, match="more than"):
        load_model(tmp_path / "model.npz")


@pytest.mark.parametrize("content", [b"", b"hello", b"PK\x03\x04 cut off", b"\x80\x04pickle", b"\x93NUMPY"])
def test_a_file_that_is_no_model_gives_one_clear_error(tmp_path, content):
    (tmp_path / "model.npz").write_bytes(content)
    with pytest.raises(ConfigError, match="handwave train"):
        load_model(tmp_path / "model.npz")


@pytest.mark.parametrize("share", [0.1, 0.5, 0.9, 0.999])
def test_a_file_cut_off_anywhere_gives_one_clear_error(model, tmp_path, share):
    save_model(model, tmp_path / "model.npz")
    whole = (tmp_path / "model.npz").read_bytes()
    (tmp_path / "model.npz").write_bytes(whole[: int(share * len(whole))])
    with pytest.raises(ConfigError, match="handwave train"):
        load_model(tmp_path / "model.npz")


@given(st.integers(0, 10_000_000), st.integers(1, 255))
@settings(max_examples=60, deadline=None)
def test_a_flipped_byte_is_refused_or_harmless(place, change):
    """Every array has a checksum; a flip in what nobody reads, as in a date, leaves the model as it was."""
    import tempfile
    from pathlib import Path

    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "model.npz"
        original = make()
        save_model(original, path)
        raw = bytearray(path.read_bytes())
        raw[place % len(raw)] ^= change
        path.write_bytes(bytes(raw))
        try:
            back = load_model(path)
        except ConfigError:
            return
        np.testing.assert_array_equal(back.probabilities(np.ones(13)), original.probabilities(np.ones(13)))


def test_an_unknown_name_lists_ours():
    with pytest.raises(ConfigError, match="models: "):
        load_model("no_such_model")


def test_names_and_labels_have_the_thesis_numbers():
    assert (len(FEATURE_NAMES), len(GESTURES)) == (13, 10)
