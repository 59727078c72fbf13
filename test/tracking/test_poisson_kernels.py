"""The compiled loops of the Poisson tracker equal their definitions in numpy, and shares of points are probabilities."""

import math

import numpy as np
import pytest
from blobs import make_cloud
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.special import erf

from radar_core import PointCloud, Pose, RadarInfo
from radar_tracking import TrackerConfig
from radar_tracking.people.points import Admission
from radar_tracking.people.zones import View
from radar_tracking.poisson import clutter as clutters
from radar_tracking.poisson import kernels
from radar_tracking.poisson.config import PoissonConfig
from radar_tracking.poisson.kernels import Shares, TrackArrays, behind, densest, hidden
from radar_tracking.poisson.points import Measure, Measured

CONFIG = PoissonConfig()
seeds = st.integers(0, 2**32 - 1)
often = settings(max_examples=40, deadline=None)


def measured_of(plane: np.ndarray, speed: np.ndarray) -> Measured:
    """Points on the floor plane, shape (n, 2), as the tracker takes them in."""
    cloud = make_cloud(np.column_stack([plane, np.ones(len(plane))]), radial_speed=speed.astype(np.float32))
    return Measure(TrackerConfig(), Admission(TrackerConfig(), np.zeros(3)), View()).process(cloud)


def some_points(rng: np.random.Generator, n: int) -> Measured:
    """Points in a small room: some still, some moving, some without a speed."""
    speed = rng.choice([0.0, 0.05, np.nan, 1.0], n) * rng.normal(1, 0.5, n)
    return measured_of(rng.uniform([1.0, -2.0], [5.0, 2.0], (n, 2)), speed)


def some_tracks(rng: np.random.Generator, m: int) -> TrackArrays:
    """States with any positive definite covariance."""
    root = rng.normal(0, 0.2, (m, 4, 4))
    mean = np.column_stack([rng.uniform([1.0, -2.0], [5.0, 2.0], (m, 2)), rng.normal(0, 1, (m, 2))])
    return TrackArrays(mean, root @ root.transpose(0, 2, 1) + 1e-3 * np.eye(4), rng.uniform(0.5, 30, m), rng.uniform(0.01, 0.999, m))


def gauss(along, across, along_variance, across_variance):
    """Density of two independent normal variables."""
    exponent = along**2 / along_variance + across**2 / across_variance
    return np.exp(-0.5 * exponent) / (2 * np.pi * np.sqrt(along_variance * across_variance))


def rate_factor(measured: Measured, expected: np.ndarray, variance: np.ndarray) -> np.ndarray:
    """Likelihood ratio of the range rates to clutter's, shape (n_points, n_tracks)."""
    half, speed = measured.still_speed, measured.speed[:, None]
    std = np.sqrt(2 * variance)
    still = 0.5 * (erf((half - expected) / std) - erf((-half - expected) / std))
    wide = variance + half**2 / 3
    moving = 2 * kernels.FASTEST * np.exp(-0.5 * (speed - expected) ** 2 / wide) / np.sqrt(2 * np.pi * wide)
    return np.where(measured.still[:, None], still, np.where(np.isnan(speed), 1.0, moving))


def densities(measured: Measured, state: TrackArrays) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Densities of torsos and limbs, shape (n_points, n_tracks), and the still points at torsos."""
    sight = np.stack([measured.ux, measured.uy], axis=-1)
    cross = np.stack([-measured.uy, measured.ux], axis=-1)
    step = np.stack([measured.x, measured.y], axis=-1)[:, None] - state.mean[None, :, :2]
    dr, dc = np.einsum("nmi,ni->nm", step, sight) + CONFIG.surface, np.einsum("nmi,ni->nm", step, cross)
    rr = np.einsum("ni,mij,nj->nm", sight, state.covariance[:, :2, :2], sight)
    cc = np.einsum("ni,mij,nj->nm", cross, state.covariance[:, :2, :2], cross)
    vv = np.einsum("ni,mij,nj->nm", sight, state.covariance[:, 2:, 2:], sight)
    expected, (along, across) = sight @ state.mean[:, 2:].T, (measured.range_variance[:, None], measured.cross_variance[:, None])
    near = np.hypot(step[..., 0], step[..., 1]) <= kernels._FAR
    found = []
    for share, body, speed in (
        (1 - CONFIG.limb_share, CONFIG.torso_std**2, CONFIG.torso_speed**2),
        (CONFIG.limb_share, CONFIG.limb_std**2, CONFIG.limb_speed**2),
    ):
        density = gauss(dr, dc, body + along + rr, body + across + cc)
        found.append(np.where(near, share * density * rate_factor(measured, expected, speed + vv), 0.0))
    body = CONFIG.torso_std**2
    at = np.exp(-0.5 * (dr**2 / (body + along) + dc**2 / (body + across)))
    return found[0], found[1], np.where(near & measured.still[:, None], at, 0.0).sum(axis=0)


@often
@given(seed=seeds, n=st.integers(0, 40), m=st.integers(1, 5))
def test_shares_are_their_definition(seed, n, m):
    """Torso, limbs, count, evidence and support by whole arrays, to 1e-9; what is left of 1 is clutter."""
    rng = np.random.default_rng(seed)
    measured, state = some_points(rng, n), some_tracks(rng, m)
    clutter = rng.uniform(0.01, 3, n)
    shares = Shares(measured, clutter, state, CONFIG)
    torso, limb, support = densities(measured, state)
    weight, own = state.existence * state.rate, torso + limb
    total = clutter + own @ weight
    others = total[:, None] - weight * own
    count = (state.rate * own / (state.rate * own + others)).sum(axis=0)
    now = (1 + count) * state.rate / (1 + state.rate)
    evidence = np.log1p(now * own / others).sum(axis=0) - now - 0.5 * np.log1p(state.rate)
    close = {"rtol": 1e-9, "atol": 1e-9}
    np.testing.assert_allclose(shares.torso, weight * torso / total[:, None], **close)
    np.testing.assert_allclose(shares.limb, weight * limb / total[:, None], **close)
    np.testing.assert_allclose(shares.limb_density, limb @ weight, **close)
    np.testing.assert_allclose(shares.count, count, **close)
    np.testing.assert_allclose(shares.evidence, evidence, **close)
    np.testing.assert_allclose(shares.support, support, **close)
    np.testing.assert_allclose((shares.torso + shares.limb).sum(axis=1) + clutter / total, 1.0, **close)
    assert min(shares.torso.min(initial=0), shares.limb.min(initial=0)) >= 0


def one_track(existence: float = 0.5, rate: float = 8.0) -> TrackArrays:
    """Somebody 3 m before the sensor who walks away from it."""
    return TrackArrays(np.array([[3.0, 0, 1, 0]]), 0.01 * np.eye(4)[None], np.array([rate]), np.array([existence]))


def evidence(plane: np.ndarray, speed: np.ndarray, state: TrackArrays) -> float:
    """What a cloud says for the one track."""
    return float(Shares(measured_of(plane, speed), np.full(len(plane), 0.1), state, CONFIG).evidence[0])


@pytest.mark.parametrize("speed", [1.0, np.nan], ids=["moving", "no speed"])
def test_evidence_grows_with_points_and_falls_without(speed):
    """Points where the track is, with its speed or none, speak for it, each the more; none, or points elsewhere, against."""
    found = [evidence(np.tile([2.95, 0.0], (n, 1)), np.full(n, speed), one_track()) for n in range(12)]
    assert found[0] < 0 < found[4]
    assert (np.diff(found) > 0).all()
    assert evidence(np.tile([3.0, 2.5], (10, 1)), np.full(10, speed), one_track()) < 0


def test_evidence_knows_speeds():
    """Points that move as the track does say more for it than points that come towards the sensor."""
    place = np.tile([2.95, 0.0], (6, 1))
    assert evidence(place, np.full(6, 1.0), one_track()) > evidence(place, np.full(6, -2.0), one_track())


@often
@given(seed=seeds, n=st.integers(0, 40), alike=st.booleans())
def test_the_greatest_surprise(seed, n, alike):
    """The best heap of all: those about each moving point that is free, by its score; equal heaps: the first."""
    rng = np.random.default_rng(seed)
    measured = some_points(rng, n)
    free, expected = np.ones(n) if alike else rng.uniform(0, 1, n), rng.uniform(0.01, 3, n)
    along, across = np.sqrt(measured.range_variance), np.sqrt(measured.cross_variance)
    best = (-1.0, -1, np.zeros(n, bool))
    for j in range(n):
        if measured.still[j] or free[j] < kernels._FREE:
            continue
        dx, dy = measured.x - measured.x[j], measured.y - measured.y[j]
        deep, wide = kernels._HALF + along[j], kernels._HALF + across[j]
        inside = np.abs(dx * measured.ux[j] + dy * measured.uy[j]) < deep
        inside &= np.abs(dy * measured.ux[j] - dx * measured.uy[j]) < wide
        inside &= ~measured.still & ~(np.abs(measured.speed - measured.speed[j]) > kernels._SAME_SPEED)
        count, usual = free[inside].sum(), 4 * deep * wide * expected[j] * kernels._SAME_SPEED / kernels.FASTEST
        score = count * math.log(count / usual) - count + usual if count > usual else -1.0
        if score > best[0] + 1e-12:
            best = (score, j, inside)
    score, middle, members = densest(measured, free, expected)
    assert score == pytest.approx(best[0], rel=1e-9, abs=1e-9)
    assert middle == best[1]
    np.testing.assert_array_equal(members, best[2])


@often
@given(seed=seeds, m=st.integers(0, 8))
def test_who_hides_whom(seed, m):
    """The angle between two lines of sight, by complex numbers; directions about +-180 degrees are neighbours."""
    rng = np.random.default_rng(seed)
    distance, azimuth, confirmed = rng.uniform(0.1, 6, m), rng.choice([0.0, math.pi], m) + rng.normal(0, 0.2, m), rng.random(m) < 0.7
    azimuth = np.angle(np.exp(1j * azimuth))
    step = np.abs(np.angle(np.exp(1j * (azimuth[:, None] - azimuth[None]))))
    wide = kernels._OCCLUDER / np.maximum(distance, kernels._OCCLUDER) + kernels._BESIDE
    expected = ((step < wide) & (distance[None] < distance[:, None] - kernels._BEHIND) & confirmed & ~np.eye(m, dtype=bool)).any(axis=1)
    np.testing.assert_array_equal(hidden(distance, azimuth, confirmed), expected)


@often
@given(seed=seeds, m=st.integers(0, 8))
def test_who_lies_behind_whom(seed, m):
    """By the definition: behind a likely, stronger track, in its direction, at its echo by the floor, weaker than a body, the least way."""
    rng = np.random.default_rng(seed)
    distance, azimuth, strength = rng.uniform(0.1, 6, m), rng.uniform(-math.pi, math.pi, m), rng.uniform(-5, 40, m)
    likely, ways = rng.random(m) < 0.6, rng.uniform(0, 5, (m, m))
    height, body = rng.uniform(0, 2.5), rng.uniform(0.5, 1.5)
    mirrored = np.hypot(distance, height + body)
    by_floor = np.sqrt(np.maximum((np.hypot(distance, height - body) + mirrored) ** 2 / 4 - (height - body) ** 2, 0))
    far, same, floor, law, least = (np.zeros(m) for _ in range(5))
    for i in range(m):
        causes = [k for k in range(m) if likely[k] and distance[i] > distance[k] + kernels._APART and strength[k] > strength[i]]
        if causes:
            turn = np.array([math.remainder(azimuth[i] - azimuth[k], 2 * math.pi) for k in causes])
            off = ((distance[i] - by_floor[causes]) / kernels._FLOOR_STD) ** 2 + (turn / kernels._FLOOR_TURN) ** 2
            far[i], least[i], same[i] = True, ways[i, causes].min(), (np.abs(turn) < kernels._SAME_DIRECTION).any()
            floor[i] = np.exp(-off / 2).max()
            law[i] = max(strength[k] - strength[i] + 40 * math.log10(max(distance[k], kernels._NEAREST) / distance[i]) for k in causes)
    found = behind(distance, azimuth, strength, likely, ways, height, body)
    for one, other in zip(found, (far, same, floor, law, least), strict=True):
        np.testing.assert_allclose(one, other, atol=1e-12)


@often
@given(seed=seeds, n=st.integers(1, 40), m=st.integers(2, 5))
def test_people_share_points_sharply(seed, n, m):
    """What people have of a point together stays the same, and is divided by powers of their shares; others keep theirs."""
    rng = np.random.default_rng(seed)
    measured, state = some_points(rng, n), some_tracks(rng, m)
    clutter, confirmed = rng.uniform(0.01, 3, n), rng.random(m) < 0.7
    soft = Shares(measured, clutter, state, CONFIG)
    sharp = Shares(measured, clutter, TrackArrays(state.mean, state.covariance, state.rate, state.existence, confirmed), CONFIG)
    before, after = soft.torso + soft.limb, sharp.torso + sharp.limb
    people = before[:, confirmed]
    power = people**kernels._SHARPER
    total = power.sum(axis=1, keepdims=True)
    expected = np.where(total > 0, power / np.maximum(total, 1e-300) * people.sum(axis=1, keepdims=True), people)
    if confirmed.sum() > 1:
        np.testing.assert_allclose(after[:, confirmed], expected, rtol=1e-6, atol=1e-9)
    np.testing.assert_array_equal(after[:, ~confirmed], before[:, ~confirmed])
    np.testing.assert_allclose(after.sum(axis=1), before.sum(axis=1), rtol=1e-9, atol=1e-9)


@often
@given(seed=seeds, n=st.integers(0, 20))
def test_clutter_is_the_mean_of_nine_cells(seed, n):
    """Weights 1, 2, 1 in range and azimuth over what the cells measure; azimuth is a circle, range ends."""
    rng = np.random.default_rng(seed)
    n_range, n_azimuth = 7, 9
    counts, area = rng.uniform(0, 5, (2, 2, n_range, n_azimuth)), rng.uniform(0.02, 0.5, n_range)
    sensor, kind, row, column = (rng.integers(0, top, n) for top in (2, 2, n_range, n_azimuth))
    kernel = np.outer([1.0, 2.0, 1.0], [1.0, 2.0, 1.0])
    expected = []
    for s, k, a, b in zip(sensor, kind, row, column, strict=True):
        cells = [(da, db) for da in (-1, 0, 1) for db in (-1, 0, 1) if 0 <= a + da < n_range]
        found = sum(kernel[da + 1, db + 1] * counts[s, k, a + da, (b + db) % n_azimuth] for da, db in cells)
        expected.append(found / sum(kernel[da + 1, db + 1] * area[a + da] for da, db in cells))
    np.testing.assert_allclose(clutters._smooth(counts, area, sensor, kind, row, column), expected, rtol=1e-9, atol=1e-9)


@often
@given(seed=seeds, n=st.integers(0, 30), people=st.integers(0, 3), dt=st.sampled_from((0.0, 0.02, 5.0, 1e5)))
def test_clutter_is_learned_away_from_people(seed, n, people, dt):
    """Mean counts move towards the cloud's, by dt over the age or the time; cells near people, and their ages, stay as they are."""
    rng = np.random.default_rng(seed)
    shape, time = (6, 8), 8.0
    counts, age = rng.uniform(0, 5, (2, *shape)), rng.uniform(0, 20, shape)
    x, y = rng.uniform(-3, 3, shape), rng.uniform(-3, 3, shape)
    near = np.column_stack([rng.uniform(-3, 3, (people, 2)), rng.uniform(0.1, 3, people)])
    row, column, kind = (rng.integers(0, top, n) for top in (*shape, 2))
    fresh = np.zeros_like(counts)
    np.add.at(fresh, (kind, row, column), 1.0)
    free = (np.hypot(x[..., None] - near[:, 0], y[..., None] - near[:, 1]) >= near[:, 2]).all(axis=-1)
    older = np.where(free, age + dt, age)
    share = np.where(free, np.minimum(dt / np.minimum(older + clutters._FIRST, time), 1.0), 0.0)
    expected = counts + share * (fresh - counts)
    clutters._learn(counts, age, x, y, near, row, column, kind, dt, time)
    np.testing.assert_allclose(counts, expected, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(age, older, rtol=1e-9, atol=1e-9)


@often
@given(seed=seeds, tilt=st.floats(-0.4, 0.1), yaw=st.floats(-3.0, 3.0), height=st.floats(1.0, 2.2))
def test_points_without_elevation_lie_where_they_are(seed, tilt, yaw, height):
    """A radar that measures range and the sine of its cone about its lateral axis, tilted and turned: points at `body_height` come back."""
    rng = np.random.default_rng(seed)
    mount = Pose(x=1.0, y=-2.0, z=height, yaw=yaw, tilt=tilt)
    ahead, aside = rng.uniform(1.0, 6.0, 20), rng.uniform(-1.0, 1.0, 20)
    turn = np.array([[np.cos(yaw), -np.sin(yaw)], [np.sin(yaw), np.cos(yaw)]])
    floor = np.column_stack([ahead, aside]) @ turn.T + [1.0, -2.0]
    seen = mount.from_room(np.column_stack([floor, np.full(20, CONFIG.body_height)]))
    slant = np.linalg.norm(seen, axis=1)
    azimuth = np.arcsin(seen[:, 1] / slant)  # all that a row of antennas measures
    said = np.column_stack([slant * np.cos(azimuth), slant * np.sin(azimuth), np.zeros(20)])
    columns = {"range": slant.astype(np.float32), "azimuth": azimuth.astype(np.float32)}
    cloud = PointCloud(0, 0, "radar", *said.astype(np.float32).T.copy(), **columns).to_room(mount)
    info = RadarInfo(mount=mount)
    measured = Measure(TrackerConfig(), Admission(TrackerConfig(), mount.origin), View(info)).process(cloud)
    np.testing.assert_allclose(np.column_stack([measured.x, measured.y]), floor, atol=1e-3)
    assert np.isnan(measured.height).all()


def echoes_of(place: np.ndarray, wall: np.ndarray, offset: float) -> tuple[np.ndarray, np.ndarray]:
    """Where a radar at the origin sees a body's image, and the echo that takes the wall one way only, shape (2,) each."""
    image = place - 2.0 * (wall @ place - offset) * wall
    whole = np.hypot(*image)
    return image, image / whole * 0.5 * (whole + np.hypot(*place))


@often
@given(seed=seeds)
def test_reflections_by_a_flat_wall_are_explained_and_others_are_not(seed):
    """Of a body that walks by any flat wall: its image, and its echo that takes the wall one way; somebody else who walks is neither."""
    rng = np.random.default_rng(seed)
    angle = rng.uniform(-math.pi, math.pi)
    wall, offset = np.array([math.cos(angle), math.sin(angle)]), rng.uniform(4.0, 7.0)
    place, heading = rng.uniform([1.0, -2.0], [3.0, 2.0]), rng.uniform(-math.pi, math.pi)
    velocity = rng.uniform(0.3, 1.5) * np.array([math.cos(heading), math.sin(heading)])
    step = 1e-5
    before, after = (
        np.array([place + sign * step * velocity, *echoes_of(place + sign * step * velocity, wall, offset)]) for sign in (-1, 1)
    )
    middle, speed = 0.5 * (before + after), (after - before) / (2.0 * step)
    rate = (np.hypot(*after.T) - np.hypot(*before.T)) / (2.0 * step)
    found = kernels.unexplained(*middle.T.copy(), *speed.T.copy(), rate, np.zeros(3))
    assert found[1, 0] == found[2, 0] == 0.0
    assert np.isfinite(found).all()
    rest = np.zeros(2)
    other = np.array([place, [4.0, 0.5]]), np.array([rest, [-1.5, 0.0]])  # somebody walks towards the radar while the body stands
    found = kernels.unexplained(*other[0].T.copy(), *other[1].T.copy(), np.array([0.0, -1.5]), np.zeros(2))
    assert found[1, 0] > 1.0


def test_tracks_at_one_place_and_at_the_sensor_have_reflections_too():
    """Nothing is divided by zero."""
    x, y = np.array([0.0, 2.0, 2.0]), np.array([0.0, 1.0, 1.0])
    assert np.isfinite(kernels.unexplained(x, y, np.ones(3), np.zeros(3), np.ones(3), np.zeros(3))).all()
