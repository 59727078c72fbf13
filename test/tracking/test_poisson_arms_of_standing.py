"""Who stands and moves an arm stays where the body is; who sets off is followed; who stands beside somebody else is somebody."""

import numpy as np
import pytest

from radar_core import PointCloud
from radar_tracking import TrackerConfig, TrackStatus
from radar_tracking.poisson.tracker import PoissonTracker

DT = 0.05  # s


def cloud(k: int, points: np.ndarray, speed: np.ndarray, rng: np.random.Generator) -> PointCloud:
    """Points, shape (n, 3) [m], blurred by a few centimetres, with range rates, shape (n,) [m/s]."""
    place = (points + rng.normal(0.0, [0.04, 0.08, 0.12], points.shape)).astype(np.float32)
    columns = {"radial_speed": speed.astype(np.float32), "snr": np.full(len(points), 25.0, np.float32)}
    return PointCloud(round(k * DT * 1e9), k, "room", *place.T.copy(), **columns)


def body(x: float, y: float, n: int, speed: float, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """So many points of a body, and their range rates."""
    return np.tile([x, y, 1.0], (n, 1)), speed + rng.normal(0.0, 0.12, n)


def after(seconds: float, then: str) -> tuple[PoissonTracker, np.ndarray]:
    """Somebody comes, stands at 2.5 m, and either pulls an arm to and fro or walks away; gives how far the person is from the truth [m]."""
    tracker, rng, errors = PoissonTracker(TrackerConfig(tracker="poisson_bernoulli")), np.random.default_rng(4), []
    for k in range(round(seconds / DT)):
        t = k * DT
        x = 2.5 if t > 1.5 else 4.0 - t
        parts = [body(x, 0.0, 8 if t < 6.0 else k % 2, -1.0 if t < 1.5 else 0.0, rng)]
        if t >= 6.0 and then == "pull":
            phase = 2.0 * np.pi * (t - 6.0) / 1.2
            hand = 2.5 - 0.35 - 0.25 * np.sin(phase)
            parts.append((np.tile([hand, 0.0, 1.1], (9, 1)), -0.25 * 2.0 * np.pi / 1.2 * np.cos(phase) + rng.normal(0.0, 0.1, 9)))
        if t >= 6.0 and then == "walk":
            x = 2.5 + 1.0 * (t - 6.0)
            parts = [body(x, 0.0, 8, 1.0, rng)]
        points, speed = (np.concatenate(columns) for columns in zip(*parts, strict=True))
        people = tracker.process(cloud(k, points, speed, rng)).people
        if t >= 6.5:
            errors.append(min((float(np.hypot(*(one.position[:2] - [x, 0.0]))) for one in people), default=np.inf))
    return tracker, np.array(errors)


def test_an_arm_does_not_draw_its_person_away():
    """Nine points of a hand, and one of the body in every other cloud: the person stays within 0.35 m of the body nearly all the time."""
    tracker, errors = after(12.0, "pull")
    assert tracker.table.rows["confirmed"].sum() == 1
    assert np.quantile(errors, 0.9) < 0.35


def test_who_sets_off_is_followed():
    """Somebody who stood walks off at 1 m/s: after half a second the person is where the body is, and nobody stays behind."""
    tracker, errors = after(8.5, "walk")
    assert tracker.table.rows["confirmed"].sum() == 1
    assert errors.max() < 0.4
    assert np.median(errors) < 0.2


@pytest.mark.parametrize(("points", "least", "most"), [(8, 2.5, 5.0), (5, 5.0, 8.0)])
def test_who_appears_beside_who_stands_waits_for_the_time_of_an_arm(points, least, most):
    """Beside somebody with nine points, 0.8 m aside: with nearly as many one is somebody after 3 s, with half as many after twice that."""
    tracker, rng, found = PoissonTracker(TrackerConfig(tracker="poisson_bernoulli")), np.random.default_rng(5), np.inf
    for k in range(round(13.0 / DT)):
        t = k * DT
        parts = [body(2.5, 0.0, 9, 0.3 * np.sin(2.0 * np.pi * t / 1.5), rng)]
        if t > 4.0:
            parts.append(body(2.5, 0.8, points, 0.3 * np.sin(2.0 * np.pi * t / 1.1), rng))
        both, speed = (np.concatenate(columns) for columns in zip(*parts, strict=True))
        if len(tracker.process(cloud(k, both, speed, rng)).people) > 1:
            found = min(found, t - 4.0)
    assert least < found < most


@pytest.mark.parametrize(("before", "people"), [(0.5, 1), (0.9, 2)])
def test_nobody_appears_right_before_who_stands(before, people):
    """Eight points that move to and fro for nine seconds: half a metre before somebody who stands an arm's, 0.9 m before a second one's."""
    tracker, rng = PoissonTracker(TrackerConfig(tracker="poisson_bernoulli")), np.random.default_rng(5)
    for k in range(round(13.0 / DT)):
        t = k * DT
        parts = [body(2.5, 0.0, 9, 0.3 * np.sin(2.0 * np.pi * t / 1.5), rng)]
        if t > 4.0:
            parts.append(body(2.5 - before, 0.0, 8, 0.6 * np.sin(2.0 * np.pi * t / 1.1), rng))
        both, speed = (np.concatenate(columns) for columns in zip(*parts, strict=True))
        found = tracker.process(cloud(k, both, speed, rng))
    assert len(found.people) == people


def test_who_waits_keeps_the_points():
    """The same with eight points: from a second and a half on they are no arm's, though nobody is confirmed there yet."""
    tracker, rng = PoissonTracker(TrackerConfig(tracker="poisson_bernoulli")), np.random.default_rng(5)
    for k in range(round(6.5 / DT)):
        t = k * DT
        parts = [body(2.5, 0.0, 9, 0.3 * np.sin(2.0 * np.pi * t / 1.5), rng)]
        if t > 4.0:
            parts.append(body(2.5, 0.8, 8, 0.3 * np.sin(2.0 * np.pi * t / 1.1), rng))
        both, speed = (np.concatenate(columns) for columns in zip(*parts, strict=True))
        found = tracker.process(cloud(k, both, speed, rng))
    (first,) = found.people
    (other,) = (track for track in found.tracks if np.hypot(*(track.position[:2] - [2.5, 0.8])) < 0.3)
    assert other.status is TrackStatus.TENTATIVE
    own = both[:, 1] < 0.4
    assert (found.point_track_id[own] == first.id).mean() > 0.8
    assert (found.point_track_id[~own] == other.id).mean() > 0.8
