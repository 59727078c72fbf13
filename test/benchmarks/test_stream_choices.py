"""The choices of networks on streams: what is learned and tested, and members that are kept one by one."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from benchmarks.stream_choices import BASE, PANELS, parted, slot_times
from benchmarks.stream_model import members
from radar_core import GESTURES, RadarInfo
from radar_gestures.stream.slots import NAMES
from radar_lab.datasets.life_scenes import KINDS, kind_of
from radar_lab.training.slot_sequences import LifeSlots, SlotSequence
from radar_lab.training.stream_training import StreamTraining, train_stream_net


def sequence(seed, n=60):
    rng = np.random.default_rng(seed)
    features = rng.normal(size=(n, len(NAMES))).astype(np.float32)
    return SlotSequence(features, rng.integers(0, len(GESTURES), n), np.ones(n, np.float32), np.full(n, -1))


def test_every_panel_has_the_base_and_differs_from_it_in_one_knob():
    for configs in PANELS.values():
        assert BASE in configs.values()
        for config in configs.values():
            ours, base = dataclasses.asdict(config), dataclasses.asdict(BASE)
            assert sum(ours[knob] != base[knob] for knob in base) <= 1


def test_lives_to_learn_from_and_to_test_on_are_disjoint_and_hold_every_kind_of_radar():
    lives = [LifeSlots(number, kind_of(number), RadarInfo(), 0.5, (), ()) for number in range(100)]
    learned, tested = parted(lives)
    assert sorted(life.number for life in learned + tested) == list(range(100))
    assert len(tested) == 20
    assert {life.kind for life in learned} == {life.kind for life in tested} == set(KINDS)


def test_members_that_are_kept_one_by_one_are_those_that_are_trained_together(tmp_path):
    """And what is kept is not trained again, also by somebody who wants fewer."""
    pytest.importorskip("torch")
    known = [sequence(1), sequence(2)]
    config = StreamTraining(members=2, passes=1, width=4, dilations=(1, 2), length=32, batch=2)
    together = train_stream_net(known, config=config)
    apart = members(tmp_path, known, config)
    x = sequence(3).features
    np.testing.assert_array_equal(apart.probabilities(x), together.probabilities(x))
    files = {path: path.stat().st_mtime_ns for path in (tmp_path / "parts").iterdir()}
    assert len(files) == 2
    one = members(tmp_path, known, dataclasses.replace(config, members=1))
    assert len(one.members) == 1
    assert {path: path.stat().st_mtime_ns for path in (tmp_path / "parts").iterdir()} == files
    members(tmp_path, known, dataclasses.replace(config, members=1), [sequence(4)])  # with something else to learn from: another one
    assert len(list((tmp_path / "parts").iterdir())) == 3
    assert set(slot_times({"one": one, "two": apart}, x, 7)) == {"one", "two"}
    assert all(len(times) == 7 for times in slot_times({"one": one, "two": apart}, x[:3], 7).values())
