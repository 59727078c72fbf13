"""Two sensors that see one movement: pose and clock offset are found, and the uncertainty is honest though errors last for a while."""

import numpy as np
import pytest

from radar_core import DataError
from radar_lab.alignment import NotObservableError, Trajectory, TrajectoryConfig, align_trajectories
from radar_lab.alignment.trajectory import nearest, slopes
from radar_lab.alignment.trajectory_fit import groups_of, integrated_time

YAW, SHIFT, OFFSET = 0.3, np.array([0.1, -0.6, 0.2]), 0.013
STD = 0.05


def lasting(rng, n, d, step, time):
    """Errors of unit variance that are forgotten exponentially (first order), shape (n, d)."""
    from scipy.signal import lfilter

    keep = np.exp(-step / time) if time > 0 else 0.0
    drive = rng.normal(size=(n, d)) * np.sqrt(1 - keep**2)
    drive[0] /= np.sqrt(1 - keep**2)
    return lfilter([1.0], [1.0, -keep], drive, axis=0)


def place(t, phase=(0.0, 0.0, 0.0)):
    """Somebody who walks to and fro, at about 0.5 m/s, shape (n, 3)."""
    x, y, z = (np.sin(w * t + p) for w, p in zip((0.5, 0.37, 0.9), phase, strict=True))
    return np.stack([2.8 + 1.2 * x, y, 1.0 + 0.3 * z], axis=1)


def seen(rng, *, d=2, seconds=60.0, step=0.04, time=0.0, std=STD, offset=OFFSET, path=place, yaw=YAW):
    """The movement as both sensors see it; the second one's stamps are ``offset`` too early."""
    n = round(seconds / step)
    t = np.arange(n) * step
    phase = rng.uniform(0, 6, 3)
    c, s = np.cos(yaw), np.sin(yaw)
    turn = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])
    first, second = path(t, phase), (path(t + offset, phase) - SHIFT) @ turn
    stamp = np.round(t * 1e9).astype(np.int64) + 10**18
    both = [p[:, :d] + std * lasting(rng, n, d, step, time) for p in (first, second)]
    return [Trajectory(stamp, p, std**2 * np.eye(d) if std else np.eye(d)) for p in both]


def error(found, d=2):
    """Found minus true: translation, yaw, offset."""
    return np.array([*(found.translation - SHIFT[:d]), found.yaw - YAW, found.offset - OFFSET])


def kept(track, index, **changes):
    """Some samples of a trajectory, changed."""
    values = {name: getattr(track, name)[index] for name in ("stamp_ns", "position", "covariance", "velocity")}
    return Trajectory(**{**values, **changes})


@pytest.mark.parametrize("d", [2, 3])
def test_without_errors_pose_and_offset_are_exact(d):
    """What is left is the bend of the path between a sample and the nearest one: 20 ms of a curve, 0.1 mm."""
    found = align_trajectories(*seen(np.random.default_rng(0), d=d, std=0.0))
    assert np.abs(error(found, d)).max() < 3e-4
    assert found.rms < 3e-4
    assert found.rank == len(found.names) == d + 2


@pytest.mark.long
@pytest.mark.parametrize("time", [0.0, 0.1, 0.5])
def test_uncertainty_is_honest_while_errors_last(time):
    """NEES over 12 runs of a minute, errors independent, or alike for 0.1 and 0.5 s; correlation times are measured to a third."""
    nees, found = [], None
    for seed in range(12):
        found = align_trajectories(*seen(np.random.default_rng(seed), time=time), TrajectoryConfig(max_offset=0.04))
        e = error(found)
        nees.append(e @ np.linalg.solve(found.covariance, e) / 4)
    # 12 runs of 4 degrees of freedom: 1 +- 0.2; covariances of 20 to 200 stretches raise it by up to a fifth. Without regard to the
    # correlation it would be 1, 5 and 25.
    assert 0.6 < np.mean(nees) < 1.7
    assert found.correlation_time == pytest.approx(max(2 * time, 0.04), rel=0.35)
    assert found.n_effective == pytest.approx(60 / max(2 * time, 0.04), rel=0.5)


def test_a_tilted_sensor_in_space():
    """A hand that moves in all directions gives all six degrees of freedom; errors within four sigma."""
    rng = np.random.default_rng(4)
    first, second = seen(rng, d=3)
    found = align_trajectories(first, second, TrajectoryConfig(freedom="full"))
    assert found.names == ("x", "y", "z", "roll", "pitch", "yaw", "offset")
    assert (np.abs(found.translation - SHIFT) < 4 * np.sqrt(np.diag(found.covariance))[:3]).all()
    small = found.rotation @ np.array([[np.cos(YAW), -np.sin(YAW), 0], [np.sin(YAW), np.cos(YAW), 0], [0, 0, 1]]).T
    assert abs(small[2, 1]) < 4 * found.std["roll"]
    assert abs(small[0, 2]) < 4 * found.std["pitch"]


@pytest.mark.parametrize("offset", [-0.15, 0.0, 0.2])
def test_clocks_far_apart(offset):
    """Offsets of several samples are found without a guess; 5 ms is four sigma here."""
    found = align_trajectories(*seen(np.random.default_rng(3), offset=offset))
    assert found.offset == pytest.approx(offset, abs=max(5e-3, 4 * found.std["offset"]))


def test_different_rates_and_gaps_and_outliers():
    """The second sensor is slower, blind for 10 s, and wrong by a metre in one sample of eight."""
    rng = np.random.default_rng(5)
    first, second = seen(rng, step=0.02)
    index = np.flatnonzero((np.arange(len(second)) % 3 == 0) & ((np.arange(len(second)) < 1000) | (np.arange(len(second)) > 1500)))
    wrong = rng.random(len(index)) < 0.125
    second = kept(second, index, position=second.position[index] + np.where(wrong[:, None], rng.uniform(0.7, 1.5, (len(index), 2)), 0.0))
    found = align_trajectories(first, second)
    assert (np.abs(error(found)) < 4 * np.sqrt(np.diag(found.covariance))).all()
    assert found.pairs == len(index)
    assert (found.weight[wrong] == 0).all()
    assert found.inlier_share == pytest.approx(1 - wrong.mean(), abs=0.03)


def test_known_velocities_carry_sparse_samples():
    """Five samples a second of a fast hand: a straight line through neighbours cuts corners, velocities do not."""

    def hand(t, phase):
        return place(t, phase) + 0.3 * np.stack([np.zeros(len(t)), np.sin(6 * t), np.cos(6 * t)], axis=1)

    first, second = seen(np.random.default_rng(6), step=0.05, std=0.0, path=hand, offset=0.09)
    coarse = np.arange(0, len(first), 4)
    t = (first.stamp_ns[coarse] - first.stamp_ns[0]) * 1e-9
    phase = np.random.default_rng(6).uniform(0, 6, 3)
    velocity = (hand(t + 1e-5, phase) - hand(t - 1e-5, phase))[:, :2] / 2e-5
    rms = [align_trajectories(kept(first, coarse, velocity=v), second, TrajectoryConfig(max_gap=0.3)).rms for v in (None, velocity)]
    assert rms[1] < 0.5 * rms[0]


def test_depth_is_found_where_sensors_look_from_two_sides():
    """Both see the side of a body that faces them, 9 cm before its centre; 1.6 m apart the pose is wrong by centimetres unless told."""
    rng = np.random.default_rng(7)
    shift = np.array([0.0, -1.6])
    t = np.arange(3000) * 0.02
    path = place(t)[:, :2] + [0.0, -0.8]
    sides = [path, path - shift]
    sides = [p - 0.09 * p / np.linalg.norm(p, axis=1, keepdims=True) + rng.normal(0, 0.02, p.shape) for p in sides]
    tracks = [Trajectory((t * 1e9).astype(np.int64), p, 0.02**2 * np.eye(2)) for p in sides]
    plain = align_trajectories(*tracks, TrajectoryConfig(clock=False))
    deep = align_trajectories(*tracks, TrajectoryConfig(clock=False, depth="estimated", depth_std=0.1, depth_difference_std=0.01))
    assert deep.names == ("x", "y", "yaw", "depth", "depth_difference")
    assert np.linalg.norm(plain.translation - shift) > 0.03
    assert np.linalg.norm(deep.translation - shift) < 0.015
    assert deep.depth == pytest.approx(0.09, abs=4 * deep.std["depth"])
    assert deep.std["depth"] < 0.02
    # not estimated, the depth makes the result as unsure as it is wrong: one sigma, as the prior says, with 0.09 m
    unsure = align_trajectories(*tracks, TrajectoryConfig(clock=False, depth_std=0.09))
    np.testing.assert_allclose(unsure.translation, plain.translation, atol=1e-9)
    e = np.append(unsure.translation - shift, unsure.yaw)
    # its own errors make it a little less or more
    assert 0.5 < e @ np.linalg.solve(unsure.covariance, e) < 2.0


def straight(t, phase):
    """Away from the sensor at one speed."""
    return np.stack([1.0 + 0.5 * t, np.zeros(len(t)), np.ones(len(t))], axis=1)


def standing(t, phase):
    """At one place."""
    return np.tile([2.0, 0.5, 1.0], (len(t), 1))


@pytest.mark.parametrize(
    ("path", "settings", "open_one", "advice"),
    [
        (straight, TrajectoryConfig(), "offset", "several directions"),
        (standing, TrajectoryConfig(), "yaw", "move"),
        (standing, TrajectoryConfig(clock=False), "yaw", "move"),
        (straight, TrajectoryConfig(freedom="full", clock=False), "roll", "one line"),
    ],
)
@pytest.mark.parametrize("std", [0.0, STD])
def test_movements_that_leave_something_open_are_refused(path, settings, open_one, advice, std):
    """With and without noise: it says what, and what to do."""
    tracks = seen(np.random.default_rng(8), d=3, seconds=10.0, path=path, std=std, yaw=0.0)
    with pytest.raises(NotObservableError, match=advice) as caught:
        align_trajectories(*tracks, settings)
    assert open_one in caught.value.parameters


def test_a_straight_walk_is_enough_without_a_clock():
    """Yaw and translation of levelled sensors come from one line, if stamps are to be trusted."""
    tracks = seen(np.random.default_rng(9), seconds=8.0, path=straight, offset=0.0)
    found = align_trajectories(*tracks, TrajectoryConfig(clock=False))
    assert found.names == ("x", "y", "yaw")
    assert found.offset == 0.0
    assert (np.abs(error(found)[:3]) < 4 * np.sqrt(np.diag(found.covariance))).all()


def test_errors_as_long_as_the_walk_have_no_uncertainty():
    """Nothing can be said of errors that do not change within the walk."""
    tracks = seen(np.random.default_rng(10), seconds=4.0, time=1.0)
    with pytest.raises(NotObservableError, match="measure for longer"):
        align_trajectories(*tracks, TrajectoryConfig(clock=False, correlation_time=2.0))


@pytest.mark.parametrize(
    ("changes", "match"),
    [
        ({"stamp_ns": np.array([3, 2, 1])}, "does not ascend at sample 1"),
        ({"stamp_ns": np.array([1.0, 2.0, 3.0])}, "whole nanoseconds"),
        ({"stamp_ns": np.array([1, 2])}, "stamp_ns has shape"),
        ({"position": np.full((3, 2), np.nan)}, "Trajectory positions has 6 non-finite"),
        ({"velocity": np.full((3, 2), np.inf)}, "velocity holds an infinity"),
        ({"velocity": np.zeros((3, 3))}, "velocity has shape"),
    ],
)
def test_trajectories_are_checked(changes, match):
    """The error names the field."""
    good = {"stamp_ns": np.array([1, 2, 3]), "position": np.zeros((3, 2)), "covariance": np.eye(2)}
    with pytest.raises(DataError, match=match):
        Trajectory(**{**good, **changes})


def test_trajectories_that_do_not_meet_are_refused():
    """Another time, another dimension, or too few samples."""
    first, second = seen(np.random.default_rng(11), seconds=4.0)
    with pytest.raises(DataError, match="only 0 samples"):
        align_trajectories(first, kept(second, slice(None), stamp_ns=second.stamp_ns + 10**10))
    with pytest.raises(DataError, match="leave out z"):
        align_trajectories(first, seen(np.random.default_rng(11), d=3, seconds=4.0)[1])
    with pytest.raises(DataError, match="20 are needed"):
        align_trajectories(first, kept(second, slice(0, 12)))


def test_slopes_and_nearest_samples():
    """Slopes of a straight line are exact at uneven stamps and across gaps; the nearest sample is within half a gap."""
    rng = np.random.default_rng(12)
    t = np.cumsum(rng.uniform(0.01, 0.2, 60))
    t[30:] += 3.0
    track = Trajectory((t * 1e9).astype(np.int64), np.outer(t, [0.7, -1.1]), np.eye(2))
    found = slopes(track, 0.3)
    np.testing.assert_allclose(found.velocity, np.tile([0.7, -1.1], (60, 1)), rtol=1e-6)
    # at the ends and at the gap there are samples on one side only: slopes are at least half as unsure again
    assert found.covariance[[0, 29, 30, 59], 0, 0].mean() > 1.5 * np.median(found.covariance[:, 0, 0])
    index, partner = nearest(track, track.stamp_ns + 20_000_000, -0.02, 0.1)
    assert np.array_equal(index, np.arange(60))
    assert np.array_equal(partner, np.arange(60))
    assert len(nearest(track, track.stamp_ns[:1] - 10**9, 0.0, 0.1)[0]) == 0


def test_correlation_times():
    """First-order errors last for twice their time constant; stretches are eight times as long."""
    rng = np.random.default_rng(13)
    stamp = np.arange(20_000) * 20_000_000
    found = integrated_time(stamp, lasting(rng, 20_000, 2, 0.02, 0.3), np.ones(20_000))
    # 400 s hold 660 independent errors of two components; Sokal's window leaves a tenth
    assert found == pytest.approx(0.6, rel=0.2)
    group, longest = groups_of(stamp, found)
    assert group[-1] + 1 == pytest.approx(400 / (8 * found), abs=1)
    assert longest == pytest.approx(1 / 16)
