"""The fit of the log odds of being a person."""

import dataclasses

import numpy as np
import pytest

from benchmarks.person_odds import fit, in_room
from benchmarks.room_scenes import boards
from benchmarks.room_score import KeptRoom
from radar_core import PointCloud
from radar_sim import Truth
from radar_tracking.poisson.person import FEATURES


def samples_of_a_law(n: int = 40_000) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Samples of a logistic law with features of any scale, and its coefficients; the constant is -0.5."""
    rng = np.random.default_rng(1)
    x = rng.normal(0, 1, (n, 3)) * [1.0, 10.0, 0.1] + [0.0, 5.0, 0.0]
    slope = np.array([0.8, 0.1, -5.0])
    return x, rng.random(n) < 1 / (1 + np.exp(-(-0.5 + x @ slope))), slope


def test_a_fit_finds_what_made_the_samples():
    """Without a prior constant and coefficients come back, wherever it began."""
    x, person, slope = samples_of_a_law()
    found, coefficients = fit(x, person, np.ones(len(x)), (0.0, np.array([-1.0, 0.0, 3.0])), 0.0, np.zeros(3, bool))
    assert found == pytest.approx(-0.5, abs=0.3)
    np.testing.assert_allclose(coefficients, slope, rtol=0.1, atol=0.01)


def test_what_is_held_keeps_its_value_and_the_others_find_theirs():
    x, person, slope = samples_of_a_law()
    before = np.array([0.0, slope[1], 0.0])
    found, coefficients = fit(x, person, np.ones(len(x)), (0.0, before), 0.0, np.array([False, True, False]))
    assert coefficients[1] == slope[1]
    np.testing.assert_allclose(coefficients[[0, 2]], slope[[0, 2]], rtol=0.1)
    assert found == pytest.approx(-0.5, abs=0.3)


@pytest.mark.parametrize(("prior", "least", "most"), [(1e-4, 0.9, 1.1), (0.1, 0.3, 0.9), (1e3, -0.01, 0.01)])
def test_a_prior_keeps_coefficients_near_what_they_were(prior, least, most):
    """The surer what was before, the smaller the part of the way that a coefficient goes."""
    x, person, slope = samples_of_a_law()
    before = np.array([0.0, slope[1], slope[2]])
    _, coefficients = fit(x, person, np.ones(len(x)), (0.0, before), prior, np.zeros(3, bool))
    assert least < coefficients[0] / slope[0] < most


@pytest.mark.long
def test_samples_of_a_room_are_what_the_truth_says():
    """Somebody walks and somebody else, of whom the truth knows nothing, 3 m aside: tracks on the first are people, the others are not."""
    rng, clouds, truths = np.random.default_rng(2), [], []
    info = boards()["design"]
    for k in range(300):
        t = 0.05 * k
        x = 3.0 - np.cos(t)
        places = np.array([[x, -1.5, 1.0], [x, 1.5, 1.0]])
        points = np.repeat(places, 10, axis=0) + rng.normal(0, [0.1, 0.1, 0.3], (20, 3))
        sight = points[:, :2] / np.hypot(points[:, 0], points[:, 1])[:, None]
        speed = sight[:, 0] * np.sin(t) + rng.normal(0, 0.1, 20)
        columns = [points[:, i].astype(np.float32) for i in range(3)]
        clouds.append(PointCloud(k * 50_000_000, k, "room", *columns, radial_speed=speed.astype(np.float32)))
        truths.append(one_person(clouds[-1], places[0]))
    room = KeptRoom(0, info, None, clouds, truths, [np.ones(1, bool)] * 300, np.zeros(300, np.float32))
    samples = list(in_room(room))
    person = np.array([y for _, y in samples])
    assert {x.shape for x, _ in samples} == {(len(FEATURES),)}
    assert 0.4 < person.mean() < 0.6


def one_person(cloud: PointCloud, place: np.ndarray) -> Truth:
    """Truth of one person without scatterers."""
    columns = {f.name: np.zeros((1, 3), np.float32) for f in dataclasses.fields(Truth)}
    columns |= {"stamp_ns": cloud.stamp_ns, "sequence": cloud.sequence, "frame_id": "room", "person_id": np.array([1], np.int32)}
    columns["position"] = place[None].astype(np.float32)
    return Truth(**columns)
