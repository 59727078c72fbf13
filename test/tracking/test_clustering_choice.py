"""Clusterings by name, the range rate as an axis, and methods that find far bodies as well as near ones."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from sklearn.cluster import DBSCAN

from radar_core import ConfigError, DataError
from radar_tracking.clustering import Clustering, ClusteringConfig, ClusterPoints, dbscan, seen_from

NAMES = ("dbscan", "optics", "kmeans", "grid_dbscan", "polar_dbscan")
ORIGIN = np.zeros(2)


def make(name: str, **knobs):
    return Clustering(ClusteringConfig(name=name, **knobs))


def bodies(seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Three compact bodies of 20 points, 2 m apart and about 3 m from the sensor, with their owners."""
    rng = np.random.default_rng(seed)
    centres, owner = np.array([[3.0, 0.0], [2.5, 2.0], [2.5, -2.0]]), np.repeat([0, 1, 2], 20)
    return centres[owner] + rng.normal(0, 0.1, (60, 2)), owner


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("height", [False, True])
def test_every_method_finds_separate_bodies(name, height):
    """Each body one label of its own, no point lost; on the floor plane and in space."""
    points, owner = bodies(1)
    points = np.column_stack([points, np.full(60, 1.1)]) if height else points
    labels = make(name, min_points=2, n_clusters=3).labels(seen_from(points, ORIGIN))
    assert labels.dtype == np.int64
    assert len(set(zip(labels.tolist(), owner.tolist(), strict=True))) == 3
    assert set(labels) == {0, 1, 2}


@settings(max_examples=25, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), weight=st.floats(0.1, 2), name=st.sampled_from(["dbscan", "optics"]))
def test_the_rate_is_one_more_axis(seed, weight, name):
    """Labels of DBSCAN on (x, y, weight times rate); OPTICS with a plot to ``eps`` has its core points in the same groups."""
    rng = np.random.default_rng(seed)
    place, rate = rng.uniform(0, 2, (50, 2)), rng.normal(0, 1, 50)
    expected = DBSCAN(eps=0.5, min_samples=3).fit_predict(np.column_stack([place, weight * rate]))
    labels = make(name, eps=0.5, max_eps=0.5, min_points=3, rate_weight=weight).labels(ClusterPoints(place, rate))
    if name == "dbscan":
        assert np.array_equal(labels, expected)
    else:
        assert labels.max() == expected.max()
        assert np.mean((labels >= 0) == (expected >= 0)) >= 0.8  # OPTICS leaves some border points as noise


@pytest.mark.parametrize("name", ["dbscan", "optics", "grid_dbscan", "polar_dbscan"])
def test_people_who_pass_each_other_differ_in_rate(name):
    """In one place, one comes and one goes at 1 m/s: one body by place, two by rate."""
    rng, owner = np.random.default_rng(2), np.repeat([0, 1], 15)
    points = seen_from(np.array([3.0, 0.0]) + rng.normal(0, 0.1, (30, 2)), ORIGIN, np.where(owner == 0, 1.0, -1.0))
    assert set(make(name).labels(points)) == {0}
    apart = make(name, rate_weight=0.5).labels(points)
    assert np.array_equal(apart, owner)


@pytest.mark.parametrize("name", ["dbscan", "optics", "grid_dbscan", "polar_dbscan"])
def test_a_point_without_a_rate_takes_its_neighbours(name):
    """It joins the body it lies in, and does not tie the two together; with no rate at all the axis is off."""
    place = np.array([[3.0, 0.1 * k] for k in range(8)])
    rate = np.array([1.0, 1.0, np.nan, 1.0, -1.0, np.nan, -1.0, -1.0])
    labels = make(name, rate_weight=0.5).labels(seen_from(place, ORIGIN, rate))
    assert labels[[0, 1, 2, 3]].tolist() == [0] * 4
    assert labels[[4, 5, 6, 7]].tolist() == [1] * 4
    nothing = make(name, rate_weight=0.5).labels(seen_from(place, ORIGIN))
    assert np.array_equal(nothing, make(name).labels(seen_from(place, ORIGIN, rate)))


def person(rng: np.random.Generator, distance: float) -> np.ndarray:
    """A body as a radar sees it: 36 points at a metre, fewer in proportion to range; azimuth known to 0.06 rad however far."""
    n = max(3, rng.poisson(36 / distance))
    r, azimuth = distance + rng.normal(0, 0.08, n), rng.uniform(-0.12, 0.12, n) / distance + rng.normal(0, 0.06, n)
    return np.column_stack([r * np.cos(azimuth), r * np.sin(azimuth)])


def found(name: str, distance: float, **knobs) -> float:
    """Share of 200 clouds in which a person and ten points of clutter give one cluster that holds 80 % of the person."""
    rng, hits = np.random.default_rng(int(10 * distance)), 0
    clustering = make(name, eps=0.25, min_points=6, **knobs)
    for _ in range(200):
        own = person(rng, distance)
        clutter = np.column_stack([rng.uniform(0.5, 7, 10), rng.uniform(-3, 3, 10)])
        labels = clustering.labels(seen_from(np.vstack([own, clutter]), ORIGIN))[: len(own)]
        hits += np.bincount(labels[labels >= 0], minlength=1).max() >= 0.8 * len(own)
    return hits / 200


@pytest.mark.parametrize("name", ["grid_dbscan", "polar_dbscan"])
def test_far_people_are_found_like_near_ones(name):
    """One set of knobs from 1 to 6 m; plain DBSCAN with the same ``eps`` and ``min_points`` finds the near ones only.

    200 clouds: a share of 0.95 has a standard error of 0.015.
    """
    near_and_far = [found(name, distance, angle_reach=0.12) for distance in (1.0, 2.0, 3.0, 4.0, 5.0, 6.0)]
    assert min(near_and_far) >= 0.9, near_and_far
    assert found("dbscan", 1.0) >= 0.9
    assert found("dbscan", 6.0) <= 0.2


def test_clutter_stays_noise_where_the_demand_is_lower():
    """Ten points of clutter in 39 m^2: three that happen to lie together far away, in 5 % of 200 clouds at most (measured: 1 %)."""
    rng, clustering, false = np.random.default_rng(8), make("polar_dbscan", eps=0.25, min_points=6, min_points_far=3, angle_reach=0.12), 0
    for _ in range(200):
        clutter = np.column_stack([rng.uniform(0.5, 7, 10), rng.uniform(-3, 3, 10)])
        false += clustering.labels(seen_from(clutter, ORIGIN)).max() >= 0
    assert false <= 10


def test_polar_is_plain_dbscan_without_its_knobs():
    """With no angular reach and no fall of density, far from the sensor, the ellipse is DBSCAN's circle.

    At 1000 m arc and chord of half a metre differ by 1e-8; no distance of this cloud is that near to ``eps``.
    """
    rng = np.random.default_rng(9)
    place = np.array([1000.0, 0.0]) + rng.uniform(-1.5, 1.5, (80, 2))
    labels = make("polar_dbscan", eps=0.3, min_points=4, angle_reach=0.0, density_exponent=0.0).labels(seen_from(place, ORIGIN))
    assert np.array_equal(labels, dbscan(place, 0.3, 4))


@pytest.mark.parametrize("name", ["grid_dbscan", "polar_dbscan"])
def test_azimuth_wraps_behind_the_sensor(name):
    """A body across azimuth +-pi is one body."""
    rng = np.random.default_rng(10)
    place = np.array([-3.0, 0.0]) + rng.normal(0, 0.1, (30, 2))
    assert set(make(name).labels(seen_from(place, ORIGIN))) == {0}


@pytest.mark.parametrize("name", ["grid_dbscan", "polar_dbscan"])
def test_labels_do_not_depend_on_where_the_sensor_looks(name):
    """Turning all azimuths by whole cells changes nothing."""
    points, _ = bodies(3)
    seen = seen_from(points, ORIGIN)
    cell = 2 * np.pi / 126  # whole cells of 0.05 rad in a turn, as the grid makes them
    middle = ClusterPoints(seen.position, range=seen.range, azimuth=(np.floor(seen.azimuth / cell) + 0.5) * cell)
    turned = ClusterPoints(seen.position, range=seen.range, azimuth=middle.azimuth + 17 * cell)
    assert np.array_equal(make(name).labels(middle), make(name).labels(turned))


def test_the_sensor_may_stand_anywhere():
    """Range and azimuth are about the sensor, on the floor plane."""
    seen = seen_from(np.array([[1.0, 3.0, 0.2], [0.0, 1.0, 2.0]]), np.array([1.0, 1.0, 1.5]))
    assert np.allclose(seen.range, [2.0, 1.0])
    assert np.allclose(seen.azimuth, [np.pi / 2, np.pi])


def test_what_is_left_out_is_not_measured():
    """Range, azimuth and rate default to NaN; the polar methods then name what they lack."""
    points = ClusterPoints(np.zeros((3, 2)))
    assert np.isnan(points.rate).all()
    assert make("dbscan").labels(points).tolist() == [0, 0, 0]
    for name in ("grid_dbscan", "polar_dbscan"):
        with pytest.raises(DataError, match=r"ClusterPoints\.range"):
            make(name).labels(points)


def test_an_unknown_name_and_a_plot_that_ends_too_early_are_refused():
    """With what to choose."""
    with pytest.raises(ConfigError, match="did you mean 'optics'"):
        ClusteringConfig(name="optic")
    with pytest.raises(ConfigError, match=r"max_eps is 0\.2 m"):
        ClusteringConfig(eps=0.4, max_eps=0.2)
