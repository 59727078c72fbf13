"""The network on curves: numpy against direct sums, PyTorch, its own file, and what it can learn."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from radar_core import ConfigError, DataError
from radar_gestures.classifiers.branch import CLIP, Branch, convolve, half
from radar_gestures.classifiers.curve_net import CurveNet
from radar_gestures.classifiers.model import load_model, save_model
from radar_gestures.curves import TOTALS
from radar_gestures.signals import SIGNALS, CurveConfig
from radar_lab.training.networks import CurveTraining, train_net
from radar_lab.training.operations import operations

STEPS, WIDTH = 7, 3
NAMES = (*(f"s{k}_{step:02d}" for step in range(STEPS) for k in range(WIDTH)), *TOTALS)


def small_net(seed: int = 0) -> CurveNet:
    """Make a network of random numbers: two convolutions, two dense layers, four labels."""
    rng = np.random.default_rng(seed)

    def draw(*shape: int) -> NDArray[np.float32]:
        return rng.standard_normal(shape).astype(np.float32)

    scale = np.abs(draw(len(NAMES))) + np.float32(0.5)
    return CurveNet(
        (Branch(draw(len(NAMES)), scale, (draw(3, WIDTH, 5), draw(3, 5, 4)), (draw(5), draw(4)), STEPS),),
        (draw(4 * 4 + 2, 6), draw(6, 4)),
        (draw(6), draw(4)),
        names=NAMES,
        labels=("a", "b", "c", "d"),
        settings={"curves": {"steps": STEPS}},
        figures={"accuracy": 0.5},
    )


def changed(net: CurveNet, **changes: Any) -> CurveNet:
    """Return a network of one branch with other fields of its branch."""
    return dataclasses.replace(net, branches=(dataclasses.replace(net.branches[0], **changes),))


def waves(n: int, rng: np.random.Generator) -> tuple[NDArray[np.float32], NDArray[np.int64]]:
    """Two classes that differ only in the order of time: a bump early or late, in noise; shape (n, n_features) and labels."""
    label, width = rng.integers(0, 2, n), len(SIGNALS)
    x = 0.3 * rng.standard_normal((n, width * STEPS + len(TOTALS)))
    for row, kind in enumerate(label):
        at = width * (1 if kind else 5)
        x[row, at : at + width // 3] += 2.0
    return x.astype(np.float32), label


@pytest.mark.parametrize(("steps", "stride"), [(7, 1), (7, 2), (8, 2), (1, 1), (1, 2), (2, 2)])
def test_convolution_is_the_sum_over_three_taps(steps: int, stride: int) -> None:
    """Against the definition, written out: step before, at and after, zeros beyond the ends."""
    rng = np.random.default_rng(1)
    wave, kernel = rng.standard_normal((2, steps, 3)).astype(np.float32), rng.standard_normal((3, 3, 4)).astype(np.float32)
    found = convolve(wave, kernel, stride)
    assert found.shape == (2, -(-steps // stride), 4)
    for place, middle in enumerate(range(0, steps, stride)):
        expected = sum(wave[:, middle + k - 1] @ kernel[k] for k in range(3) if 0 <= middle + k - 1 < steps)
        np.testing.assert_allclose(found[:, place], expected, atol=1e-5)  # float32 sums of nine products of order 1


def test_probabilities_are_probabilities_for_one_and_many() -> None:
    """They sum to 1, and a batch gives what its members give alone."""
    net = small_net()
    x = np.random.default_rng(2).standard_normal((5, len(NAMES)))
    many = net.probabilities(x)
    np.testing.assert_allclose(many.sum(axis=1), 1.0, atol=1e-12)
    np.testing.assert_allclose(many, [net.probabilities(row) for row in x], atol=1e-6)
    assert net.probabilities(x.reshape(5, 1, -1)).shape == (5, 1, 4)


def test_far_outliers_count_as_the_limit() -> None:
    """Whatever lies beyond the cut-off gives the same answer, without overflow."""
    net = small_net()
    limit = net.branches[0].mean + CLIP * net.branches[0].scale
    np.testing.assert_allclose(
        net.probabilities(np.full(len(NAMES), 1e30)), net.probabilities(limit * (1 + 1e-5 * np.sign(limit))), atol=1e-3
    )


def test_flop_is_counted_layer_by_layer() -> None:
    """By hand: 7 steps x 3 x 3 x 5 weights, 4 steps x 3 x 5 x 4, 18 x 6, 6 x 4; two each, and two for each sum."""
    inputs = 2 * len(NAMES)
    convolutions = 7 * (2 * 45 + 2 * 5) + 4 * (2 * 60 + 2 * 4)
    dense = 2 * 18 * 6 + 2 * 6 + 2 * 6 * 4 + 2 * 4
    assert operations(small_net()) == inputs + convolutions + dense + 5 * 4


def test_file_gives_the_same_network_back(tmp_path: Path) -> None:
    """Same answers, names, settings and bytes."""
    net = small_net()
    save_model(net, tmp_path / "net.npz")
    again = load_model(tmp_path / "net.npz")
    x = np.random.default_rng(2).standard_normal((5, len(NAMES)))
    np.testing.assert_array_equal(again.probabilities(x), net.probabilities(x))
    assert (again.names, again.labels, again.settings, again.figures) == (net.names, net.labels, net.settings, net.figures)
    save_model(again, tmp_path / "again.npz")
    assert (tmp_path / "again.npz").read_bytes() == (tmp_path / "net.npz").read_bytes()


def test_rounded_weights_take_half_the_bytes_and_come_back(tmp_path: Path) -> None:
    """Against single precision; what two bytes cannot hold exactly is kept in four."""
    net = small_net()
    kernels = net.branches[0].kernels
    rounded = dataclasses.replace(changed(net, kernels=tuple(map(half, kernels))), weights=tuple(map(half, net.weights)))
    for one, other in zip((*rounded.branches[0].kernels, *rounded.weights), (*kernels, *net.weights), strict=True):
        np.testing.assert_allclose(one, other, rtol=2**-11, atol=6e-8)  # half a step of eleven bits; the least step there is
    save_model(rounded, tmp_path / "net.npz")
    with np.load(tmp_path / "net.npz") as file:
        assert {file[name].dtype for name in ("branch0.kernel_1", "weights_1")} == {np.dtype(np.float16)}
        assert file["bias_1"].dtype == np.float32
    again = load_model(tmp_path / "net.npz")
    np.testing.assert_array_equal(again.branches[0].kernels[1], rounded.branches[0].kernels[1])
    np.testing.assert_array_equal(again.weights[0], rounded.weights[0])
    assert half(np.array([1e9], np.float32))[0] == 65504.0


def test_bad_files_are_refused(tmp_path: Path) -> None:
    """No archive, cut off, without an array, of a newer format, with pickled objects: one clear error each."""
    good = tmp_path / "net.npz"
    save_model(small_net(), good)
    with np.load(good) as file:
        content = {name: file[name] for name in file.files}
    bad = tmp_path / "bad.npz"
    for text in (b"", b"no archive", good.read_bytes()[:500]):
        bad.write_bytes(text)
        with pytest.raises(ConfigError, match="not a gesture model"):
            load_model(bad)
    for change in (
        {"format": np.array(99)},
        {"branch0.mean": np.array([object()])},
        {"branch0.mean": content["branch0.mean"] * np.float32(np.nan)},
        {"about": np.zeros(3)},
    ):
        np.savez(bad, **(content | change))
        with pytest.raises(ConfigError, match=r"bad\.npz"):
            load_model(bad)
    np.savez(bad, **{name: array for name, array in content.items() if name != "branch0.kernel_1"})
    with pytest.raises(ConfigError, match="kernel_1"):
        load_model(bad)


def test_wrong_numbers_are_refused() -> None:
    """Shapes that do not fit when it is made, features that do not fit when it is asked."""
    net = small_net()
    with pytest.raises(ConfigError, match="scale"):
        changed(net, scale=net.branches[0].scale * 0)
    with pytest.raises(ConfigError, match="kernel_1"):
        changed(net, kernels=(net.branches[0].kernels[0], net.branches[0].kernels[1][:, :4]))
    with pytest.raises(ConfigError, match="take"):
        dataclasses.replace(net, branches=net.branches * 2, names=net.names * 2)  # two of the same kind
    with pytest.raises(ConfigError, match="take"):
        dataclasses.replace(net, branches=())
    with pytest.raises(ConfigError, match="take"):
        dataclasses.replace(net, names=net.names[1:])
    with pytest.raises(ConfigError, match="labels"):
        dataclasses.replace(net, labels=("a", "b"))
    with pytest.raises(DataError, match="expected"):
        net.probabilities(np.zeros(4))
    with pytest.raises(DataError, match="non-finite"):
        net.probabilities(np.full(len(NAMES), np.nan))


@pytest.mark.parametrize("mixup", [0.0, 0.4])
def test_training_learns_the_order_of_time_and_repeats(mixup: float) -> None:
    """Bumps early or late in noise 7 times smaller are told apart; the same seed gives the same network, another seed another."""
    pytest.importorskip("torch", reason="PyTorch is not installed (extra train)")
    rng = np.random.default_rng(3)
    x, label = waves(400, rng)
    settings = CurveTraining(channels=(6, 8), hidden=8, passes=15, batch=64, mixup=mixup)

    def train(seed: int) -> CurveNet:
        chosen = dataclasses.replace(settings, seed=seed)
        return train_net(x[None], label, labels=("late", "early"), inputs=(CurveConfig(steps=STEPS),), config=chosen)

    net = train(1)
    fresh, truth = waves(200, rng)
    assert np.mean(net.probabilities(fresh).argmax(axis=1) == truth) > 0.97
    np.testing.assert_array_equal(train(1).probabilities(fresh), net.probabilities(fresh))
    assert not np.array_equal(train(2).probabilities(fresh), net.probabilities(fresh))


def test_mixed_samples_have_mixed_labels() -> None:
    """Samples that are their own label stay so; one share for all, and over many draws it is 0 to 1 with the distribution's variance."""
    torch = pytest.importorskip("torch", reason="PyTorch is not installed (extra train)")
    from radar_lab.training.networks import _mixed

    target, shares = torch.arange(64) % 4, []
    x = torch.nn.functional.one_hot(target, 4).float()
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(5)
        for _ in range(400):
            mixed, label = _mixed(torch, x, target, 4, 0.4)
            torch.testing.assert_close(mixed, label)
            torch.testing.assert_close(label.sum(dim=1), torch.ones(64))
            shares.append(float(label.gather(1, target[:, None]).min()))
    assert min(shares) >= 0.0
    assert np.mean(shares) == pytest.approx(0.5, abs=4 * 0.373 / 20)
    assert np.std(shares) == pytest.approx(np.sqrt(0.25 / (2 * 0.4 + 1)), rel=0.1)


@contextmanager
def kept_networks() -> Iterator[list[Any]]:
    """Keep what is trained meanwhile: the layers in PyTorch, before they become a `CurveNet`."""
    from radar_lab.training import networks

    kept: list[Any] = []
    network = networks._Network

    class Kept(network):  # type: ignore[misc, valid-type]
        """Remembers what was trained."""

        def __init__(self, *args: object) -> None:
            super().__init__(*args)
            kept.append(self)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(networks, "_Network", Kept)
        yield kept


def test_numpy_gives_what_pytorch_gives() -> None:
    """The finished network, batch normalisation folded in, against the layers that were trained."""
    torch = pytest.importorskip("torch", reason="PyTorch is not installed (extra train)")
    with kept_networks() as kept:
        x, label = waves(200, np.random.default_rng(4))
        settings = CurveTraining(channels=(6, 8, 4), hidden=8, passes=3, batch=64)
        net = train_net(x[None], label, labels=("late", "early"), inputs=(CurveConfig(steps=STEPS),), config=settings)
    standard = np.clip((x - net.branches[0].mean) / net.branches[0].scale, -CLIP, CLIP).astype(np.float32)
    with torch.no_grad():
        expected = torch.softmax(kept[0](torch.from_numpy(standard)), dim=1).numpy()
    # half precision moves each weight by up to 2^-12 of it, and some twenty products of order 1 add up to a score
    np.testing.assert_allclose(net.probabilities(x), expected, atol=2e-3)


def test_training_refuses_what_does_not_fit() -> None:
    """As many labels as samples."""
    with pytest.raises(DataError, match="samples have shape"):
        train_net(np.zeros((1, 3, len(NAMES)), np.float32), np.zeros(4, np.int64), labels=("a",), inputs=(CurveConfig(steps=STEPS),))
