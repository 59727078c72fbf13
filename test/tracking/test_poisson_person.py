"""Persons by how they look: features are what their definition says, and tell a walker from what creeps."""

import math

import numpy as np
import pytest

from radar_core import PointCloud, Pose, RadarInfo
from radar_tracking import TrackerConfig
from radar_tracking.poisson.person import FEATURES, features, person_odds
from radar_tracking.poisson.table import N_STATES, RECORD, Table
from radar_tracking.poisson.tracker import PoissonTracker


def followed(place, speed, seconds: float = 8.0) -> Table:
    """The table after clouds of 8 points each 50 ms about ``place(t)``, shape (3,), with range rates ``speed(t, rng)``, shape (8,)."""
    tracker, rng = PoissonTracker(TrackerConfig(tracker="poisson_bernoulli")), np.random.default_rng(3)
    for k in range(round(seconds / 0.05)):
        t = 0.05 * k
        points = place(t) + rng.normal(0, [0.08, 0.08, 0.15], (8, 3))
        columns = {"radial_speed": speed(t, rng).astype(np.float32), "snr": np.full(8, 15.0, np.float32)}
        tracker.process(PointCloud(k * 50_000_000, k, "room", *points.astype(np.float32).T.copy(), **columns))
    return tracker.table


@pytest.mark.parametrize(
    ("law", "way", "near", "suspect", "lively"),
    [
        (30.0, 0.6, 0.5, 1.0, 0.0), (3.0, 0.15, 0.5, 0.5, 0.05), (0.0, 0.15, 0.5, 0.0, 0.2), (0.0, 0.15, 2.0, 1.0, 0.4),
        (-12.0, 0.6, 0.5, 0.0, 1.0),
    ],
)  # fmt: skip
def test_features_are_their_definition(law, way, near, suspect, lively):
    """One track of 4 points at 12 dB, of which one is fast, 1 m high on average and 0.6 m tall, 1.5 m from its birthplace.

    Near to another, what speaks for an image counts by halves where it is 3 dB weaker than a body, and not at all where it is as strong.
    """
    table, row = Table(), np.zeros(1, RECORD)
    row["look"] = [4.0, 48.0, 1.0, 4.0, 4.0, 4.0 * (1.0 + 0.36)]
    row["behind"], row["same"], row["floor"], row["law"], row["alone"] = True, True, 0.3, law, way
    row["hits"], row["moved"], row["birthplace"], row["haunt"] = 0.5, 4.0, (1.5, 0.0), (3.0, 0.0)
    row["drift"], row["sight"] = -1.9, (1.0, 0.0)
    row["series"][0, :, 1], row["series"][0, :, 2], row["watched"] = 2.0, (1.8, 1.0, 0.5, 1.9), 2.0
    row["stands"], row["lively"] = True, lively
    table.add(row, np.array([3.0, 0, 0, 0, 0, 0, 0]), np.eye(N_STATES))
    table.add(np.zeros(1, RECORD), np.array([3.0, near, 0, 0, 0, 0, 0]), np.eye(N_STATES))
    alone = math.log(way / 0.3) * (suspect if way < 0.3 else 1.0)
    expected = {
        "points": math.log(4.1), "snr": 12.0, "height": 0.0, "tall": 0.1, "fast": 0.2, "behind": suspect, "same": suspect,
        "floor": 0.3 * suspect, "law": min(max(law, -10.0), 20.0), "alone": alone, "hits": 0.0, "went": 1.5, "stuck": 1.5,
        "creep": 1.1,
        **dict(zip(("rests", "range", "azimuth", "power"), (1.0, 0.9, 0.5, 0.25) if lively < 0.1 else (0.0,) * 4, strict=True)),
        **dict(zip(("stirs", "rate"), (1.0, 0.5) if lively > 0.3 else (0.0, 0.0), strict=True)),
    }  # fmt: skip
    assert dict(zip(FEATURES, features(table)[0].tolist(), strict=True)) == pytest.approx(expected)


def test_what_creeps_on_the_floor_looks_less_like_a_person():
    """Of the same points and strength: somebody who walks to and fro is clearly a person, a thing on the floor by at least 2 nat less."""
    walker = followed(lambda t: np.array([3.0 - np.cos(t), 0.0, 1.0]), lambda t, rng: np.sin(t) + rng.normal(0, 0.2, 8))
    creeps = followed(lambda t: np.array([2.0 + 0.3 * t, 0.0, 0.05]), lambda t, rng: 0.3 + rng.normal(0, 0.02, 8))
    assert walker.rows["confirmed"].sum() == 1
    assert person_odds(walker)[0] > 2.0
    assert person_odds(creeps).max() < person_odds(walker)[0] - 2.0
    assert features(walker)[0][FEATURES.index("stuck")] == 0.0


def test_blades_of_a_fan_go_nowhere():
    """Points that come at 1.3 m/s for three seconds and stay where they are: less of a person, by 3 nat, than one who walks at 0.9 m/s."""
    fan = followed(lambda t: np.array([3.0, 0.0, 1.0]), lambda t, rng: 1.3 + rng.normal(0, 0.3, 8), 3.0)
    walker = followed(lambda t: np.array([1.5 + 0.9 * t, 0.0, 1.0]), lambda t, rng: 0.9 + rng.normal(0, 0.3, 8), 4.0)
    assert person_odds(fan).max() < person_odds(walker)[0] - 3.0
    assert walker.rows["confirmed"].sum() == 1
    assert features(walker)[walker.rows["confirmed"]][0][FEATURES.index("creep")] == 0.0


def test_without_heights_a_strong_echo_is_suspect_too():
    """A track close behind a stronger one, as strong as a body: without heights it loses what it would lose by being weaker."""
    table, row = Table(), np.zeros(1, RECORD)
    row["look"] = [4.0, 48.0, 0.0, 0.0, 0.0, 0.0]
    row["behind"], row["same"], row["floor"], row["alone"] = True, True, 0.9, 0.15
    for _ in range(2):
        table.add(row, np.zeros(N_STATES), np.eye(N_STATES))
    found = dict(zip(FEATURES, features(table)[0].tolist(), strict=True))
    assert [found[name] for name in ("behind", "same", "floor", "alone")] == pytest.approx([1.0, 1.0, 0.9, -math.log(2.0)])


@pytest.mark.parametrize(("weaker", "people"), [(0.0, 2), (14.0, 1)])
def test_who_walks_behind_somebody_is_a_person_and_an_echo_is_not(weaker, people):
    """Two pace to and fro, one half a metre behind the other all the time; as strong as a body there, or 14 dB weaker."""
    tracker, rng, counts = PoissonTracker(TrackerConfig(tracker="poisson_bernoulli")), np.random.default_rng(6), []
    errors = {"range_std": np.full(16, 0.02, np.float32), "azimuth_std": np.full(16, 0.01, np.float32)}
    for k in range(200):
        y, rate = 1.2 * math.sin(0.04 * k), 0.96 * math.cos(0.04 * k)
        points = np.array([[2.0, y, 1.0]] * 10 + [[2.5, y, 1.0]] * 6) + rng.normal(0, [0.05, 0.08, 0.15], (16, 3))
        speed = rate * points[:, 1] / np.hypot(*points[:, :2].T) + rng.normal(0, 0.15, 16)
        snr = np.repeat([25.0, 25.0 - 40.0 * math.log10(2.5 / 2.0) - weaker], [10, 6])
        columns = {"radial_speed": speed.astype(np.float32), "snr": snr.astype(np.float32), **errors}
        tracker.process(PointCloud(k * 50_000_000, k, "room", *points.astype(np.float32).T.copy(), **columns))
        counts.append(int(tracker.table.rows["confirmed"].sum()))
    assert np.mean(np.array(counts[80:]) == people) > 0.95  # four seconds: fewer points are a limb for the first three


def in_turns(k: int, first: int) -> tuple[float, float]:
    """Way [m] and speed [m/s] after ``k`` steps of 50 ms of who walks a metre away and back, in every other two seconds."""
    turn, phase = divmod(0.05 * k, 2.0)
    walks, away = int(turn) % 2 == first, int(turn - first) // 2 % 2 == 0
    way = 0.5 * (1.0 - math.cos(math.pi * phase / 2.0)) if walks else 1.0
    speed = 0.25 * math.pi * math.sin(math.pi * phase / 2.0) if walks else 0.0
    return (way, speed) if away else (1.0 - way, -speed)


def test_ways_that_tell_people_from_reflections():
    """Two people walk in turns, one behind the other; a copy does what the first does, weaker: it is never alone."""
    tracker, rng = PoissonTracker(TrackerConfig(tracker="poisson_bernoulli")), np.random.default_rng(4)
    for k in range(40, 440):
        (near, fast), (far, slow) = in_turns(k, 0), in_turns(k, 1)
        places = [[2.0 + near, -1.5, 1.0]] * 8 + [[4.0 + far, 1.5, 1.0]] * 6 + [[4.5 + near, -3.0, 1.0]] * 4
        points = (np.array(places) + rng.normal(0, [0.08, 0.08, 0.15], (18, 3))).astype(np.float32)
        speed = np.repeat([fast, slow, fast], [8, 6, 4]) + rng.normal(0, 0.02, 18)
        snr = np.repeat(np.float32([25.0, 15.0, 10.0]), [8, 6, 4])
        columns = {"radial_speed": speed.astype(np.float32), "snr": snr}
        tracker.process(PointCloud(k * 50_000_000, k, "room", *points.T.copy(), **columns))
    table = tracker.table
    rows = {
        name: table.rows[np.hypot(*(table.mean[:, :2] - place).T) < 0.7] for name, place in (("person", (4.5, 1.5)), ("copy", (5.0, -3.0)))
    }
    assert len(rows["person"]) == len(rows["copy"]) == 1
    person, copy = rows["person"][0], rows["copy"][0]
    assert person["behind"]
    assert copy["behind"]
    assert person["alone"] > 3.0
    assert copy["alone"] < 0.5
    assert copy["law"] > person["law"] + 3.0


@pytest.mark.parametrize(("snr", "people"), [(35.0, 1), (4.0, 0), (math.nan, 1)])
def test_what_is_faint_before_the_sensor_is_nobody(snr, people):
    """Somebody 0.4 m away echoes strongly; interference there does not. Where no strength is measured it does not count."""
    tracker = PoissonTracker(TrackerConfig(tracker="poisson_bernoulli"), RadarInfo(mount=Pose(z=1.1)))
    rng = np.random.default_rng(7)
    for k in range(80):
        t = 0.05 * k
        points = (np.array([0.4 + 0.1 * np.sin(2 * t), 0.0, 1.1]) + rng.normal(0, [0.04, 0.04, 0.1], (8, 3))).astype(np.float32)
        columns = {"radial_speed": (0.2 * np.cos(2 * t) + rng.normal(0, 0.2, 8)).astype(np.float32), "snr": np.full(8, snr, np.float32)}
        tracks = tracker.process(PointCloud(k * 50_000_000, k, "room", *points.T.copy(), **columns))
    assert len(tracks.people) == people


def test_who_is_no_person_any_more_is_tentative_and_keeps_its_points():
    """A walker whose odds of being a person are taken away is not ended: it is not shown until they come back, under the same id."""
    tracker, rng = PoissonTracker(TrackerConfig(tracker="poisson_bernoulli")), np.random.default_rng(5)
    seen: list[tuple[bool, int]] = []
    for k in range(160):
        t = 0.05 * k
        points = (np.array([3.0 - np.cos(t), 0.0, 1.0]) + rng.normal(0, [0.08, 0.08, 0.15], (8, 3))).astype(np.float32)
        columns = {"radial_speed": (np.sin(t) + rng.normal(0, 0.2, 8)).astype(np.float32), "snr": np.full(8, 15.0, np.float32)}
        if k == 80:
            tracker.table.rows["person"] = -4.0
        tracks = tracker.process(PointCloud(k * 50_000_000, k, "room", *points.T.copy(), **columns))
        assert not tracks.deleted
        seen.append((bool(tracker.table.rows["confirmed"][0]), int(tracker.table.rows["id"][0])))
    assert seen[79][0]
    assert not seen[80][0]
    assert seen[-1] == (True, seen[79][1])
