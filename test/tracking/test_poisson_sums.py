"""Sums over the points of a cloud equal their definitions in numpy; torsos' middles, too."""

import numpy as np
import pytest
from blobs import make_cloud
from hypothesis import given
from hypothesis import strategies as st

from radar_tracking import TrackerConfig
from radar_tracking.people.points import Admission
from radar_tracking.people.zones import View
from radar_tracking.poisson import motion
from radar_tracking.poisson.points import Measure, Measured
from radar_tracking.poisson.sums import FAST, owners_of, scatter, summed

seeds = st.integers(0, 2**32 - 1)


def some_points(rng: np.random.Generator, n: int) -> Measured:
    """Points in a small room: some still, some fast, some without a speed or a height."""
    z = np.where(rng.random(n) < 0.2, np.nan, rng.uniform(0.0, 1.8, n))
    place = np.column_stack([rng.uniform([1.0, -2.0], [5.0, 2.0], (n, 2)), z])
    speed = rng.choice([0.0, 0.05, np.nan, 1.0, 3.0], n) * rng.normal(1.0, 0.5, n)
    cloud = make_cloud(place, radial_speed=speed.astype(np.float32), snr=rng.uniform(5.0, 30.0, n).astype(np.float32))
    return Measure(TrackerConfig(), Admission(TrackerConfig(), np.zeros(3)), View()).process(cloud)


def some_shares(rng: np.random.Generator, n: int, m: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Torsos' shares, with limbs', and how near still points are; many are zero."""
    torso, limb, still = rng.random((3, n, m)) * (rng.random((3, n, m)) < 0.6) / (2 * m)
    return torso, torso + limb, still


@given(seed=seeds, n=st.integers(0, 40), m=st.integers(1, 5))
def test_sums_are_their_definition(seed, n, m):
    """Every column by whole arrays, to 1e-9."""
    rng = np.random.default_rng(seed)
    measured, (torso, whole, still) = some_points(rng, n), some_shares(rng, n, m)
    sums = summed(measured, whole, torso, still)
    known, z = np.isfinite(measured.height), measured.points.position[:, 2]
    height, placed, speed = np.where(known, measured.height, 0.0), np.isfinite(z), np.abs(measured.rate)
    expected = {
        "points": np.ones(n) @ whole, "snr": measured.snr @ whole, "fast": (speed > FAST) @ whole, "moving": (~measured.still) @ whole,
        "known": known @ whole, "height": height @ whole, "square": height**2 @ whole, "rate": measured.rate @ whole,
        "rate_square": measured.rate**2 @ whole, "torso": np.ones(n) @ torso, "torso_speed": speed @ torso,
        "torso_rate": measured.rate @ torso, "torso_placed": placed @ torso, "torso_z": np.where(placed, z, 0.0) @ torso,
        "still": np.ones(n) @ still, "still_x": measured.x @ still, "still_y": measured.y @ still,
        "still_power": 10 ** (measured.snr / 10) @ still,
    }  # fmt: skip
    assert set(expected) == set(sums.dtype.names)
    for name, value in expected.items():
        np.testing.assert_allclose(sums[name], value, rtol=1e-9, atol=1e-9, err_msg=name)


@given(seed=seeds, n=st.integers(1, 40), m=st.integers(1, 5))
def test_points_scatter_about_their_centres(seed, n, m):
    """Weighted mean squares; a height that is not known is the centre's."""
    rng = np.random.default_rng(seed)
    x, y, z = rng.normal(0.0, 1.0, (3, n))
    z[rng.random(n) < 0.3] = np.nan
    whole, tracks, centre = rng.uniform(0.1, 1.0, (n, m)), rng.permutation(m)[: 1 + m // 2], rng.normal(0.0, 1.0, (1 + m // 2, 3))
    tracks = tracks[: len(centre)]
    step = np.nan_to_num(np.stack([x, y, z], axis=-1)[:, None] - centre[: len(tracks)])
    own = whole[:, tracks, None]
    expected = (own * step**2).sum(axis=0) / own.sum(axis=0)
    np.testing.assert_allclose(scatter(x, y, z, whole, tracks, centre), expected, rtol=1e-9, atol=1e-12)


@given(seed=seeds, n=st.integers(0, 30), m=st.integers(1, 6))
def test_points_are_whose_they_mostly_are(seed, n, m):
    """Shares of a person and of their arms count together; who has ended owns nothing."""
    rng = np.random.default_rng(seed)
    whole, owners, alive = rng.random((n, m)) / m, rng.integers(1, 4, m), rng.integers(1, 5, 3)
    found = owners_of(whole, owners, alive, 0.3)
    for point, number in zip(whole, found.tolist(), strict=True):
        totals = {owner: point[owners == owner].sum() for owner in owners.tolist()}
        most = max(totals, key=totals.__getitem__)
        assert number == (most if totals[most] > 0.3 and most in alive else -1)


@pytest.mark.parametrize(("slow_points", "stays", "arm"), [(0, False, 1.0), (8, False, 1.6 / 12), (8, True, 1.6 / 12), (0, True, 1.0)])
def test_who_stands_is_where_the_slow_points_are(slow_points, stays, arm):
    """Of who stands, twelve points of an arm weigh a fifth of eight slow ones; who walks, or has no slow ones, is where all points are."""
    x = np.concatenate([np.zeros(slow_points), np.ones(12)])
    slow = np.concatenate([np.ones(slow_points), np.zeros(12)])
    torso = np.ones((len(x), 2))
    found, arms = motion._centroids(torso, np.array([True, False]), np.array([stays, False]), slow, x[None])
    weight = 12 * arm + slow_points
    np.testing.assert_allclose(found[0], [weight, 12 * arm / weight])
    np.testing.assert_allclose(found[1], [len(x), 12 / len(x)])
    np.testing.assert_allclose(arms, [12 * arm / weight if stays else 0.0, 0.0])
    nobody, none = motion._centroids(np.zeros((3, 1)), np.array([True]), np.array([True]), np.zeros(3), np.ones((2, 3)))
    assert (nobody == 0.0).all()
    assert (none == 0.0).all()


@pytest.mark.parametrize(("stays", "arm"), [(False, 1.0), (True, 0.2 * 0.5 / 12)])
def test_half_a_slow_point_is_enough_for_a_person_who_has_not_set_off(stays, arm):
    """Half a slow point is the body of a person who stays; of anybody else, who may be starting to walk, all points are."""
    x, slow, torso = np.concatenate([[0.0], np.ones(12)]), np.concatenate([[1.0], np.zeros(12)]), np.ones((13, 1))
    torso[0] = 0.5
    found, _ = motion._centroids(torso, np.array([True]), np.array([stays]), slow, x[None])
    np.testing.assert_allclose(found[0], [0.5 + 12 * arm, 12 * arm / (0.5 + 12 * arm)])
