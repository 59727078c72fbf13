"""How much memory a process grows by, from samples of its life."""

import numpy as np
import pytest

from benchmarks.soak import Life, Soak


def life(rss):
    """A process that was seen every ten seconds for an hour; ``rss`` [MB] after so many hours."""
    times = np.arange(0.0, 3600.0, 10.0)
    noise = np.random.default_rng(1).normal(0.0, 0.1, len(times))
    return Life("view", times.tolist(), (rss(times / 3600) + noise).tolist(), [9] * len(times), [4] * len(times))


def test_growth_is_the_slope_after_the_beginning_and_the_faults():
    """The first ten minutes do not count, nor does what was held while nodes were killed; the truth is within three standard errors."""
    grown = life(lambda hours: 100.0 + 2.0 * hours - 30.0 * (hours < 1 / 6))
    slope, error = grown.growth()
    assert slope == pytest.approx(2.0, abs=error)
    assert error < 0.2
    disturbed = life(lambda hours: 100.0 + 2.0 * hours - 3.0 * (hours < 0.25))
    assert disturbed.growth()[0] > 3.0
    soak = Soak(quick=False)
    soak.lives = {7: disturbed, 8: life(lambda hours: hours)}
    late = (disturbed.times[90:], disturbed.rss[90:])
    del disturbed.times[90:], disturbed.rss[90:]
    soak.calm({7})
    disturbed.times.extend(late[0])
    disturbed.rss.extend(late[1])
    assert set(soak.lives) == {7}
    slope, error = disturbed.growth()
    assert slope == pytest.approx(2.0, abs=error)


def test_a_short_life_has_no_growth():
    """Too few samples after the beginning: nothing is said."""
    short = life(lambda hours: hours)
    short.disturbed = len(short.times) - 59
    assert short.growth() is None
    short.disturbed -= 1
    assert short.growth() is not None
