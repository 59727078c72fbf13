"""Networks with other inputs, averaged to one: scores, files, training, tuning, and what the recogniser makes for it."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import pytest
from test_cells import CONFIG, events
from test_cells import small_net as on_cells
from test_cells import vectors as cell_vectors
from test_curve_net import NAMES
from test_curve_net import small_net as on_curves

from radar_core import ConfigError
from radar_gestures.classifiers.curve_net import CurveNet, averaged
from radar_gestures.classifiers.enrolled import Enrolled
from radar_gestures.classifiers.model import load_model, save_model
from radar_gestures.inputs import USUAL, InputMaker, kind_of, maker_for
from radar_gestures.recognizer import make_extractor
from radar_gestures.signals import CurveConfig
from radar_lab.training.curve_training import remember
from radar_lab.training.networks import COUNTS, CurveTraining, train_net
from radar_lab.training.operations import operations
from radar_lab.training.tuning import TuningConfig, tune
from radar_lab.training.variation import FARTHER, VariationConfig, copies, usual_variation

BOTH = (CONFIG, CurveConfig(steps=5))


def scores(net: CurveNet, x: np.ndarray) -> np.ndarray:
    """Logarithms of the probabilities: scores before the softmax but for a constant of each row."""
    found = np.log(net.probabilities(x))
    return np.asarray(found - found.mean(axis=1, keepdims=True))


def pair(n: int = 6) -> tuple[CurveNet, CurveNet, np.ndarray, np.ndarray]:
    """Two networks and samples of each."""
    rng = np.random.default_rng(1)
    return on_cells(), on_curves(), cell_vectors(n, rng), rng.standard_normal((n, len(NAMES))).astype(np.float32)


def test_scores_are_the_mean_of_both() -> None:
    """Against the two networks by themselves; labels, settings and kinds of both are in it."""
    cells, curves, x, y = pair()
    both = averaged([cells, curves])
    found = scores(both, np.concatenate([x, y], axis=1))
    # half precision moves each last weight by up to 2^-11 of it
    np.testing.assert_allclose(found, (scores(cells, x) + scores(curves, y)) / 2, rtol=1e-3, atol=1e-2)
    weighted = scores(averaged([cells, curves], [3.0, 1.0]), np.concatenate([x, y], axis=1))
    np.testing.assert_allclose(weighted, 0.75 * scores(cells, x) + 0.25 * scores(curves, y), rtol=1e-3, atol=1e-2)
    assert both.extractor == "cells+curves"
    assert both.settings == {**cells.settings, **curves.settings}
    assert both.names == cells.names + curves.names
    assert averaged([curves]).probabilities(y) == pytest.approx(curves.probabilities(y), abs=5e-3)
    assert operations(both) == operations(cells) + operations(curves) - 5 * 4 + 2 * 2 * 18 * 6 - 2 * 4  # blocks of 0, one sum, one softmax


def test_what_cannot_be_averaged_is_refused() -> None:
    """Other labels, the same inputs twice, nothing, counts that do not fit."""
    cells, curves, _, _ = pair()
    with pytest.raises(ConfigError, match="averaged"):
        averaged([cells, dataclasses.replace(curves, labels=("a", "b", "c", "e"))])
    with pytest.raises(ConfigError, match="averaged"):
        averaged([])
    with pytest.raises(ConfigError, match="cells, cells"):
        averaged([cells, cells])
    for counts in ([1.0], [1.0, 0.0], [1.0, -1.0], [1.0, np.nan], [1.0, np.inf]):
        with pytest.raises(ConfigError, match="counts"):
            averaged([cells, curves], counts)


def test_its_file_gives_the_same_network_back(tmp_path: Path) -> None:
    """Same numbers; as the base of an enrolled person too."""
    cells, curves, x, y = pair()
    both, z = averaged([cells, curves]), np.concatenate([x, y], axis=1)
    for name, model in (("net", both), ("enrolled", Enrolled(both, {"Ada": both}, ""))):
        save_model(model, tmp_path / f"{name}.npz")
        again = load_model(tmp_path / f"{name}.npz")
        np.testing.assert_array_equal(again.probabilities(z), both.probabilities(z))
        assert (again.extractor, again.names) == ("cells+curves", both.names)


def test_tuning_changes_what_is_said_of_new_samples() -> None:
    """Layers of both are tuned at once: samples unlike all others get a new name, the others keep theirs."""
    rng = np.random.default_rng(2)
    both = averaged([on_cells(), on_curves()])
    z = np.concatenate([cell_vectors(60, rng), rng.standard_normal((60, len(NAMES))).astype(np.float32)], axis=1)
    z[:10, -len(NAMES) :] += 4.0
    said = both.probabilities(z).argmax(axis=1)
    known = remember(both, z[10:], said[10:])
    tuned = tune(known, z[:10], ["new"] * 10, TuningConfig(steps=300, weight=1.0, dropout=0.0))
    assert isinstance(tuned, CurveNet)
    assert tuned.extractor == both.extractor
    assert np.mean(tuned.probabilities(z[:10]).argmax(axis=1) == 4) >= 0.9
    assert np.mean(tuned.probabilities(z[10:]).argmax(axis=1) == said[10:]) >= 0.8


def test_inputs_are_those_of_each_kind_one_behind_the_other() -> None:
    """Vectors, copies and names against each kind by itself; a model's settings make the same maker."""
    made = events(np.random.default_rng(3))
    maker = InputMaker(BOTH)
    alone = [InputMaker((one,)) for one in BOTH]
    np.testing.assert_array_equal(maker.process_many(made), np.concatenate([one.process_many(made) for one in alone], axis=1))
    assert maker.names == alone[0].names + alone[1].names
    for variation in (None, VariationConfig()):
        apart = [copies(made, (one,), variation, n=2, seed=1) for one in BOTH]
        np.testing.assert_array_equal(copies(made, BOTH, variation, n=2, seed=1), np.concatenate(apart, axis=2))
    far = [copies(made, (one,), dataclasses.replace(usual_variation(one), place_noise=FARTHER), n=2, seed=1) for one in BOTH]
    np.testing.assert_array_equal(copies(made, BOTH, n=2, seed=1, farther=True), np.concatenate(far, axis=2))
    settings = {kind_of(one): dataclasses.asdict(one) for one in BOTH}
    assert maker_for("cells+curves", settings).names == maker.names == make_extractor("cells+curves", settings)[0]
    assert maker_for("curves+cells", {}).names == InputMaker(USUAL[::-1]).names
    with pytest.raises(ConfigError, match="extractor 'cells\\+other'"):
        make_extractor("cells+other", settings)


def test_each_is_trained_as_if_it_were_alone() -> None:
    """The branches of a network on both against two networks on one each, with the same seed."""
    pytest.importorskip("torch", reason="PyTorch is not installed (extra train)")
    rng = np.random.default_rng(4)
    made = events(rng, (8,) * 80)
    label = rng.integers(0, 2, 80)
    samples = copies(made, BOTH, n=2, seed=1)
    config = CurveTraining(channels=(6, 8), hidden=8, cell_width=8, passes=3, batch=32)
    both = train_net(samples, label, labels=("a", "b"), inputs=BOTH, config=config, settings={"one": 1})
    n = len(InputMaker(BOTH[:1]).names)
    alone = [
        train_net(part, label, labels=("a", "b"), inputs=(one,), config=config)
        for part, one in zip((samples[..., :n], samples[..., n:]), BOTH, strict=True)
    ]
    parts = np.split(samples[0], [n], axis=1)
    for number, (net, part) in enumerate(zip(alone, parts, strict=True)):
        np.testing.assert_array_equal(both.branches[number].process(part), net.branches[0].process(part))
    total = sum(COUNTS[kind_of(one)] * scores(net, part) for one, net, part in zip(BOTH, alone, parts, strict=True))
    mean = total / sum(COUNTS[kind_of(one)] for one in BOTH)
    np.testing.assert_allclose(scores(both, samples[0]), mean, atol=1e-3)
    assert both.settings == {"one": 1}
