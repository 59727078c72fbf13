"""The velocity of a hand from one snapshot of several radars (thesis, 7.3.1): its errors, bounds, and geometry that tells little."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from benchmarks.velocity_room import at, bound, draw, draws, errors, forearm, mounts
from radar_core import DataError
from radar_tracking.estimators import Snapshot, SnapshotConfig
from radar_tracking.metrics.consistency import chi_square_band

POINT = SnapshotConfig(spread=0.0, common=0.0, spin=0.0, iterations=1, max_std=10.0)
"""The thesis's model: a point, errors of the rates only."""
SENSORS = np.array([[0.0, 0.25, 1.2], [0.0, -0.25, 1.2]])


def seen(place, sensor, d=2):
    """Directions from sensors to one place, shape (n, d)."""
    away = place[:d] - SENSORS[sensor, :d]
    return away / np.linalg.norm(away, axis=1)[:, None]


def test_equal_errors_give_the_pseudo_inverse():
    """Equation 7.5."""
    rng = np.random.default_rng(1)
    direction = seen(np.array([1.5, 0.2]), np.array([0, 0, 0, 1, 1]))
    direction += 0.02 * rng.normal(size=direction.shape)
    direction /= np.linalg.norm(direction, axis=1)[:, None]
    rate = rng.normal(size=5)
    found = Snapshot(POINT).process(direction, rate, np.full(5, 0.3))
    np.testing.assert_allclose(found.velocity, np.linalg.pinv(direction) @ rate, rtol=1e-10)
    assert found.whole
    assert found.rank == 2


def test_errors_reach_the_bound():
    """For Gaussian rates weighted least squares is efficient: 4,000 draws, each figure within four of its own standard deviations."""
    rng, n = np.random.default_rng(2), 4000
    direction, truth = seen(np.array([1.5, 0.2]), np.array([0, 0, 0, 1, 1])), np.array([0.7, -1.1])
    std = np.array([0.1, 0.14, 0.1, 0.1, 0.17])
    bound = np.linalg.inv(direction.T @ (direction / std[:, None] ** 2))
    snapshot = Snapshot(POINT)
    draws = [snapshot.process(direction, direction @ truth + std * rng.normal(size=5), std) for _ in range(n)]
    np.testing.assert_allclose(draws[0].covariance, bound, rtol=1e-9)
    velocity = np.array([draw.velocity for draw in draws])
    assert (np.abs(velocity.mean(axis=0) - truth) < 4 * np.sqrt(np.diag(bound) / n)).all()
    sample = np.cov(velocity.T)
    spread = np.sqrt((np.outer(np.diag(bound), np.diag(bound)) + bound**2) / n)
    assert (np.abs(sample - bound) < 4 * spread).all()


@pytest.mark.parametrize("iterations", [1, 4])
def test_hands_that_turn_are_estimated_as_well_as_it_says(iterations):
    """Turn rates, sides and points drawn from the model, in 3-D: NEES over what is told has its mean, within 4 sigma; so with weights.

    Without outliers Huber's weights cost at most 5 % of the efficiency (2 standard deviations), and their covariance says so only in part:
    a tenth more is allowed.
    """
    rng, config = np.random.default_rng(3), SnapshotConfig(iterations=iterations, max_std=2.0)
    snapshot, nees, told = Snapshot(config), 0.0, 0
    for _ in range(1500):
        n = int(rng.integers(2, 12))
        sensor = rng.integers(0, 2, n)
        centre = np.array([rng.uniform(0.8, 2.5), rng.uniform(-0.6, 0.6), rng.uniform(0.8, 1.6)])
        offset = rng.normal(0, 0.05, (n, 3))
        away = centre + offset - SENSORS[sensor]
        direction = away / np.linalg.norm(away, axis=1)[:, None]
        velocity, turn = rng.normal(0, 1.0, 3), rng.normal(0, config.spin, 3)
        amplitude, std = rng.uniform(0.5, 2.0, n), rng.uniform(0.02, 0.1, n)
        own = np.sqrt(std**2 + config.spread**2 * amplitude.mean() / amplitude)
        rate = (direction * (velocity + np.cross(turn, offset))).sum(1)
        rate += config.common * rng.normal(size=2)[sensor] + own * rng.normal(size=n)
        found = snapshot.process(direction, rate, std, offset=offset, sensor=sensor, amplitude=amplitude)
        known = np.isfinite(found.along)
        nees += float((((found.along - found.axes @ velocity) / found.std)[known] ** 2).sum())
        told += int(known.sum())
    assert told > 1500
    assert abs(nees / told - 1.0) < 4 * np.sqrt(2 / told) + (0.1 if iterations > 1 else 0.0)


@pytest.mark.parametrize("speed", [0.0, 0.5, 3.0])
def test_a_faster_hand_errs_more_and_says_so(speed):
    """Hands whose spread, sides and turns are as large as they are at a speed: NEES has its mean within 4 sigma where the speed is told."""
    config = SnapshotConfig(iterations=1, max_std=5.0)
    more = config.factor(speed)
    rng, nees, told, blind = np.random.default_rng(13), 0.0, 0, 0.0
    truth = SnapshotConfig(spread=more * config.spread, common=more * config.common, spin=more * config.spin)
    for _ in range(600):
        hand = draw(rng, np.array([rng.uniform(0.8, 2.0), rng.uniform(-0.5, 0.5), 1.2]), mounts(0.5), truth, speed=speed)
        given = {"offset": hand.offset, "sensor": hand.sensor, "amplitude": hand.amplitude}
        for known in (speed, None):
            found = Snapshot(config).process(hand.direction, hand.rate, hand.rate_std, **given, speed=known)
            wrong = (((found.along - found.axes @ hand.velocity) / found.std) ** 2)[np.isfinite(found.along)]
            nees, told, blind = (nees + wrong.sum(), told + len(wrong), blind) if known is not None else (nees, told, blind + wrong.sum())
    assert abs(nees / told - 1.0) < 4 * np.sqrt(2 / told)
    assert blind > 2.0 * nees if speed > 1.0 else blind < 0.95 * nees


def test_the_factor_of_a_speed():
    """1 at 1 m/s and where nothing is known; least at rest; in proportion when fast."""
    config = SnapshotConfig()
    assert config.factor(None) == config.factor(1.0) == 1.0
    assert config.factor(0.0) == pytest.approx(config.rest / np.hypot(1.0, config.rest))
    assert config.factor(200.0) == pytest.approx(2.0 * config.factor(100.0), rel=1e-3)


@pytest.mark.parametrize("speed", [-0.1, np.nan, np.inf])
def test_a_speed_that_makes_no_sense_is_refused(speed):
    with pytest.raises(DataError, match="speed is"):
        Snapshot().process(np.eye(2), np.zeros(2), np.full(2, 0.1), speed=speed)


def test_a_wide_hand_that_turns_does_not_pass_for_a_fast_one():
    """Each radar sees the side that faces it, 4 cm from the middle; at 4 rad/s a point model errs more than it says, the rigid one not."""
    sensor, centre, velocity, turn = np.array([0, 0, 1, 1]), np.array([1.2, 0.0, 1.2]), np.array([0.0, 1.5, 0.0]), np.array([0.0, 0.0, 4.0])
    offset = np.array([[0.0, 0.03, 0.0], [0.0, 0.05, 0.0], [0.0, -0.03, 0.0], [0.0, -0.05, 0.0]])
    away = centre + offset - SENSORS[sensor]
    direction = away / np.linalg.norm(away, axis=1)[:, None]
    rate = (direction * (velocity + np.cross(turn, offset))).sum(1)
    errors = {}
    for name, spin in (("point", 0.0), ("rigid", 4.0)):
        found = Snapshot(SnapshotConfig(spin=spin, spread=0.02, common=0.0, max_std=2.0)).process(
            direction, rate, np.full(4, 0.02), offset=offset, sensor=sensor
        )
        along = np.isfinite(found.along)
        errors[name] = np.abs((found.along - found.axes @ velocity) / found.std)[along].max()
    assert errors["point"] > 5.0
    assert errors["rigid"] < 2.0


def test_an_outlier_hardly_counts():
    """One of eight points is wrong by 3 m/s: without weights the estimate is off by many of its deviations, with them by less than one."""
    rng = np.random.default_rng(4)
    sensor, truth = np.array([0, 0, 0, 0, 1, 1, 1, 1]), np.array([0.5, 0.8])
    direction = seen(np.array([1.3, 0.1]), sensor)
    rate = direction @ truth + 0.05 * rng.normal(size=8)
    rate[2] += 3.0
    off = {}
    for iterations in (1, 6):
        config = SnapshotConfig(spread=0.0, common=0.0, spin=0.0, iterations=iterations, max_std=10.0)
        found = Snapshot(config).process(direction, rate, np.full(8, 0.05))
        off[iterations] = np.abs((found.along - found.axes @ truth) / found.std).max()
    assert off[1] > 5.0
    assert off[6] < 2.5
    assert found.outliers == 1
    assert found.weight.argmin() == 2


def test_a_far_outlier_does_not_pass_for_a_turn_of_the_hand():
    """Four points of each radar, one of them 0.3 m off with a rate of 3.9 m/s: 13 rad/s would explain it, and its own residual is small.

    Rates are exact otherwise, so that the error is the outlier's alone. Huber's weight leaves every outlier a pull of 2 deviations of what
    foretells it, a share of which reaches the estimate: less than one of its own deviations. Without weights it is twenty.
    """
    sensor, centre, velocity = np.repeat([0, 1], 4), np.array([2.4, 0.1, 1.2]), np.array([0.0, -0.25, 0.0])
    offset = np.array([[0.02, 0.11, 0.0], [0.0, 0.0, 0.05], [-0.03, 0.0, 0.02], [0.0, -0.05, 0.0]] * 2)
    offset[5] = [0.2, 0.2, -0.1]
    away = centre + offset - SENSORS[sensor]
    direction = away / np.linalg.norm(away, axis=1)[:, None]
    rate = direction @ velocity
    rate[5] = 3.9
    off = {}
    for iterations in (1, 4):
        snapshot = Snapshot(SnapshotConfig(iterations=iterations, max_std=10.0))
        found = snapshot.process(direction, rate, np.full(8, 0.04), offset=offset, sensor=sensor)
        off[iterations] = float(np.abs((found.along - found.axes @ velocity) / found.std).max())
    assert off[1] > 5.0
    assert off[4] < 1.0
    assert found.weight.argmin() == 5
    assert found.outliers == 1
    assert (np.delete(found.weight, 5) > 0.5).all()


@pytest.mark.parametrize(
    ("direction", "rank"),
    [
        (np.array([[1.0, 0.0, 0.0]]), 1),  # one point
        (np.array([[0.8, 0.6, 0.0]] * 5), 1),  # one radar, one line of sight
        (np.array([[0.0, 1.0, 0.0], [0.0, -1.0, 0.0]]), 1),  # the hand on the base line, between the radars
        (np.array([[1.0, 0.0, 0.0], [0.8, 0.6, 0.0]]), 2),  # two radars at the hand's height: nothing of what goes up
        (np.eye(3), 3),  # three radars
        (np.empty((0, 3)), 0),
    ],
)
def test_geometry_that_does_not_tell(direction, rank):
    """What is told is right, what is not is NaN with its deviation infinite; nothing explodes."""
    velocity = np.array([0.3, -0.7, 0.2])
    found = Snapshot(SnapshotConfig(spread=0.01, common=0.0)).process(direction, direction @ velocity, np.full(len(direction), 0.05))
    assert found.rank == rank
    known = np.isfinite(found.along)
    assert known.sum() == rank
    np.testing.assert_allclose(found.along[known], (found.axes @ velocity)[known], atol=1e-9)
    assert np.isinf(found.std[~known]).all()
    assert found.whole == (rank == 3)
    assert np.isnan(found.covariance).all() == (rank < 3)
    assert np.isfinite(found.condition) == (rank == 3)
    np.testing.assert_allclose(found.axes @ found.axes.T, np.eye(3), atol=1e-12)


ACROSS, ALONG, UP = np.eye(3)[[1, 0, 2]]
SINGULAR = {
    # name: places of the radars, of the hand, points of each radar, extent of the hand [m], rank, first axis (None: not one)
    "one radar": ([[0, 0, 1.2]], [1.5, 0, 1.2], [5], 0.04, 1, ALONG),
    "both radars at one place": ([[0, 0, 1.2]] * 2, [1.5, 0, 1.2], [4, 4], 0.04, 1, ALONG),
    "one behind the other": ([[0, 0, 1.2], [-0.5, 0, 1.2]], [1.5, 0, 1.2], [4, 4], 0.04, 1, ALONG),
    "hand between the radars": ([[0, 0.25, 1.2], [0, -0.25, 1.2]], [0, 0, 1.2], [4, 4], 0.01, 1, ACROSS),
    "hand on the extension of the base line": ([[0, 0.25, 1.2], [0, -0.25, 1.2]], [0, 1.5, 1.2], [4, 4], 0.04, 1, ACROSS),
    "hand at a radar": ([[0, 0.25, 1.2], [0, -0.25, 1.2]], [0, 0.25, 1.2], [1, 1], 0.0, 1, ACROSS),
    "hand at the only radar": ([[0, 0, 1.2]], [0, 0, 1.2], [3], 0.0, 0, None),
    "all points coincide": ([[0, 0.25, 1.2], [0, -0.25, 1.2]], [1.0, 0, 1.2], [4, 4], 0.0, 2, ALONG),
    "a radar above the other": ([[0, 0, 0.95], [0, 0, 1.45]], [1.0, 0, 1.2], [4, 4], 0.0, 2, ALONG),
    "one point": ([[0, 0, 1.2]], [1.5, 0, 1.2], [1], 0.0, 1, ALONG),
    "a point of each radar": ([[0, 0.25, 1.2], [0, -0.25, 1.2]], [0.8, 0, 1.2], [1, 1], 0.0, 2, ALONG),
    "two points of one radar, none of the other": ([[0, 0.25, 1.2], [0, -0.25, 1.2]], [1.5, 0.25, 1.2], [2, 0], 0.04, 1, ALONG),
    "no points": ([[0, 0, 1.2]], [1.5, 0, 1.2], [0], 0.0, 0, None),
    "hand 100 m away": ([[0, 0.25, 1.2], [0, -0.25, 1.2]], [100, 0, 1.2], [4, 4], 0.04, 1, ALONG),
    "hand overhead": ([[0, 0.25, 1.2], [0, -0.25, 1.2]], [0, 0, 11.2], [4, 4], 0.02, 1, UP),
}


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("name", SINGULAR)
def test_singular_geometries_one_by_one(name):
    """Default settings, exact rates, a hand that moves at 1 m/s aslant: only the axes are told that are known, and those are right.

    Rates are exact, so that what is told is exact whatever the weights: to rounding, 1e-9. The first axis is the mean line of sight, within
    the width of the hand.
    """
    sensors, place, counts, extent, rank, first = SINGULAR[name]
    sensors, sensor, velocity = np.array(sensors, float), np.repeat(np.arange(len(counts)), counts), np.array([0.6, -0.7, 0.4])
    offset = extent * np.random.default_rng(8).normal(size=(len(sensor), 3))
    away = np.array(place) + offset - sensors[sensor]
    far = np.linalg.norm(away, axis=1)
    direction = away / np.where(far > 0, far, 1.0)[:, None]
    std = np.full(len(sensor), 0.04)
    found = Snapshot().process(direction, direction @ velocity, std, offset=offset, sensor=sensor)
    told = np.isfinite(found.along)
    assert found.rank == told.sum() == rank
    np.testing.assert_array_equal(told, np.arange(3) < rank)  # the best known first
    np.testing.assert_allclose(found.along[told], (found.axes @ velocity)[told], atol=1e-9)
    np.testing.assert_allclose(found.axes @ found.axes.T, np.eye(3), atol=1e-12)
    assert (found.std[told] <= SnapshotConfig().max_std).all()
    assert (found.std[~told] > SnapshotConfig().max_std).all()
    assert not np.isnan(found.std).any()
    assert found.condition >= 1.0
    np.testing.assert_array_equal(np.isnan(found.weight), far == 0)
    if first is not None:
        assert abs(found.axes[0] @ first) > 0.95
    if extent == 0:  # no line of sight but those of the centre: nothing is known beyond them
        assert np.isinf(found.std[rank:]).all()


def test_the_two_derivations_of_the_bound_agree():
    """Nuisances as unknowns of one Fisher information, or as noise that points have in common: the same matrix, by Woodbury's identity."""
    rng, config = np.random.default_rng(9), SnapshotConfig(iterations=1)
    for _ in range(20):
        place = np.array([rng.uniform(0.4, 2.5), rng.uniform(-1, 1), rng.uniform(0.8, 1.6)])
        hand = draw(rng, place, mounts(0.5), config)
        turn = np.cross(hand.offset, hand.direction)
        R = np.diag(errors(hand.rate_std, hand.amplitude, config) ** 2) + config.spin**2 * turn @ turn.T
        R += config.common**2 * (hand.sensor[:, None] == hand.sensor[None, :])
        np.testing.assert_allclose(np.linalg.inv(hand.direction.T @ np.linalg.solve(R, hand.direction)), bound(hand, config), rtol=1e-7)
        found = Snapshot(config).process(
            hand.direction, hand.rate, hand.rate_std, offset=hand.offset, sensor=hand.sensor, amplitude=hand.amplitude
        )
        limit = np.sqrt(((found.axes @ bound(hand, config)) * found.axes).sum(axis=1))
        np.testing.assert_allclose(found.std, limit, rtol=1e-6)  # without weights it says of itself what the bound says


@pytest.mark.parametrize(
    ("place", "baseline", "told"),
    [
        ((0.6, 0.0, 1.2), 0.3, True),
        ((0.9, 0.3, 1.2), 0.5, True),
        ((1.2, -0.9, 0.8), 0.6, True),
        ((1.5, 0.0, 1.6), 0.6, True),
        ((5.5, 0.0, 1.2), 0.3, False),
        ((4.5, 2.5, 1.2), 0.3, False),
    ],
)
def test_errors_stay_near_the_bound_and_are_as_large_as_told(place, baseline, told):
    """400 hands drawn at a place: at most 1.4 of the Cramer-Rao bound along every axis that is told, NEES in its 99.9 % band.

    Of 400 draws a standard deviation is known to 3.5 % (of 100, the fewest that are judged, to 7 %): nothing is better than the bound by
    more than four of these. Huber's weights cost 1 % of the variance (2 standard deviations), far within both. Where the lines of sight
    are too near to each other, less than one in ten snapshots tells a second axis, elsewhere nine in ten.
    """
    found = at(np.array(place), baseline, 400)
    known = np.isfinite(found["ratio"])
    assert known[0]
    assert known[1] == told
    assert (found["ratio"][known] <= 1.4).all()
    assert (found["ratio"][known] >= 1.0 - 4 / np.sqrt(2 * 400 * found["told"][known])).all()
    low, high = chi_square_band(found["freedom"], 0.999)
    assert low <= found["nees"] <= high
    assert found["told"][0] == 1.0
    assert (found["told"][1] > 0.9) if told else (found["told"][1] < 0.1)


@pytest.mark.long
def test_weights_pay_where_points_are_forearm_and_cost_nothing_elsewhere():
    """One point of ten lies on the forearm: errors fall by a tenth or more, NEES by a quarter; without any, errors grow by less than 3 %.

    The same 600 hands with and without weights, so that the difference is known better than either.
    """
    figures = {}
    for name, spoil, share in (("all hand", None, 0.0), ("forearm", forearm, 0.1)):
        for rounds in (1, 4):
            config = SnapshotConfig(iterations=rounds)
            rng = np.random.default_rng(12)
            found = draws(rng, np.array([1.2, 0.2, 1.2]), mounts(0.5), 600, config=config, spoil=spoil, share=share)
            figures[name, rounds] = np.sqrt(np.nanmean(found.error[:, 0] ** 2)), found.nees
    assert figures["all hand", 4][0] < 1.03 * figures["all hand", 1][0]
    assert figures["forearm", 4][0] < 0.9 * figures["forearm", 1][0]
    assert figures["forearm", 4][1] < 0.75 * figures["forearm", 1][1]


def test_nearly_parallel_lines_of_sight_are_refused_by_their_error():
    """The closer the radars, the less is known across: the deviation grows as one over the angle, and beyond `max_std` nothing is told."""
    for angle in (0.3, 0.1, 0.03, 1e-4, 1e-9):
        direction = np.array([[np.cos(angle), np.sin(angle)], [np.cos(angle), -np.sin(angle)]])
        found = Snapshot(POINT).process(direction, np.zeros(2), np.full(2, 0.05))
        assert found.rank == (2 if 0.05 / (np.sqrt(2) * np.sin(angle)) < POINT.max_std else 1)
        if angle > 1e-6:
            assert found.std[1] == pytest.approx(0.05 / (np.sqrt(2) * np.sin(angle)), rel=1e-6)


@settings(max_examples=60, deadline=None)
@given(st.integers(0, 2**32 - 1), st.integers(1, 20), st.sampled_from([2, 3]))
def test_a_turned_room_turns_the_velocity(seed, n, d):
    """Property: any rotation of room, sensors and hand leaves what is known the same, turned."""
    rng = np.random.default_rng(seed)
    direction = rng.normal(size=(n, d))
    direction /= np.linalg.norm(direction, axis=1)[:, None]
    offset, rate, std = rng.normal(0, 0.05, (n, d)), rng.normal(size=n), rng.uniform(0.01, 0.2, n)
    turn = np.linalg.qr(rng.normal(size=(d, d)))[0]
    turn[:, 0] *= np.sign(np.linalg.det(turn))
    snapshot = Snapshot(SnapshotConfig(max_std=5.0, iterations=1))
    a = snapshot.process(direction, rate, std, offset=offset)
    b = snapshot.process(direction @ turn.T, rate, std, offset=offset @ turn.T)
    assert a.rank == b.rank
    np.testing.assert_allclose(a.std, b.std, rtol=1e-6)
    known = np.isfinite(a.along)
    np.testing.assert_allclose((a.axes[known].T @ a.along[known]) @ turn.T, b.axes[known].T @ b.along[known], atol=1e-6)


def test_points_without_a_rate_do_not_count():
    """NaN is the mark for what was not measured; nothing measured: nothing told."""
    direction, rate = seen(np.array([1.5, 0.2]), np.array([0, 1, 1])), np.array([0.3, np.nan, -0.2])
    both, std = Snapshot(POINT).process(direction, rate, np.full(3, 0.1)), np.full(3, 0.1)
    np.testing.assert_array_equal(both.velocity, Snapshot(POINT).process(direction[[0, 2]], rate[[0, 2]], std[:2]).velocity)
    assert np.isnan(both.weight[1])
    assert Snapshot(POINT).process(direction, np.full(3, np.nan), std).rank == 0


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"direction": np.full((2, 2), np.inf)}, "direction or rate"),
        ({"rate": np.array([0.1, np.inf])}, "direction or rate"),
        ({"rate_std": np.zeros(2)}, "rate_std"),
        ({"rate_std": np.array([0.1, np.nan])}, "rate_std"),
        ({"rate": np.zeros(3)}, "shapes"),
        ({"offset": np.full((2, 2), np.nan)}, "offset"),
        ({"amplitude": np.array([1.0, 0.0])}, "amplitude"),
        ({"amplitude": np.ones(3)}, "shapes"),
        ({"sensor": np.zeros(1, np.int64)}, "shapes"),
        ({"direction": 2 * np.eye(2)}, "no unit vector"),
        ({"direction": np.full((2, 2), 1e300)}, "no unit vector"),
    ],
)
def test_what_makes_no_sense_is_refused(change, message):
    """By the name of the field."""
    given_ = {"direction": np.eye(2), "rate": np.zeros(2), "rate_std": np.full(2, 0.1)} | change
    rest = {name: given_.pop(name) for name in ("offset", "sensor", "amplitude") if name in given_}
    with pytest.raises(DataError, match=message):
        Snapshot().process(*given_.values(), **rest)
