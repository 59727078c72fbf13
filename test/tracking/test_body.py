"""From points to bodies: where the centre is behind what is seen, how sure that is, and what sensors on several sides say together."""

import numpy as np
import pytest
from blobs import Shell, make_cloud, standing, walking
from hypothesis import given, settings
from hypothesis import strategies as st
from oracles import tracking as oracle

from radar_core import CloudComposite, PointCloud, Pose, merge
from radar_core.config import load
from radar_tracking import FilterConfig, PeopleTracker, TrackerConfig
from radar_tracking.people.body import ASSUMED_Z, ASSUMED_Z_STD, Bodies, centre, measure
from radar_tracking.people.points import Admission, Points

AROUND = [Pose(x=3 * np.cos(a), y=3 * np.sin(a), yaw=(a + np.pi) % (2 * np.pi) - np.pi * 2) for a in np.arange(8) * np.pi / 4]
CENTRE = np.array([0.4, -0.2, 1.0])


def admitted(cloud: PointCloud, origin: np.ndarray | None = None) -> Points:
    """The points of a cloud as trackers see them."""
    return Admission(TrackerConfig(), np.zeros(3) if origin is None else origin).process(cloud)


def measured(points: Points, offset: float = 0.0, weight: np.ndarray | None = None, **knobs: float) -> Bodies:
    """One body of all points."""
    n = len(points)
    weight = np.ones(n) if weight is None else weight
    return measure(points, np.arange(n), np.zeros(n, np.int64), 1, weight, np.array([offset]), FilterConfig(**knobs))


def mean_error(shell: Shell, mounts: list[Pose], n: int = 400) -> np.ndarray:
    """Mean of measured minus true centre on the floor plane [m]; its own error is about 0.06 m / sqrt(10 points x 400 clouds) = 1 mm."""
    found = []
    for k in range(n):
        cloud = shell.composite(k, mounts)
        found.append(measured(admitted(cloud), shell.offset).measurement.position[0, :2])
    return np.mean(found, axis=0) - CENTRE[:2]


@pytest.mark.parametrize("mount", AROUND)
def test_the_centre_of_a_round_body_is_unbiased_from_every_side(mount):
    """The half that is turned to the radar lies 0.12 m before the centre; with the offset 5 mm are left (the beams are not parallel)."""
    shell = Shell(lambda t: CENTRE, angle_std=0.0)
    assert np.hypot(*mean_error(shell, [mount])) < 0.008
    assert shell.offset > 0.1


@pytest.mark.parametrize("mounts", [[AROUND[0], AROUND[2]], [AROUND[0], AROUND[4]], [AROUND[1], AROUND[4]], AROUND], ids=len)
def test_the_centre_is_unbiased_with_sensors_on_several_sides(mounts):
    """Every sensor's points lie before the centre as it sees them; what is seen from opposite sides needs no offset together."""
    assert np.hypot(*mean_error(Shell(lambda t: CENTRE, angle_std=0.0), mounts, 200)) < 0.008


def test_the_covariance_of_the_centroid_is_right_for_independent_points():
    """NEES of 30 points from a normal distribution, over 2,000 clouds.

    With an estimated variance the square of Student's t has the mean (n - 1) / (n - 3); the variance about the estimated mean is small by
    another n / (n - 1): 30 / 27 = 1.11 together. The error of the mean of 4,000 such squares is 1.11 x sqrt(2.4 / 4000) = 0.03: four of it.
    """
    rng, square = np.random.default_rng(1), []
    for k in range(2000):
        cloud = make_cloud(np.array([3.0, 1.0, 1.0]) + rng.normal(0, (0.2, 0.3, 0.3), (30, 3)), k, azimuth_std=np.zeros(30, np.float32))
        body = measured(admitted(cloud), position_std=1e-3).measurement
        error = body.position[0, :2] - [3.0, 1.0]
        square.append(error**2 / np.diagonal(body.covariance[0])[:2])
    assert np.mean(square) == pytest.approx(30 / 27, abs=0.12)


def test_weights_count_as_fewer_points():
    """Twenty points of weight 1 and twenty of 1e-6 are as sure as twenty."""
    rng = np.random.default_rng(2)
    place = np.array([3.0, 1.0, 1.0]) + rng.normal(0, 0.2, (20, 3))
    few = measured(admitted(make_cloud(place)))
    many = measured(admitted(make_cloud(np.vstack([place, place + 0.1]))), weight=np.repeat([1.0, 1e-6], 20))
    np.testing.assert_allclose(few.measurement.covariance, many.measurement.covariance, rtol=1e-4)
    np.testing.assert_allclose(few.measurement.position, many.measurement.position, atol=1e-6)


def test_the_covariance_never_falls_below_what_is_configured():
    """A thousand points in one place are as sure as `position_std` says, and less so from farther away when the direction is unsure."""
    cloud = make_cloud(np.tile([4.0, 0.0, 1.0], (1000, 1)), azimuth_std=np.zeros(1000, np.float32))
    near = measured(admitted(cloud), position_std=0.1).measurement.covariance[0]
    np.testing.assert_allclose(np.diagonal(near)[:2], 0.01)
    # two points, 0.05 rad at 4 m each: 0.2 m / sqrt(2)
    cloud = make_cloud(np.tile([4.0, 0.0, 1.0], (2, 1)), azimuth_std=np.full(2, 0.05, np.float32))
    far = measured(admitted(cloud), position_std=0.1).measurement.covariance[0]
    np.testing.assert_allclose(np.diagonal(far)[:2], 0.01 + 0.2**2 / 2, rtol=1e-6)


def test_heights():
    """The mean of those that are measured; where none is, what is assumed, and as unsure."""
    place = np.array([[3.0, 0.0, 0.5], [3.0, 0.0, np.nan], [3.0, 0.0, 1.1]])
    some = measured(admitted(make_cloud(place))).measurement
    assert some.position[0, 2] == pytest.approx(0.8)
    place[:, 2] = np.nan
    none = measured(admitted(make_cloud(place))).measurement
    assert none.position[0, 2] == ASSUMED_Z
    assert none.covariance[0, 2, 2] == pytest.approx(ASSUMED_Z_STD**2)
    np.testing.assert_allclose(none.position[0, :2], [3.0, 0.0], atol=1e-6)


def test_range_rates():
    """Mean of those that are measured; NaN where none is."""
    place = np.tile([3.0, 0.0, 1.0], (3, 1))
    some = measured(admitted(make_cloud(place, radial_speed=np.array([1.0, np.nan, 2.0], np.float32)))).measurement
    assert some.rate[0] == pytest.approx(1.5)
    none = measured(admitted(make_cloud(place))).measurement
    assert np.isnan(none.rate[0])
    assert none.rate_variance[0] > 0


def test_the_range_rate_is_that_of_one_sensor():
    """A body walks from one sensor to the opposite one: rate and origin are of the same one, that which sees more, not a mean of both."""
    mounts = [Pose(), Pose(x=6.0, yaw=np.pi)]
    place = np.tile([2.0, 0.0, 1.2], (4, 1))
    clouds = [make_cloud(place, radial_speed=np.full(4, v, np.float32)) for v in (1.0, -1.0)]
    for fewer, (x, rate) in enumerate([(6.0, -1.0), (0.0, 1.0)]):
        seen = [cloud.select(np.arange(3 if i == fewer else 4)) for i, cloud in enumerate(clouds)]
        body = measured(admitted(merge(seen, mounts))).measurement
        assert (body.origin[0, 0], body.rate[0]) == (x, pytest.approx(rate))


@settings(max_examples=60, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), n=st.integers(1, 6), n_sensors=st.integers(1, 3), missing=st.sampled_from([0.0, 0.3, 1.0]))
def test_the_compiled_means_equal_their_reference(seed, n, n_sensors, missing):
    """With and without heights and range rates, of one sensor and of several."""
    rng = np.random.default_rng(seed)
    group = np.concatenate([np.arange(n), rng.integers(0, n, rng.integers(0, 40))])
    m = len(group)
    position, speed = rng.normal(0, 2, (m, 3)), rng.normal(0, 1, m)
    position[rng.random(m) < missing, 2] = np.nan
    speed[rng.random(m) < missing] = np.nan
    sensor, origins = rng.integers(0, n_sensors, m), rng.normal(0, 3, (n_sensors, 3))
    arguments = (position, rng.random(m), speed, sensor, origins, group, rng.uniform(1e-6, 1.0, m), n)
    for found, expected in zip(centre(*arguments), oracle.centre(*arguments), strict=True):
        np.testing.assert_allclose(found, expected, rtol=1e-12, atol=1e-12)


def errors(shell: Shell, mounts: list[Pose], estimator: str, n: int) -> np.ndarray:
    """Position errors of the one confirmed track on the floor plane, shape (clouds, 2) [m]."""
    tracker = PeopleTracker(load(TrackerConfig, {"tracker": "group_clustering", "filter": {"estimator": {"name": estimator}}}))
    found = []
    for k in range(n):
        cloud = shell.composite(k, mounts)
        assert isinstance(cloud, CloudComposite)
        tracks = tracker.process(cloud)
        if k >= 50:
            assert [track.id for track in tracks.tracks] == [1]
            assert tracks.people_count == 1
            found.append((tracks.tracks[0].position - shell.path(k * shell.frame_ns * 1e-9))[:2])
    return np.array(found)


@pytest.mark.parametrize("estimator", ["linear", "extended", "mm_vel_est"])
def test_two_sensors_on_opposite_sides_track_as_well_as_one(estimator):
    """Somebody walks to and fro between them: not less accurate than with either alone, and nobody else appears."""
    mounts, path = [Pose(), Pose(x=6.0, yaw=np.pi)], walking((2.0, -1.2), (4.0, 1.2), 1.0)
    rms = [np.sqrt((errors(Shell(path), used, estimator, 200) ** 2).sum(axis=1).mean()) for used in (mounts[:1], mounts[1:], mounts)]
    assert rms[2] <= max(rms[:2])
    assert max(rms) < 0.2


def test_an_arm_is_judged_by_the_sensor_that_sees_it():
    """Standing between two sensors, an arm stretched to each in turn: the body stays where it is, within 0.1 m."""
    mounts, body = [Pose(), Pose(x=6.0, yaw=np.pi)], standing(3.0, 0.0)
    shell, tracker, worst = Shell(body), PeopleTracker(), 0.0
    for k in range(300):
        reach = 0.6 * abs(np.sin(k * 0.02 * 2.5))
        side = 1 if np.sin(k * 0.02 * 2.5) > 0 else 0  # towards this sensor
        along = np.linspace(0.4, 1.0, 8)[:, None] * [(reach if side else -reach), 0.0, 0.2]
        arm = make_cloud(body(k * 0.02) + along, k, radial_speed=np.full(8, -0.8, np.float32), snr=np.full(8, 18, np.float32))
        clouds = [shell.cloud(k, mount) for mount in mounts]
        clouds.insert(side, arm)
        tracks = tracker.process(merge(clouds, [mounts[0], mounts[side], mounts[1]]))
        if k >= 50:
            assert [track.id for track in tracks.tracks] == [1]
            worst = max(worst, abs(tracks.tracks[0].position[0] - body(k * 0.02)[0]))
    assert worst < 0.1
