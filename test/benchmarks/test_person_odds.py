"""The fit of the log odds of being a person."""

import dataclasses

import numpy as np
import pytest

from benchmarks.person_odds import N_INERTIA, fit, held, in_room
from benchmarks.room_scenes import boards
from benchmarks.room_score import KeptRoom
from radar_core import PointCloud
from radar_sim import Truth
from radar_tracking.poisson.person import COEFFICIENTS, CONSTANT, FEATURES


def test_a_fit_finds_what_made_the_samples():
    """Samples of a known logistic law, with features of any scale: constant and coefficients come back, weights or not."""
    rng = np.random.default_rng(1)
    x = rng.normal(0, 1, (40_000, 3)) * [1.0, 10.0, 0.1] + [0.0, 5.0, 0.0]
    constant, slope = -0.5, np.array([0.8, 0.1, -5.0])
    person = rng.random(len(x)) < 1 / (1 + np.exp(-(constant + x @ slope)))
    found, coefficients = fit(x, person, np.ones(len(x)))
    assert found == pytest.approx(constant, abs=0.3)
    np.testing.assert_allclose(coefficients, slope, rtol=0.1, atol=0.01)


def test_features_of_inertia_are_fitted_to_what_the_others_leave():
    """Half of the samples rest and half move on the spot; the law of their inertia comes back, and the others keep their coefficients."""
    rng, n = np.random.default_rng(1), 60_000
    x = np.zeros((n, len(FEATURES)))
    x[:, 0] = rng.normal(0.0, 3.0, n)
    rests = np.arange(n) < n // 2
    x[rests, -6], x[~rests, -2] = 1.0, 1.0
    x[rests, -5:-2], x[~rests, -1] = rng.random((n // 2, 3)), rng.random(n // 2)
    law = np.array([-2.0, 1.0, 0.5, 1.5, -1.0, 3.0])
    odds = CONSTANT + x[:, :-N_INERTIA] @ np.array(COEFFICIENTS[:-N_INERTIA]) + x[:, -N_INERTIA:] @ law
    found = held(x, rng.random(n) < 1.0 / (1.0 + np.exp(-odds)), np.ones(n))
    np.testing.assert_allclose(found, law, atol=0.3)


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
