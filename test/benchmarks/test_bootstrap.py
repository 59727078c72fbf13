"""The bootstrap over people, rooms and scenes, against worlds whose share is known."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.report import share_interval
from radar_lab.evaluation.bootstrap import ratio_interval


def test_an_interval_of_people_who_differ_holds_the_share_of_all_people():
    """Forty people with a share of their own each: 95 % of intervals hold the mean; Wilson's, which takes all as alike, do not."""
    rng = np.random.default_rng(3)
    by_people, pooled = 0, 0
    for _ in range(400):
        right = rng.binomial(25, rng.beta(2.0, 1.0, 40))
        low, high = ratio_interval(right, np.full(40, 25), draws=400)
        by_people += low <= 2 / 3 <= high
        low, high = share_interval(int(right.sum()), 1000)
        pooled += low <= 2 / 3 <= high
    assert 0.91 <= by_people / 400 <= 0.98
    assert pooled / 400 < 0.7


def test_an_interval_knows_no_unit_of_either():
    """Seconds or hours, the rate is the same; and the more units are alike, the narrower it is."""
    events, hours = np.array([3.0, 0.0, 5.0, 1.0]), np.array([1.0, 2.0, 2.0, 1.0])
    low, high = ratio_interval(events, hours)
    assert ratio_interval(events, hours * 3600) == pytest.approx((low / 3600, high / 3600))
    narrow = ratio_interval(np.tile(events, 50), np.tile(hours, 50))
    assert low < narrow[0] < 1.5 < narrow[1] < high


def test_what_is_alike_has_no_width_and_nothing_has_no_interval():
    assert ratio_interval([2, 2, 2], [4, 4, 4]) == (0.5, 0.5)
    assert ratio_interval([], []) is None
    assert ratio_interval([0, 0], [0, 0]) is None
    low, high = ratio_interval([1, 0], [1, 0])  # one of two has nothing: draws of it alone do not count
    assert (low, high) == (1.0, 1.0)
    with pytest.raises(ValueError, match="zip"):
        ratio_interval([1], [1, 2])
