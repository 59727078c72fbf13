"""The search of noises, what is compared with what, and who is lost: by hand."""

import dataclasses
import math

import numpy as np
import pytest

from benchmarks import hand_gain
from benchmarks.hand_gain import OURS, lost, paired, ratios, thinned
from benchmarks.hand_runs import LOST, SETTLED, Followed, Tracked
from benchmarks.hand_search import START, search
from benchmarks.hand_snapshots import Judged, nees
from radar_core import RadarInfo


@pytest.mark.parametrize(("noise", "std"), [(4.0, 0.02), (64.0, 0.005), (0.5, 0.32)])
def test_the_search_finds_the_least_error_and_knows_that_it_lies_inside(noise, std):
    """A bowl in the logarithms of both noises, with its bottom at the start, down the valley, and across it."""

    def error(config):
        return 1.0 + math.log2(config.estimator.process_noise / noise) ** 2 + math.log2(config.position_std / std) ** 2

    found = search(error, "linear")
    assert found.inside
    assert found.knobs() == pytest.approx({"process_noise": noise, "position_std": std})
    assert found.config.estimator.name == "linear"


def test_an_optimum_that_was_not_reached_is_not_inside():
    """The more noise the better: the search ends by its limit, and says so."""
    found = search(lambda config: 1.0 / config.estimator.process_noise, "linear", most=30)
    assert not found.inside
    assert found.tried <= 30
    assert found.config.estimator.process_noise > START["process_noise"]


def scene(offset, n=40):
    """A hand that rests at the origin and a track that is so far from it, cloud by cloud; NaN: none."""
    zero, time = np.zeros((n, 3)), SETTLED + 0.02 * np.arange(n)
    place = zero.copy()
    place[:, 0] = offset
    tracked = Tracked([None] * n, RadarInfo(), time, zero, zero, zero)
    return tracked, Followed(place, zero, np.zeros((n, 6, 6)), place[:, 0], [None] * n, [0.0] * n)


def test_lost_hands_are_counted_and_do_not_count_as_errors():
    """Half of the clouds without a track, and half of them a metre off: both are lost, and the errors are those of the others."""
    away = np.where(np.arange(40) < 20, 0.05, np.nan)
    assert lost([scene(away), scene(0.05)]) == {"lost": 0.25, "lost_scenes": 1}
    assert lost([scene(LOST)])["lost"] == 1.0
    errors = paired({OURS: [scene(0.02)], "linear": [scene(away)]}, [np.ones(40, np.bool_)])
    assert {name: len(own[0]) for name, own in errors.items()} == {OURS: 20, "linear": 20}


def test_ratios_are_paired_and_their_interval_is_of_scenes():
    """Twice the error in every scene, whatever the scene: the ratio and its interval are a half; scenes without clouds do not count."""
    rng = np.random.default_rng(1)
    own = [rng.uniform(0.01, 0.1, 30) for _ in range(8)] + [np.empty(0)]
    found = ratios({OURS: own, "linear": [2 * one for one in own]})
    assert found["linear"]["ratio"] == pytest.approx(0.5)
    assert found["linear"]["interval"] == pytest.approx([0.5, 0.5])
    assert found["linear"]["scenes"] == 8
    one_bad = ratios({OURS: own, "linear": [*(2 * one for one in own[1:]), 9 * own[0]]})
    low, high = one_bad["linear"]["interval"]
    assert low < one_bad["linear"]["ratio"] < high
    assert ratios({OURS: [np.empty(0)], "linear": [np.empty(0)]}) == {}


def test_a_slower_radar_gives_every_second_cloud():
    tracked, _ = scene(0.0)
    half = thinned(tracked, 2)
    np.testing.assert_array_equal(half.time, tracked.time[::2])
    assert len(half.clouds) == len(half.hand) == 20
    assert set(hand_gain.RATES.values()) == {1, 2, 3, 5}


def test_the_nees_of_errors_that_are_as_told_is_one():
    """A thousand errors along two axes, the third not told; with twice the error it is four."""
    rng = np.random.default_rng(2)
    error, std = np.full((1000, 3), np.nan), np.tile([0.1, 0.3, 5.0], (1000, 1))
    error[:, :2] = std[:, :2] * rng.normal(size=(1000, 2))
    judged = Judged(error, error, std, np.ones(1000), np.ones(1000), np.zeros(1000, np.bool_), np.repeat(np.arange(20), 50))
    found = nees(judged)
    low, high = found["interval"]
    assert low < 1.0 < high
    assert found["nees"] == pytest.approx(1.0, abs=0.1)
    assert nees(dataclasses.replace(judged, error=2 * error))["nees"] == pytest.approx(4 * found["nees"])
