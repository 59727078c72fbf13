"""Time budgets: times of any size, clocks that stand still or go back, a million frames, levels that make no sense."""

import math

import numpy as np
import pytest

from radar_core import ConfigError, DataError
from radar_core.governor import Governor, StepConfig
from radar_core.ladder import Level

LEVELS = tuple(Level(str(k), {}, 1, time, 0.1 * k) for k, time in enumerate((4.0, 2.0, 1.0)))


@pytest.mark.parametrize("time_ms", [0.0, 5e-324, 1e-300, 1e300, 1.7e308])
def test_times_of_any_size_choose_a_level(time_ms):
    """Ratios that overflow or vanish: the quickest level for endless frames, the best for none, and never a NaN."""
    governor = Governor(LEVELS, 3.0, StepConfig(recover=0.0))
    for k in range(200):
        governor.process(time_ms, 0.02 * k)
        assert not math.isnan(governor.expected_ms)
    assert governor.level == (2 if time_ms > 1 else 0)


@pytest.mark.parametrize("levels", [[5e-324], [1e-300, 1e-308], [1e308, 1e300]])
def test_levels_of_any_size_are_compared(levels):
    """Times at the ends of the floating-point range, beside frames of usual ones."""
    governor = Governor([Level(str(k), {}, 1, time, 0.0) for k, time in enumerate(levels)], 3.0)
    for k in range(200):
        governor.process(2.0, 0.02 * k)
    assert 0 <= governor.level < len(levels)
    assert not math.isnan(governor.expected_ms)


def test_a_clock_that_stands_still_changes_nothing():
    """No window ends, so nothing is decided; a clock that goes back is refused, and the next good frame is as good as any."""
    governor = Governor(LEVELS, 5.0)
    assert all(governor.process(100.0, 7.0) is None for _ in range(1000))
    with pytest.raises(DataError, match="never goes back"):
        governor.process(1.0, 6.9)
    assert governor.level == 0
    assert governor.process(100.0, 8.0) is not None


@pytest.mark.parametrize(("spent", "now"), [(math.nan, 0.0), (math.inf, 0.0), (-1e-9, 0.0), (1.0, math.nan), (1.0, -math.inf)])
def test_times_that_are_none_are_refused(spent, now):
    """With a message that names them; what was known stays."""
    governor = Governor(LEVELS, 5.0)
    with pytest.raises(DataError, match="spent_ms is"):
        governor.process(spent, now)
    assert (governor.level, governor.expected_ms) == (0, 4.0)


@pytest.mark.parametrize("budget", [0.0, -1.0, math.nan, math.inf])
def test_budgets_that_are_none_are_refused(budget):
    """Zero means no budget, and that is not for the governor."""
    with pytest.raises(ConfigError, match="makes no sense"):
        Governor(LEVELS, budget)


@pytest.mark.long
def test_a_million_frames_leave_nothing_behind():
    """Six hours at 50 Hz with a load that comes and goes: memory stays a window's, and the last hour is as the first."""
    governor, rng = Governor(LEVELS, 6.0, StepConfig(window=0.2, recover=1.0)), np.random.default_rng(0)
    scatter = rng.uniform(0.9, 1.1, 10_000)
    seen = []
    for k in range(1_000_000):
        load = 4.0 if k % 5000 < 1000 else 1.0
        governor.process(load * LEVELS[governor.level].time_ms * scatter[k % 10_000], 0.02 * k)
        if k % 5000 in (999, 4999):
            seen.append(governor.level)
            assert len(governor._ratios) <= 12  # 0.2 s of 50 Hz, and one at each end
    assert seen == [2, 0] * 200
