"""The governor of a time budget against machines whose speed is known: it fits, it does not flutter, it comes back."""

import dataclasses
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from radar_core import ConfigError, DataError
from radar_core.governor import Governor, StepConfig
from radar_core.ladder import Ladder, Level, load_ladders, save_ladders

INTERVAL = 0.02
LEVELS = tuple(
    Level(f"level {k}", {"knob": k}, every, time, 0.2 + 0.05 * k) for k, (every, time) in enumerate([(1, 4), (1, 2), (2, 2), (5, 2)])
)
"""Costs of 4, 2, 1 and 0.4 ms for each frame of the radar."""


class Machine:
    """A device so many times slower than the one that was tuned, with a governor; frames come every 20 ms."""

    def __init__(self, budget_ms=5.0, seed=0, spread=0.0, **config):
        self.governor = Governor(LEVELS, budget_ms, StepConfig(**config))
        self.rng, self.spread, self.now, self.steps, self.number = np.random.default_rng(seed), spread, 0.0, [], 0

    def run(self, seconds, slower, slower_at=None):
        """Let it work for a while; ``slower_at`` gives a level another factor than the rest."""
        end = self.now + seconds
        while self.now < end:
            level = LEVELS[self.governor.level]
            self.number += 1
            self.now += INTERVAL
            if self.number % level.every:
                continue
            factor = (slower_at or {}).get(self.governor.level, slower)
            spent = level.time_ms * factor * float(np.exp(self.spread * self.rng.standard_normal()))
            step = self.governor.process(spent, self.now)
            if step is not None:
                self.steps.append((self.now, step))
        return self


def test_the_most_accurate_level_that_fits_is_chosen_at_the_start():
    """As tuned: 5 ms hold 4 ms, 3 ms hold 2 ms, 0.5 ms hold 0.4 ms; nothing fits 0.1 ms, and the quickest is the best that there is."""
    assert [Governor(LEVELS, budget).level for budget in (5.0, 4.0, 3.0, 1.5, 0.5, 0.1)] == [0, 0, 1, 2, 3, 3]


@given(st.floats(0.05, 30.0), st.floats(0.1, 20.0))
def test_a_steady_machine_settles_at_a_level_that_fits_and_stays(slower, budget):
    """Whatever the speed: after a few windows the level fits (or is the quickest), and never changes again."""
    machine = Machine(budget, recover=1.0).run(10.0, slower)
    level = machine.governor.level
    cost = slower * LEVELS[level].cost_ms
    assert cost <= budget or level == len(LEVELS) - 1
    if level:  # the next better one would take more than what is left to it
        assert slower * LEVELS[level - 1].cost_ms > 0.8 * budget * (1 - 1e-9)
    n = len(machine.steps)
    machine.run(60.0, slower)
    assert (machine.governor.level, len(machine.steps)) == (level, n)


def test_overload_is_answered_within_a_second_and_a_half():
    """Ten times slower: 40 ms frames at 4 ms; one window of half a second and the frames on the way."""
    machine = Machine().run(3.0, 1.0)
    assert machine.governor.level == 0
    start = machine.now
    machine.run(10.0, 10.0)
    assert machine.governor.level == 3
    assert [step.after for _, step in machine.steps] == [3]
    at, step = machine.steps[0]
    assert at - start < 1.5
    assert step.measured_ms > 5.0
    # the median of a window that has just turned slow: between what it was and what it is
    assert step.expected_ms <= 4.0


def test_it_comes_back_when_the_load_is_gone():
    """After `recover` at the better speed, not before; straight to the best level that fits."""
    machine = Machine(recover=3.0).run(5.0, 10.0)
    gone = machine.now
    machine.run(30.0, 1.0)
    assert machine.governor.level == 0
    (at, step) = machine.steps[-1]
    assert step.after == 0
    assert 3.0 <= at - gone <= 5.0


@pytest.mark.parametrize("seed", range(4))
def test_noise_does_not_make_it_flutter(seed):
    """Times that scatter by 30 % about 90 % of the budget: medians of 25 scatter by 8 %, and a level up needs 20 % of reserve."""
    machine = Machine(budget_ms=4.0 / 0.9, seed=seed, spread=0.3, recover=2.0).run(600.0, 1.0)
    assert len(machine.steps) <= 12  # a step down, and tries that fail, each waiting twice as long: log2(600 / 2) is 8


def test_tries_that_fail_become_rare():
    """The best level is far slower than it was when tuned, what the others cannot tell: each try waits twice as long, up to 64-fold."""
    machine = Machine(recover=1.0).run(1000.0, 1.0, {0: 3.0})
    tries = [at for at, step in machine.steps if step.after == 0]
    waits = np.diff(tries)
    assert 6 <= len(tries) <= 22  # 1 + 2 + 4 + ... + 64 s, then every 64 s
    assert (waits[1:] >= waits[:-1] * 0.95).all()
    assert 64.0 <= waits[-1] < 66.0


def test_old_failures_are_forgotten():
    """A level that has held for long was no failure: the next overload ends as quickly as the first."""
    machine = Machine(recover=1.0).run(20.0, 1.0, {0: 3.0}).run(300.0, 1.0)
    assert machine.governor.level == 0
    machine.run(5.0, 10.0)
    gone = machine.now
    machine.run(20.0, 1.0)
    assert machine.governor.level == 0
    assert machine.steps[-1][0] - gone < 4.0


def test_one_late_frame_changes_nothing():
    """A frame of a second among quick ones is no overload."""
    governor = Governor(LEVELS, 5.0)
    assert not [step for k in range(1000) if (step := governor.process(1000.0 if k % 50 == 7 else 4.0, k * INTERVAL))]


@given(st.lists(st.tuples(st.floats(0, 1e6), st.floats(0, 10.0)), max_size=200))
def test_any_times_leave_it_in_order(frames):
    """Whatever is measured: the level exists, steps tell where they go, and expected times are finite."""
    governor, now = Governor(LEVELS, 3.0), 0.0
    for spent, pause in frames:
        now, before = now + pause, governor.level
        step = governor.process(spent, now)
        assert 0 <= governor.level < len(LEVELS)
        assert math.isfinite(governor.expected_ms)
        assert (step is None) == (governor.level == before)
        if step is not None:
            assert (step.before, step.after) == (before, governor.level)


@settings(max_examples=20)
@given(st.floats(0.1, 10.0), st.integers(0, 1000))
def test_it_knows_no_unit(scale, seed):
    """All times, levels' and budget, in another unit: the same steps."""
    levels = tuple(dataclasses.replace(level, time_ms=level.time_ms * 2.0 ** round(math.log2(scale))) for level in LEVELS)
    unit, rng = 2.0 ** round(math.log2(scale)), np.random.default_rng(seed)
    one, other = Governor(LEVELS, 3.0, StepConfig(recover=0.5)), Governor(levels, 3.0 * unit, StepConfig(recover=0.5))
    for k in range(300):
        spent = float(rng.uniform(0, 8))
        one.process(spent, k * INTERVAL)
        other.process(spent * unit, k * INTERVAL)
        assert one.level == other.level


def test_what_makes_no_sense_is_refused():
    """Each with a message that names it."""
    for value, now in ((math.nan, 0.0), (-1.0, 0.0), (1.0, math.inf)):
        with pytest.raises(DataError, match="spent_ms"):
            Governor(LEVELS, 1.0).process(value, now)
    for budget in (0.0, -1.0, math.nan, math.inf):
        with pytest.raises(ConfigError, match="budget"):
            Governor(LEVELS, budget)
    with pytest.raises(ConfigError, match="at least one level"):
        Governor((), 1.0)
    for bad in ({"time_ms": 0.0}, {"time_ms": math.inf}, {"accuracy": math.nan}, {"every": 0}):
        with pytest.raises(DataError, match=f"Level.{next(iter(bad))} of 'level 0'"):
            dataclasses.replace(LEVELS[0], **bad)
    with pytest.raises(DataError, match="'level 0' is not quicker than 'level 1'"):
        Ladder("baseband", "error", "m", "lower", LEVELS[1::-1])
    with pytest.raises(DataError, match="is empty"):
        Ladder("baseband", "error", "m", "lower", ())
    with pytest.raises(DataError, match="lower, higher"):
        Ladder("baseband", "error", "m", "best", LEVELS)


def test_levels_survive_their_file(tmp_path):
    """Bit for bit, by stage; and what cannot be read says what to do."""
    ladders = [Ladder("baseband", "error", "m", "lower", LEVELS, "here"), Ladder("tracking", "hits", "", "higher", LEVELS[:1])]
    path = tmp_path / "levels.json"
    save_ladders(path, ladders)
    assert load_ladders(path) == {one.stage: one for one in ladders}
    assert [p.name for p in tmp_path.iterdir()] == ["levels.json"]
    with pytest.raises(ConfigError, match="handwave tradeoff --tune"):
        load_ladders(tmp_path / "missing.json")
    for text, message in (
        ("{", "no JSON"),
        ("[]", "format 1"),
        ('{"format": 1}', "stages"),
        ('{"format": 1, "stages": {"a": {}}}', "missing"),
    ):
        path.write_text(text)
        with pytest.raises(ConfigError, match=message):
            load_ladders(path)
