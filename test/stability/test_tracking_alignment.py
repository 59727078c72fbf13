"""Hard cases of alignment: far away, long runs, any turn, single precision, hardly any data, absurd errors."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from radar_core import DataError, PointCloud, Pose, RadarInfo
from radar_lab.alignment import NotObservableError, RigidConfig, Trajectory, TrajectoryConfig, align_points, align_trajectories
from radar_lab.alignment.pair import PairConfig, Walker, calibrate_pair
from radar_lab.alignment.tilt import TiltConfig, TiltFinder, tilts_of
from radar_lab.alignment.trajectory_fit import groups_of, integrated_time

EYE = np.eye(2)


def ring(n, radius=1.0):
    """Points around the origin, shape (n, 2)."""
    angle = np.linspace(0.0, 2 * math.pi, n, endpoint=False)
    return radius * np.stack([np.cos(angle), np.sin(angle)], axis=1)


@pytest.mark.parametrize("yaw", [math.pi, -math.pi, math.pi - 1e-12, 3 * math.pi / 2, 1e-15, -0.0])
def test_turns_at_the_wrap(yaw):
    """Half a turn either way is the same turn; nothing jumps."""
    c, s = math.cos(yaw), math.sin(yaw)
    source = ring(12) + 0.3
    found = align_points(source, source @ np.array([[c, s], [-s, c]]), EYE, EYE)
    assert abs(math.remainder(found.yaw - yaw, 2 * math.pi)) < 1e-9


@pytest.mark.parametrize("far", [1e3, 1e6])
def test_far_from_the_origin(far):
    """Seen from kilometres away yaw and translation are hard to tell apart, not wrong: points land where they should."""
    source = ring(30) + np.array([far, -far])
    found = align_points(source, source + 1.0, 1e-4 * EYE, 1e-4 * EYE, RigidConfig(max_condition=1e12))
    # float64 keeps 1e-16 of the coordinates; equilibrated columns keep the rest
    np.testing.assert_allclose(found.apply(source), source + 1.0, atol=1e-9 * far)


def test_worse_geometry_is_refused_and_not_guessed():
    """With the default, the same ring a thousand kilometres away is refused: its turn is hidden behind rounding."""
    source = ring(30) + 1e8
    with pytest.raises(NotObservableError, match="condition number"):
        align_points(source, source, 1e-4 * EYE, 1e-4 * EYE)


def test_covariances_of_all_sizes_in_one_problem():
    """A nanometre beside a kilometre: the sure points decide, the result is finite."""
    source = ring(40)
    std = np.geomspace(1e-9, 1e3, 40)
    target = source + np.random.default_rng(0).normal(size=source.shape) * std[:, None]
    found = align_points(source, target, np.zeros((2, 2)), std[:, None, None] ** 2 * EYE, RigidConfig(scale="given", loss="none"))
    assert np.isfinite(found.covariance).all()
    assert np.abs(found.translation).max() < 1e-7


def test_single_precision_input():
    """float32 positions are taken as float64, and cost only their own digits: 1e-7 of 3 m."""
    source = (ring(50) + 3.0).astype(np.float32)
    found = align_points(source, source + np.float32(0.5), EYE.astype(np.float32), EYE)
    assert found.translation.dtype == np.float64
    np.testing.assert_allclose(found.translation, 0.5, atol=1e-6)


@settings(max_examples=40, deadline=None)
@given(st.integers(0, 6), st.floats(1e-6, 1e6), st.integers(0, 10**6))
def test_few_points_of_any_size_give_a_result_or_a_reason(n, size, seed):
    """Random pairs without any relation: finite, or an error of ours, never a warning or a NaN."""
    rng = np.random.default_rng(seed)
    try:
        found = align_points(size * rng.normal(size=(n, 2)), size * rng.normal(size=(n, 2)), size**2 * EYE, size**2 * EYE)
    except DataError:
        return
    assert np.isfinite(found.covariance).all()
    assert np.isfinite(found.translation).all()


def walked(n, step=0.04, start=0):
    """A walk in a figure of eight."""
    t = np.arange(n) * step
    return start + np.round(t * 1e9).astype(np.int64), np.stack([3 + np.sin(0.5 * t), np.sin(1.0 * t)], axis=1)


@pytest.mark.parametrize("start", [0, 1_900_000_000 * 10**9, -(10**18)])
def test_stamps_of_today_keep_their_nanoseconds(start):
    """Float seconds since 1970 would be a quarter of a microsecond coarse, and an offset lost among them: integers are subtracted first."""
    stamp, place = walked(1500, start=start)
    found = align_trajectories(Trajectory(stamp, place, EYE), Trajectory(stamp - 5_000_000, place, EYE))
    assert found.offset == pytest.approx(0.005, abs=2e-5)


@pytest.mark.long
def test_a_long_run():
    """Half an hour at 50 Hz, 90,000 samples: as accurate as a short one, and with finite memory."""
    rng = np.random.default_rng(1)
    stamp, place = walked(90_000, step=0.02)
    first, second = (Trajectory(stamp, place + rng.normal(0, 0.05, place.shape), 0.0025 * EYE) for _ in range(2))
    found = align_trajectories(first, second, TrajectoryConfig(max_offset=0.02))
    # 0.07 m over the root of 90,000, farther from the centre of the walk than its own size
    assert np.abs(found.translation).max() < 0.003
    assert found.std["x"] < 0.001


def test_a_day_between_two_halves():
    """Gaps of any length do no harm to the correlation time, and stretches of time are numbered, not allocated."""
    rng = np.random.default_rng(2)
    stamp, place = walked(1000)
    stamp[500:] += 86_400 * 10**9
    first, second = (Trajectory(stamp, place + rng.normal(0, 0.05, place.shape), 0.0025 * EYE) for _ in range(2))
    found = align_trajectories(first, second)
    assert np.abs(found.translation).max() < 4 * found.std["x"] + 4 * found.std["y"]
    assert 0.04 <= found.correlation_time < 0.2


def test_correlation_of_degenerate_series():
    """None, one, constant and zero residuals."""
    stamp = np.arange(50) * 10**7
    assert integrated_time(stamp[:2], np.ones((2, 2)), np.ones(2)) == 0.0
    assert integrated_time(stamp, np.zeros((50, 2)), np.ones(50)) == pytest.approx(0.01)
    assert integrated_time(stamp, np.ones((50, 2)), np.zeros(50)) == pytest.approx(0.01)
    assert integrated_time(stamp, np.ones((50, 2)), np.ones(50)) > 0.05
    group, longest = groups_of(stamp, 1e9)
    assert group.max() == 0
    assert longest == pytest.approx(0.25)


def cloud(k, place, frame_id="radar", n=8):
    """Points about a person who walks."""
    rng = np.random.default_rng(k)
    x, y = (place + rng.normal(0, 0.05, (n, 2))).T
    values = {"x": x, "y": y, "z": rng.normal(0, 0.1, n), "radial_speed": np.full(n, 0.5), "snr": np.full(n, 20.0), "range": np.hypot(x, y)}
    return PointCloud(k * 40_000_000, k, frame_id, **{name: value.astype(np.float32) for name, value in values.items()})


def test_walkers_take_empty_clouds_and_nan_and_refuse_the_wrong_ones():
    """Clouds without points, without positions, of another sensor, and two people at once."""
    _, place = walked(200)
    walker, crowd = Walker(PairConfig(), RadarInfo()), Walker(PairConfig(), RadarInfo())
    for k in range(200):
        full = cloud(k, place[k])
        kind = k % 20
        if kind == 5:
            full = full.select(np.zeros(len(full), bool))
        elif kind == 6:
            full.x[:3] = np.nan
        walker.process(full)
        two = [cloud(k, place[k]), cloud(k + 10_000, place[k] + [0.0, 2.5])]
        both = {name: np.concatenate([getattr(c, name) for c in two]) for name in ("x", "y", "z", "radial_speed", "snr", "range")}
        crowd.process(PointCloud(k * 40_000_000, k, "radar", **both))
    track = walker.trajectory()
    assert len(track) > 150
    assert np.isfinite(track.position).all()
    with pytest.raises(DataError, match="each radar needs its own topics"):
        walker.process(cloud(300, place[0], "other"))
    with pytest.raises(DataError, match="one person walk alone"):
        crowd.trajectory()
    with pytest.raises(DataError, match="sees nobody in 0 clouds"):
        calibrate_pair(walker, Walker(PairConfig(), RadarInfo()))


def points(distance: object, elevation: object, azimuth: object = 0.0, stamp_ns: int = 0, speed: float = 1.0) -> PointCloud:
    """Points that move, as the radar measures them."""
    distance, elevation, azimuth = np.broadcast_arrays(*(np.atleast_1d(np.asarray(a, np.float32)) for a in (distance, elevation, azimuth)))
    polar = {"range": distance, "azimuth": azimuth, "elevation": elevation}
    n = len(distance)
    xyz = {name: np.zeros(n, np.float32) for name in "xyz"}
    return PointCloud(stamp_ns, 0, "radar", **xyz, radial_speed=np.full(n, speed, np.float32), snr=np.full(n, 20.0, np.float32), **polar)


def test_tilts_of_any_point_are_angles_or_not_there() -> None:
    """At the radar, a nanometre and a thousand kilometres away, straight up, behind, without angles, and none at all."""
    quarter = np.pi / 2
    cloud = points(
        [0.0, 1e-9, 1e6, 2.0, 2.0, 2.0, 2.0], [0.0, 0.0, 0.1, quarter, -quarter, 0.1, np.nan], [0.0, 0.0, 0.0, 0.0, 0.0, np.pi, 0.0]
    )
    for above in (-1.0, 0.0, 1.0, 1e9):
        with np.errstate(all="raise"):
            found = tilts_of(cloud, above)
        assert np.isnan(found[-1])
        assert np.isnan(found[0])
        known = found[np.isfinite(found)]
        assert (np.abs(known) <= 2 * np.pi).all()
    assert tilts_of(points([], []), 1.0).shape == (0,)
    assert tilts_of(points([2.0], [0.1], [np.nan]), 0.0)[0] == pytest.approx(-0.1, abs=1e-6)  # no azimuth: as if straight ahead


def test_a_tilt_of_points_that_no_tilt_explains() -> None:
    """Points nearer than they would have to be high tell nothing; those that do give the tilt, and alone they are refused."""
    info = RadarInfo(mount=Pose(z=3.0))
    finder, refused = (TiltFinder(TiltConfig(), info) for _ in range(2))
    for k in range(100):
        near = points([1.0, 1.2, 1.5], [-0.2, 0.3, 0.1], stamp_ns=k * 100_000_000)
        finder.process(near)
        refused.process(near)
        finder.process(points(4.0, np.arcsin((0.8 - 3.0) / 4.0) + 0.4, stamp_ns=k * 100_000_000))
    assert finder.result().tilt == pytest.approx(-0.4, abs=1e-5)
    with pytest.raises(DataError, match="somebody moves in 0 s only"):
        refused.result()


def test_a_day_of_tilts_is_a_tilt() -> None:
    """Gaps of hours between seconds, stamps of today: as many seconds as had somebody, and the same tilt."""
    finder = TiltFinder(TiltConfig(), RadarInfo(mount=Pose(z=1.2)))
    start = 1_760_000_000_000_000_000
    for k in range(48):
        finder.process(points(3.0, -0.1, stamp_ns=start + k * 1_800_000_000_000))
        finder.process(points([], [], stamp_ns=start + k * 1_800_000_000_000 + 1))
    found = finder.result()
    assert found.seconds == 48
    assert found.tilt == pytest.approx(np.arcsin(-0.4 / 3.0) + 0.1, abs=1e-6)
