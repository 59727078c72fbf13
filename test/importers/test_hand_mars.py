"""Both hands of real people from one radar's sparse clouds, beside a Kinect (skipped where the recordings are absent)."""

import dataclasses
import functools

import numpy as np
import pytest
from originals import recordings

from benchmarks.hand_mars import KNOWN, STRANGERS, Split, exercises, figures_of, geometric_figures, kinect_place, over_tests
from radar_lab.posture.training import PostureTrainingConfig, fit_postures, samples_of


@functools.cache
def split(train: tuple[str, ...], test: tuple[str, ...]) -> Split:
    """Files, or skip."""
    for name in (*train, *test):
        recordings("mars", f"{name}.npz")
    return Split.of(train, test)


@functools.cache
def figures(train: tuple[str, ...], test: tuple[str, ...], members: int = 4) -> dict:
    """Train and test, with the parts left out in two halves only: they measure the deviation, which few of these tests need."""
    own = split(train, test)
    settings = dataclasses.replace(PostureTrainingConfig(), members=members, folds=2)
    model = fit_postures(samples_of(own.recordings, settings.features), settings)
    return {name: figures_of(own, name, found) for name, found in over_tests(own, model).items()}


@pytest.mark.long
@pytest.mark.parametrize("name", KNOWN[1])
def test_known_people_are_a_third_better_than_their_mean_pose(name):
    """The goal: at least 30 % less error (rms) than the mean pose while a hand moves, in every file and for each hand.

    Measured: 0.50 and 0.52, each hand 0.49 to 0.52. Single perceptrons reach 0.55 and differ by 0.02, the mean of four by less.
    """
    found = figures(*KNOWN)[name]
    assert found["seen"] > 0.99
    assert found["ratio"] <= 0.60
    assert found["left_ratio"] <= 0.65
    assert found["right_ratio"] <= 0.65
    assert found["median_m"] < 0.7 * found["mean_pose_median_m"]


@pytest.mark.long
@pytest.mark.parametrize("name", KNOWN[1])
def test_the_deviation_that_is_told_is_right_on_average(name):
    """Variances within a factor of 1.6, moving and always. Measured: 0.75 to 0.88, for one perceptron is judged and four are used."""
    found = figures(*KNOWN)[name]
    assert 1 / 1.6 < found["nees"] < 1.6
    assert 1 / 1.6 < found["nees_all"] < 1.6


@pytest.mark.long
@pytest.mark.parametrize(("train", "test"), STRANGERS)
def test_a_stranger_is_still_better_than_the_mean_pose(train, test):
    """The other person held out: no goal, but what the docs say, 0.71 to 0.77 (with one perceptron a little more, hence the bound)."""
    for found in figures(train, test, members=1).values():
        assert found["ratio"] < 0.90


@pytest.mark.long
def test_the_hand_tracker_for_dense_clouds_cannot_do_it():
    """Why there is something learned at all: the arms are too sparse for `HandTracker`, which is twice as far off as the mean pose."""
    own = split(*KNOWN)
    assert geometric_figures(own, "subject3_test")["ratio"] > 1.0


@pytest.mark.long
def test_the_kinect_stood_a_hand_beside_the_radar():
    """Places fitted to every file alone agree to 0.1 m: one rig, two people of different size."""
    for name in (*KNOWN[0], *KNOWN[1]):
        recordings("mars", f"{name}.npz")
    places = np.array([kinect_place([name]) for name in (*KNOWN[0], *KNOWN[1])])
    assert np.ptp(places, axis=0).max() < 0.1
    assert (np.abs(places.mean(axis=0) - [-0.07, 0.17, 1.16]) < 0.05).all()
    assert exercises("subject1_test").moving.mean() > 0.1
