"""Cells of feature maps, and the network that looks at each: definitions written out, PyTorch, files, and what it can learn."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from test_curve_net import changed, kept_networks

from radar_core import ConfigError
from radar_core.arrays import description, read_description
from radar_gestures.cells import ATTRIBUTES, CellConfig, Cells, _evenly, cell_names, read_cells
from radar_gestures.classifiers.branch import CLIP, Branch, convolve
from radar_gestures.classifiers.curve_net import CurveNet
from radar_gestures.classifiers.model import load_model, save_model
from radar_gestures.classifiers.perceptron import ADVICE, FORMAT
from radar_gestures.curves import TOTALS
from radar_gestures.event_maps import EventMaps, locate
from radar_gestures.recognizer import make_extractor
from radar_lab.training.networks import CurveTraining, train_net
from radar_lab.training.operations import operations
from radar_lab.training.tuning import tune
from radar_lab.training.variation import VariationConfig, copies

SPEED = np.arange(-3, 4, dtype=np.float32) * np.float32(0.5)
STEPS, CELLS, WIDTH = 7, 12, 5
CONFIG = CellConfig(cells=CELLS)
NAMES = cell_names(CONFIG)
STILL = VariationConfig(ends=0, speed=0, place=0, amount=0, speed_noise=0, place_noise=0, amount_noise=0, lost=0)


def events(rng: np.random.Generator, lengths: tuple[int, ...] = (6, 9), seen: float = 0.4) -> EventMaps:
    """Draw maps of a body at 2 m, a share of whose gates is seen."""
    first = np.cumsum([0, *lengths])
    shape = (int(first[-1]), len(SPEED))
    there = rng.random(shape) < seen
    maps = np.stack(
        [
            np.where(there, rng.uniform(10, 30, shape), 0.0),
            np.where(there, rng.uniform(-0.1, 0.1, shape), np.nan),
            np.where(there, rng.uniform(-0.1, 0.1, shape), np.nan),
            np.where(there, rng.uniform(1.8, 2.2, shape), np.nan),
        ]
    )
    return EventMaps(first, np.concatenate([0.1 * np.arange(n) for n in lengths]), SPEED, maps.astype(np.float32))


def small_net(seed: int = 0) -> CurveNet:
    """Make a network of random numbers on cells: four labels."""
    rng = np.random.default_rng(seed)

    def draw(*shape: int) -> NDArray[np.float32]:
        return rng.standard_normal(shape).astype(np.float32)

    mean, scale = np.zeros(len(NAMES), np.float32), np.ones(len(NAMES), np.float32)
    branch = Branch(
        mean, scale, (draw(3, 2 * WIDTH + 1, 5), draw(3, 5, 4)), (draw(5), draw(4)), STEPS,
        cell_weights=(draw(len(ATTRIBUTES) - 1, WIDTH), draw(WIDTH, WIDTH)), cell_biases=(draw(WIDTH), draw(WIDTH)),
        pool_factor=draw(2 * WIDTH + 1), pool_offset=draw(2 * WIDTH + 1),
    )  # fmt: skip
    return CurveNet(
        (branch,), (draw(4 * 4 + 2, 6), draw(6, 4)), (draw(6), draw(4)),
        names=NAMES, labels=("a", "b", "c", "d"), settings={"cells": dataclasses.asdict(CONFIG)},
    )  # fmt: skip


def vectors(n: int, rng: np.random.Generator) -> NDArray[np.float32]:
    """Draw vectors with some cells each, in order of time."""
    cells = rng.standard_normal((n, CELLS, len(ATTRIBUTES))).astype(np.float32)
    cells[..., 1] = np.sort(rng.random((n, CELLS)), axis=1)
    cells[..., 0] = np.arange(CELLS) < rng.integers(0, CELLS + 1, n)[:, None]
    return np.concatenate([(cells * cells[..., :1]).reshape(n, -1), rng.random((n, 2))], axis=1).astype(np.float32)


def test_cells_are_the_detections_in_order_of_time() -> None:
    """Against the maps, cell by cell: time, speed, place beside the body, strength under the strongest."""
    made = events(np.random.default_rng(1))
    body = locate(made)
    config = CellConfig(cells=100)
    read = read_cells(made, config, body)
    for number in range(2):
        rows = slice(made.first[number], made.first[number + 1])
        snr, azimuth, elevation, distance = made.maps[:, rows].astype(np.float64)
        row, gate = np.nonzero(np.isfinite(distance))
        found = read[number][: len(row)]
        assert not read[number][len(row) :].any()
        np.testing.assert_array_equal(found[:, 0], 1.0)
        np.testing.assert_allclose(found[:, 1], made.time[rows][row] / made.duration[number])
        np.testing.assert_allclose(found[:, 2], SPEED[gate])
        far = distance[row, gate]
        np.testing.assert_allclose(found[:, 3], far - body[number, 0])
        side = far * np.cos(elevation[row, gate]) * np.sin(azimuth[row, gate])
        np.testing.assert_allclose(found[:, 4], side - body[number, 1], atol=1e-9)
        np.testing.assert_allclose(found[:, 5], far * np.sin(elevation[row, gate]) - body[number, 2], atol=1e-9)
        np.testing.assert_allclose(found[:, 6], (snr[row, gate] - snr[row, gate].max()) / 20, atol=1e-9)


def test_a_vector_has_its_names_and_the_totals_last() -> None:
    """Names and totals; a cell that is not the person's is left out."""
    made = events(np.random.default_rng(2))
    cells = Cells(CONFIG)
    found = cells.process_many(made)
    assert found.shape == (2, len(cells.names))
    assert cells.names[-2:] == TOTALS
    np.testing.assert_allclose(found[:, -2], made.duration)
    far = dataclasses.replace(made, maps=made.maps.copy())
    far.maps[3, 0] = 8.0  # a first frame of somebody else
    body = locate(made)
    mine = read_cells(far, CellConfig(cells=100), body)[0]
    assert mine[0, 1] > 0


@given(st.lists(st.integers(0, 40), min_size=1, max_size=8), st.integers(1, 20))
@settings(max_examples=60, deadline=None)
def test_cells_are_picked_evenly(counts: list[int], most: int) -> None:
    """At most so many of each event, all where there are fewer, ascending, and gaps between neighbours differ by at most one."""
    count = np.array(counts, np.int64)
    place, number = _evenly(count, most)
    for event, first in enumerate(np.cumsum(count) - count):
        own = place[(place >= first) & (place < first + count[event])] - first
        assert len(own) == min(count[event], most)
        if count[event] <= most:
            assert own.tolist() == list(range(count[event]))
        else:
            assert np.ptp(np.diff(own)) <= 1 if len(own) > 1 else True
    assert number.tolist() == [k for c in counts for k in range(min(c, most))]


def test_pooling_is_the_largest_and_the_mean_over_the_cells_of_a_step() -> None:
    """Against the definition, written out cell by cell, and the convolutions and layers behind it."""
    net, x = small_net(), vectors(6, np.random.default_rng(3))
    own = net.branches[0]
    for row, found in zip(x, net.inputs(x), strict=True):
        wave = np.zeros((STEPS, 2 * WIDTH + 1))
        of: list[list[NDArray[np.float64]]] = [[] for _ in range(STEPS)]
        for cell in np.clip(row[:-2], -CLIP, CLIP).reshape(CELLS, -1).astype(np.float64):
            if cell[0]:
                at = cell[1] * (STEPS - 1)
                step = int(np.rint(at))
                value = np.append(cell[2:], at - step)
                for weight, bias in zip(own.cell_weights, own.cell_biases, strict=True):
                    value = np.maximum(value @ weight + bias, 0)
                of[step].append(value)
        for step, values in enumerate(of):
            most, total = (np.max(values, axis=0), np.sum(values, axis=0)) if values else (np.zeros(WIDTH), np.zeros(WIDTH))
            wave[step] = np.concatenate([most, total / (len(values) + 1), [np.log1p(len(values))]]) * own.pool_factor + own.pool_offset
        once = wave[None].astype(np.float32)
        for number, (kernel, offset) in enumerate(zip(own.kernels, own.offsets, strict=True)):
            once = np.maximum(convolve(once, kernel, 1 if number == 0 else 2) + offset, 0)
        np.testing.assert_allclose(found[:-2], once.ravel(), rtol=1e-3, atol=1e-3)


def test_the_order_of_cells_and_empty_places_do_not_matter() -> None:
    """A permutation of the cells, with gaps among them, gives the same probabilities; so does what stands in empty places."""
    net, rng = small_net(), np.random.default_rng(4)
    x = vectors(8, rng)
    mixed = x.copy()
    cells = mixed[:, :-2].reshape(8, CELLS, -1)
    cells[:] = cells[:, rng.permutation(CELLS)]
    np.testing.assert_allclose(net.probabilities(mixed), net.probabilities(x), atol=1e-5)
    cells[..., 1:] += 3.0 * (cells[..., :1] == 0)
    np.testing.assert_allclose(net.probabilities(mixed), net.probabilities(x), atol=1e-5)
    nothing = np.zeros((1, len(NAMES)), np.float32)
    assert net.probabilities(nothing).sum() == pytest.approx(1.0)
    assert net.probabilities(nothing[:0]).shape == (0, 4)


def test_a_file_keeps_the_cells_and_older_files_know_none(tmp_path: Path) -> None:
    """Same numbers after reading; a file from before cells is a network on curves."""
    net, x = small_net(), vectors(3, np.random.default_rng(5))
    save_model(net, tmp_path / "net.npz")
    again = load_model(tmp_path / "net.npz")
    assert isinstance(again, CurveNet)
    assert again.extractor == "cells"
    np.testing.assert_array_equal(again.probabilities(x), net.probabilities(x))
    names, _ = make_extractor(again.extractor, again.settings)
    assert names == again.names


def test_files_of_earlier_versions_give_the_same_numbers() -> None:
    """One branch, its arrays without a number; before there were cells, with one number of layers less."""
    net, x = small_net(), vectors(3, np.random.default_rng(5))
    steps = (*(f"s{k}_{step:02d}" for step in range(STEPS) for k in range(2 * WIDTH + 1)), *TOTALS)
    zero, one = np.zeros(len(steps), np.float32), np.ones(len(steps), np.float32)
    branch = dataclasses.replace(net.branches[0], mean=zero, scale=one, cell_weights=(), cell_biases=())
    curves = dataclasses.replace(net, branches=(branch,), names=steps)
    memory = {"memory": net.inputs(x).astype(np.float16), "remembered": np.array([0, 1, 2])}
    for made, layers in ((dataclasses.replace(net, **memory), [2, 2, 2]), (curves, [2, 2, 0]), (curves, [2, 2])):
        arrays = {name.removeprefix("branch0."): array for name, array in made.arrays().items()}
        about = dict(read_description(arrays, FORMAT, ADVICE)) | {"layers": layers, "steps": STEPS}
        del about["branches"], about["dense"]
        older = CurveNet.from_arrays(about, arrays | description(FORMAT, about))
        assert older.extractor == ("cells" if made.branches[0].cell_weights else "curves")
        given = x if older.extractor == "cells" else np.ones((2, len(steps)), np.float32)
        np.testing.assert_array_equal(older.probabilities(given), made.probabilities(given))
        assert older.arrays().keys() == made.arrays().keys()


def test_wrong_shapes_are_refused() -> None:
    """A network whose layers do not fit its cells."""
    net = small_net()
    with pytest.raises(ConfigError, match="pool_factor"):
        changed(net, pool_factor=net.branches[0].pool_factor[:-1])
    with pytest.raises(ConfigError, match="cell_weights_0"):
        changed(net, cell_weights=(net.branches[0].cell_weights[0][1:], net.branches[0].cell_weights[1]))


def test_operations_grow_with_cells() -> None:
    """Twice as many cells cost the layers of the cells and their standardisation once more."""
    net, more = small_net(), cell_names(CellConfig(cells=2 * CELLS))
    wide = dataclasses.replace(net.branches[0], mean=np.zeros(len(more), np.float32), scale=np.ones(len(more), np.float32))
    double = dataclasses.replace(net, names=more, branches=(wide,))
    layers = sum(2 * weight.size + 2 * weight.shape[1] for weight in net.branches[0].cell_weights)
    assert operations(double) - operations(net) == CELLS * (layers + 2 * WIDTH + 2 * len(ATTRIBUTES))


def test_copies_without_variation_are_the_originals() -> None:
    """And with it each differs, by about as much as was asked for."""
    made = events(np.random.default_rng(6), (20, 20))
    plain = Cells(CONFIG).process_many(made)
    np.testing.assert_allclose(copies(made, (CONFIG,), STILL, n=2, seed=1), [plain, plain], atol=1e-6)
    noisy = copies(made, (CONFIG,), dataclasses.replace(STILL, speed_noise=0.2), n=200, seed=1).reshape(200, 2, -1)
    away = (noisy - plain)[..., :-2].reshape(200, 2, CELLS, -1)
    there = plain[:, :-2].reshape(2, CELLS, -1)[..., 0] > 0
    assert away[:, there, 2].std() == pytest.approx(0.2, rel=0.05)
    np.testing.assert_allclose(away[..., 3:], 0.0, atol=1e-6)
    np.testing.assert_allclose(away[:, ~there], 0.0, atol=1e-6)
    scattered = copies(made, (CONFIG,), dataclasses.replace(STILL, place_noise=0.3), n=200, seed=1).reshape(200, 2, -1)
    away = (scattered - plain)[..., :-2].reshape(200, 2, CELLS, -1)[:, there]
    places = [ATTRIBUTES.index(name) for name in ("range", "side", "height")]
    np.testing.assert_allclose(away[..., places].std(axis=(0, 1)), 0.3, rtol=0.1)
    np.testing.assert_allclose(np.delete(away, places, axis=-1), 0.0, atol=1e-6)


def bumps(n: int, rng: np.random.Generator) -> tuple[NDArray[np.float32], NDArray[np.int64]]:
    """Two classes that differ only in when the fast cells come."""
    x, label = vectors(n, rng), rng.integers(0, 2, n)
    cells = x[:, :-2].reshape(n, CELLS, -1)
    cells[..., 0] = 1.0
    cells[..., 1] = np.linspace(0, 1, CELLS)
    cells[..., 2] = 0.3 * rng.standard_normal((n, CELLS)) + 2.0 * ((cells[..., 1] < 0.3) == label[:, None])
    return x, label


@pytest.mark.parametrize("lost", [0.0, 0.4])
def test_numpy_gives_what_pytorch_gives_and_both_learn(lost: float) -> None:
    """Fast cells early or late are told apart; the finished network against the layers that were trained; the same seed repeats."""
    torch = pytest.importorskip("torch", reason="PyTorch is not installed (extra train)")
    x, label = bumps(300, np.random.default_rng(7))
    chosen = CurveTraining(channels=(6, 8), hidden=8, cell_width=8, cell_steps=STEPS, passes=15, batch=64, lost_cells=lost)
    with kept_networks() as kept:
        nets = [train_net(x[None], label, labels=("late", "early"), inputs=(CONFIG,), config=chosen) for _ in range(2)]
    fresh, truth = bumps(200, np.random.default_rng(8))
    assert np.mean(nets[0].probabilities(fresh).argmax(axis=1) == truth) > 0.97
    np.testing.assert_array_equal(nets[0].probabilities(fresh), nets[1].probabilities(fresh))
    own = nets[0].branches[0]
    standard = np.clip((fresh - own.mean) / own.scale, -CLIP, CLIP).astype(np.float32)
    with torch.no_grad():
        expected = torch.softmax(kept[0](torch.from_numpy(standard)), dim=1).numpy()
    np.testing.assert_allclose(nets[0].probabilities(fresh), expected, atol=5e-3)  # half precision of all weights


def test_losing_cells_loses_the_share() -> None:
    """Up to the share of each sample, half of it on average; nothing else changes."""
    torch = pytest.importorskip("torch", reason="PyTorch is not installed (extra train)")
    from radar_lab.training.networks import _Network

    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(1)
        net = _Network(torch, CurveTraining(cell_width=4), len(NAMES), STEPS, 2, True)
        x = torch.ones(4000, len(NAMES))
        found = net.lose_cells(x.clone(), 0.4)
    there = found[:, :-2].reshape(4000, CELLS, -1)
    assert (there[..., 1:] == 1).all()
    assert (found[:, -2:] == 1).all()
    assert 1.0 - float(there[..., 0].mean()) == pytest.approx(0.2, abs=0.01)


def test_a_new_gesture_is_learnt_from_few_samples() -> None:
    """A network on cells is tuned as one on curves: memory, new label."""
    from radar_lab.training.curve_training import remember

    rng = np.random.default_rng(9)
    x, label = vectors(80, rng), rng.integers(0, 4, 80)
    net = small_net()
    small = tuple(np.float32(0.1) * weight for weight in net.weights)  # probabilities as even as those of a network in doubt
    net = remember(dataclasses.replace(net, weights=small), x, label)
    new = x[:4].copy()
    new[:, : -2 : len(ATTRIBUTES)], new[:, 2 : -2 : len(ATTRIBUTES)] = 1.0, 5.0
    taught = tune(net, new, ["zig"] * 4)
    assert taught.labels == (*net.labels, "zig")
    assert taught.probabilities(new).argmax(axis=1).tolist() == [4] * 4
