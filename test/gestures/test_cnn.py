"""The convolutional network: its graph against numpy, its counts against those by hand, its file against damage, training against luck."""

from __future__ import annotations

import numpy as np
import pytest

from radar_core import ConfigError, DataError, PointCloud
from radar_lab.training.cnn import CnnConfig, CnnModel, Network, count_flop, export
from radar_lab.training.encoder import EncoderConfig, encode_maps
from radar_lab.training.networks import cnn_judge, train_cnn
from radar_lab.training.validation import cross_validate, random_split

onnx = pytest.importorskip("onnx", reason="needs onnx (pip install 'handwave[train]')")
pytest.importorskip("onnxruntime", reason="needs the ONNX runtime (pip install 'handwave[cnn]')")

SHAPE = (5, 8, 12)
LABELS = ("random", "push", "pull")


def network(channels=(3, 4), hidden=6, shape=SHAPE, n_labels=3, seed=0):
    rng = np.random.default_rng(seed)
    convolutions, n_in = [], shape[0]
    for n_out in channels:
        convolutions.append((rng.normal(size=(n_out, n_in, 3, 3)).astype(np.float32) * 0.3, rng.normal(size=n_out).astype(np.float32)))
        n_in = n_out
    cells = n_in * (shape[1] >> len(channels)) * (shape[2] >> len(channels))
    dense = [
        (rng.normal(size=pair).astype(np.float32) * 0.3, rng.normal(size=pair[1]).astype(np.float32))
        for pair in ((cells, hidden), (hidden, n_labels))
    ]
    mean, scale = rng.normal(size=shape[0]).astype(np.float32), rng.uniform(0.5, 2, shape[0]).astype(np.float32)
    return Network(mean, scale, tuple(convolutions), tuple(dense))


def by_hand(net, cube):
    """The network in plain numpy, one cube."""
    x = np.where(cube[:1] == 0, 0, (cube - net.mean[:, None, None]) / net.scale[:, None, None])
    for filters, bias in net.convolutions:
        padded = np.pad(x, ((0, 0), (1, 1), (1, 1)))
        windows = np.lib.stride_tricks.sliding_window_view(padded, (3, 3), axis=(1, 2))
        x = np.maximum(np.einsum("oiab,ihwab->ohw", filters, windows) + bias[:, None, None], 0)
        c, h, w = x.shape
        x = x[:, : h // 2 * 2, : w // 2 * 2].reshape(c, h // 2, 2, w // 2, 2).max(axis=(2, 4))
    x = x.ravel()
    (first, offset), (last, bias) = net.dense
    score = np.maximum(x @ first + offset, 0) @ last + bias
    return np.exp(score - score.max()) / np.exp(score - score.max()).sum()


@pytest.fixture(scope="module")
def path(tmp_path_factory):
    path = tmp_path_factory.mktemp("cnn") / "new" / "network.onnx"
    export(network(), path, SHAPE, labels=LABELS)
    return path


@pytest.fixture(scope="module")
def cubes():
    """A third of the cells empty."""
    rng = np.random.default_rng(4)
    values = rng.normal(size=(7, *SHAPE)).astype(np.float32)
    return values * (rng.random((7, 1, *SHAPE[1:])) > 0.3).astype(np.float32)


def test_the_graph_equals_the_network_in_numpy(path, cubes):
    """Single precision, a few hundred terms: 1e-5."""
    found = CnnModel(path).probabilities(cubes)
    np.testing.assert_allclose(found, [by_hand(network(), cube) for cube in cubes], atol=1e-5)


def test_one_cube_and_many_give_the_same(path, cubes):
    model = CnnModel(path)
    assert model.labels == LABELS
    np.testing.assert_allclose(model.probabilities(cubes[0]), model.probabilities(cubes)[0], atol=1e-6)
    assert model.probabilities(cubes[:0]).shape == (0, 3)


def test_operations_are_counted_as_documented(path):
    """Input 2 operations a cell and 1 an amplitude; a convolution 2 * 9 * n_in a cell, ReLU 1, maxima 3; dense 2; softmax 13."""
    entry = 2 * 5 * 96 + 96
    first = 3 * 96 * (2 * 9 * 5 + 1) + 3 * 3 * 24
    second = 4 * 24 * (2 * 9 * 3 + 1) + 3 * 4 * 6
    dense = 2 * 24 * 6 + 6 + 2 * 6 * 3 + 13
    assert CnnModel(path).flop == entry + first + second + dense
    assert CnnModel(path).n_bytes == path.stat().st_size


def test_the_default_network_is_of_the_size_of_the_thesis(tmp_path):
    """Table 4.2 has 18.3 MFLOP and 35.7 MB; ours is of that order in work, and smaller."""
    settings = CnnConfig()
    net = network(settings.channels, settings.hidden, (5, 50, 50), 10)
    flop = export(net, tmp_path / "net.onnx")
    assert 10e6 < flop < 20e6
    assert (tmp_path / "net.onnx").stat().st_size < 2e6


def test_operations_of_the_default_network_on_maps_are_counted(tmp_path):
    """Three maps of 65 gates and 50 frames, three convolutions: 65 x 50, 32 x 25 and 16 x 12 cells, then 8 x 6 cells of 64 patterns."""
    settings, shape = CnnConfig(), (3, 65, 50)
    found = export(network(settings.channels, settings.hidden, shape, 10), tmp_path / "maps.onnx", shape)
    entry = 2 * 3 * 3250 + 3250
    first = 16 * 3250 * (2 * 9 * 3 + 1) + 3 * 16 * 800
    second = 32 * 800 * (2 * 9 * 16 + 1) + 3 * 32 * 192
    third = 64 * 192 * (2 * 9 * 32 + 1) + 3 * 64 * 48
    dense = 2 * 3072 * 128 + 128 + 2 * 128 * 10 + 48
    model = CnnModel(tmp_path / "maps.onnx")
    assert found == model.flop == entry + first + second + third + dense
    assert model.shape == shape
    numbers = 16 * 3 * 9 + 16 + 32 * 16 * 9 + 32 + 64 * 32 * 9 + 64 + 3072 * 128 + 128 + 128 * 10 + 10 + 2 * 3
    assert 4 * numbers < model.n_bytes < 4 * numbers + 5000  # single precision, and what the graph says about itself


def test_the_graph_on_maps_equals_the_network_in_numpy(tmp_path):
    """Three maps; an odd number of gates, of which the last is left over by the maxima."""
    net, shape = network(shape=(3, 9, 12)), (3, 9, 12)
    export(net, tmp_path / "maps.onnx", shape, labels=LABELS)
    rng = np.random.default_rng(5)
    maps = rng.normal(size=(4, *shape)).astype(np.float32) * (rng.random((4, 1, 9, 12)) > 0.5).astype(np.float32)
    np.testing.assert_allclose(CnnModel(tmp_path / "maps.onnx").probabilities(maps), [by_hand(net, one) for one in maps], atol=1e-5)


def test_an_operator_that_is_not_counted_is_refused():
    from onnx import TensorProto, helper

    ends = [helper.make_tensor_value_info(name, TensorProto.FLOAT, [1, 5]) for name in ("cube", "out")]
    graph = helper.make_graph([helper.make_node("Erf", ["cube"], ["out"])], "g", ends[:1], ends[1:])
    with pytest.raises(DataError, match="Erf"):
        count_flop(helper.make_model(graph), (5, 1, 1))


@pytest.mark.parametrize("bad", [np.zeros((5, 8, 11)), np.zeros(3), np.full(SHAPE, np.nan), np.full((2, *SHAPE), np.inf)])
def test_bad_cubes_are_refused(path, bad):
    with pytest.raises(DataError, match="cubes"):
        CnnModel(path).probabilities(bad)


@pytest.mark.parametrize("content", [b"", b"hello", b"\x80\x04pickle"])
def test_a_file_that_is_no_graph_gives_one_clear_error(tmp_path, content):
    (tmp_path / "bad.onnx").write_bytes(content)
    with pytest.raises(ConfigError, match=r"bad\.onnx: .*train the network again"):
        CnnModel(tmp_path / "bad.onnx")


@pytest.mark.parametrize("share", [0.2, 0.6, 0.99])
def test_a_graph_cut_off_gives_one_clear_error(path, tmp_path, share):
    whole = path.read_bytes()
    (tmp_path / "bad.onnx").write_bytes(whole[: int(share * len(whole))])
    with pytest.raises(ConfigError, match="train the network again"):
        CnnModel(tmp_path / "bad.onnx")


def test_a_missing_file_is_said(tmp_path):
    with pytest.raises(ConfigError, match=r"none\.onnx"):
        CnnModel(tmp_path / "none.onnx")


@pytest.mark.parametrize("about", [None, "no json", '{"format": 99, "labels": [], "shape": [1, 2, 3], "flop": 1}', '{"format": 1}', "[]"])
def test_a_graph_of_others_or_another_version_is_refused(path, tmp_path, about):
    model = onnx.load(path)
    del model.metadata_props[:]
    if about is not None:
        onnx.helper.set_model_props(model, {"handwave": about})
    onnx.save(model, tmp_path / "other.onnx")
    with pytest.raises(ConfigError, match=r"other\.onnx: .*train the network again"):
        CnnModel(tmp_path / "other.onnx")


def test_a_graph_that_refers_to_other_files_is_refused(path, tmp_path):
    model = onnx.load(path)
    onnx.save(model, tmp_path / "split.onnx", save_as_external_data=True, location="secret", size_threshold=0)
    with pytest.raises(ConfigError, match="refers to other files"):
        CnnModel(tmp_path / "split.onnx")


def stripes(n=90, seed=0):
    """Three labels: detections in the first, the middle or the last frames, in noise."""
    rng = np.random.default_rng(seed)
    label = np.arange(n) % 3
    cubes = rng.normal(scale=0.3, size=(n, *SHAPE)).astype(np.float32)
    for number, cube in zip(label, cubes, strict=True):
        cube[:, :, 4 * number : 4 * number + 4] += 2.0
    return cubes, label


def test_training_learns_reproducibly_and_exports_what_it_learned():
    """Seconds with PyTorch. Stripes are plain to see, chance is a third."""
    pytest.importorskip("torch", reason="needs PyTorch (pip install 'handwave[train]')")
    cubes, label = stripes()
    settings = CnnConfig(channels=(4,), hidden=8, epochs=8, batch=16, learning_rate=1e-2)
    judge = cnn_judge(cubes, label, settings, labels=LABELS)
    found = cross_validate(label, label, random_split(len(label), 0.5), judge, labels=LABELS, split="random")
    assert found.accuracy > 0.9
    one, two = (train_cnn(cubes, label, settings, labels=LABELS) for _ in range(2))
    for a, b in zip(one.convolutions + one.dense, two.convolutions + two.dense, strict=True):
        np.testing.assert_array_equal(a[0], b[0])


def strokes(n=160, seed=0):
    """Maps of pushes and pulls, told by the sign of the range rate, and of swipes at both signs, told by where the azimuth goes alone."""
    rng = np.random.default_rng(seed)
    label, maps = np.arange(n) % 4, []
    for number in label.tolist():
        sign = {1: -1.0, 2: 1.0}.get(number, rng.choice([-1.0, 1.0]))
        side = {0: -1.0, 3: 1.0}.get(number, 0.0)
        clouds = []
        for k in range(12):
            speed, azimuth = sign * rng.uniform(0.8, 1.6, 3), side * 0.1 * (k - 5.5) + rng.normal(0, 0.05, 3)
            values = (np.full(3, 2.0), azimuth, np.zeros(3), speed, np.full(3, 20.0))
            fields = dict(
                zip(("range", "azimuth", "elevation", "radial_speed", "snr"), (v.astype(np.float32) for v in values), strict=True)
            )
            clouds.append(PointCloud(k * 20_000_000, k, "radar", *np.zeros((3, 3), np.float32), **fields))
        maps.append(encode_maps(clouds, EncoderConfig(n_frames=16), 0.26, 2.0))
    return np.array(maps), label


@pytest.mark.long
def test_the_network_on_maps_learns_strokes_that_only_directions_tell_apart():
    """Chance is a quarter; who sees no azimuth tells at most half: all swipes look like a push or a pull."""
    pytest.importorskip("torch", reason="needs PyTorch (pip install 'handwave[train]')")
    maps, label = strokes()
    labels = ("swipe_right", "push", "pull", "swipe_left")
    settings = CnnConfig(channels=(8, 8), hidden=16, epochs=25, batch=16, learning_rate=1e-2)
    judge = cnn_judge(maps, label, settings, labels=labels)
    found = cross_validate(label, label, random_split(len(label), 0.5), judge, labels=labels, split="random")
    assert found.accuracy > 0.9


def test_cubes_too_small_or_too_few_are_refused():
    with pytest.raises(DataError, match="labels"):
        train_cnn(np.zeros((2, *SHAPE), np.float32), np.zeros(3, np.int64))
    with pytest.raises(ConfigError, match="use fewer"):
        train_cnn(np.ones((2, 5, 4, 50), np.float32), np.zeros(2, np.int64))
