"""People tracking with anything that can arrive: clouds of every kind, steps of every length, every tracker, every estimator."""

import copy
import pickle
from dataclasses import dataclass, replace

import numpy as np
import pytest
from hypothesis import HealthCheck, Phase, given, settings
from hypothesis import strategies as st

from radar_core import DataError, PointCloud, Pose, merge
from radar_core.config import load
from radar_tracking import PeopleTracker, TrackerConfig, Tracks, TrackStatus
from radar_tracking.estimators.config import ESTIMATORS, FILTERS, MOTIONS

TRACKERS = ("group_clustering", "group", "cluster_first")
TOP = float(np.finfo(np.float32).max)
MOUNTS = (Pose(), Pose(x=6.0, yaw=np.pi))
SECOND = 1_000_000_000
FIELDS = {
    "dt_ns": (20_000_000, 0, 1, 1000, 100_000_000, 10 * SECOND, 10**8 * SECOND, -1, -20_000_000, -10 * SECOND),
    "n": (60, 0, 1, 2, 3, 8, 20, 300, 2000),
    "place": ("people", "uniform", "same", "line", "origin", "behind", "grid", "far", "nan"),
    "level": ("usual", "none", "some", "low", "high", "mixed"),
    "speed": ("usual", "zero", "none", "some", "top", "fast"),
    "height": ("usual", "none", "some", "top", "same"),
    "angle_std": (np.nan, 0.0, 0.03, 1e-30, -1.0, TOP),
    "composite": (False, True),
}


@dataclass(frozen=True)
class Step:
    """One cloud: how long after the one before, of what kind; everything random in it comes from `seed`."""

    dt_ns: int = 20_000_000
    n: int = 60
    place: str = "people"
    level: str = "usual"
    speed: str = "usual"
    height: str = "usual"
    angle_std: float = np.nan
    composite: bool = False
    seed: int = 0


changes = st.sampled_from([(name, value) for name, values in FIELDS.items() for value in values])


def walk_of(stretches: list[tuple[tuple[str, object], int]]) -> list[Step]:
    """Steps of stretches: each changes one thing about the clouds and lasts for some clouds, so that tracks live to see it."""
    step, walk = Step(), [Step(seed=k) for k in range(3)]
    for (name, value), n in stretches:
        step = replace(step, **{name: value})
        walk += [replace(step, seed=len(walk) + k) for k in range(n)]
    return walk


walks = st.lists(st.tuples(changes, st.integers(1, 6)), max_size=10).map(walk_of)


def places(step: Step, rng: np.random.Generator) -> np.ndarray:
    """Positions on the floor plane, shape (n, 2)."""
    n = step.n
    if step.place == "uniform":
        return rng.uniform(-8, 8, (n, 2))
    if step.place == "same":
        return np.tile([3.0, 0.5], (n, 1))
    if step.place == "line":
        return np.column_stack([np.full(n, 3.0), np.linspace(-2, 2, n)])
    if step.place == "origin":
        return np.zeros((n, 2)) + rng.choice([0.0, 1e-30, 0.3], (n, 1))
    if step.place == "behind":
        return rng.normal(0, 0.2, (n, 2)) - [3.0, 0.0]
    if step.place == "grid":
        return np.round(rng.uniform(-5, 5, (n, 2)))
    if step.place == "far":
        return rng.choice([-TOP, TOP, 100.0, -100.0, 3.0], (n, 2))
    if step.place == "nan":
        return np.where(rng.random((n, 2)) < 0.3, np.nan, rng.normal([3.0, 0.5], 0.2, (n, 2)))
    bodies = np.array([[3.0, 0.5], [3.0, -0.3], [2.0, 0.0], [-2.0, 0.0], [0.1, 0.1]])
    return bodies[rng.integers(0, len(bodies), n)] + rng.normal(0, 0.15, (n, 2))


def values(kind: str, n: int, rng: np.random.Generator, usual: np.ndarray) -> np.ndarray:
    """One field of a cloud, shape (n,)."""
    table = {
        "none": np.full(n, np.nan),
        "some": np.where(rng.random(n) < 0.5, np.nan, usual),
        "zero": np.zeros(n),
        "same": np.ones(n),
        "fast": 1000 * usual,
        "low": np.full(n, -TOP),
        "high": np.full(n, TOP),
        "top": rng.choice([-TOP, TOP], n),
        "mixed": rng.choice([-TOP, -30.0, 15.0, TOP], n),
    }
    return table.get(kind, usual)


def cloud_of(step: Step, stamp_ns: int) -> PointCloud:
    """The cloud of a step: one, or half of the points seen by a second sensor."""
    rng, n = np.random.default_rng(step.seed), step.n
    plane = places(step, rng)
    arrays = {
        "x": plane[:, 0],
        "y": plane[:, 1],
        "z": values(step.height, n, rng, rng.normal(1, 0.3, n)),
        "snr": values(step.level, n, rng, rng.uniform(8, 30, n)),
        "radial_speed": values(step.speed, n, rng, rng.normal(0, 0.5, n)),
        "azimuth_std": np.full(n, step.angle_std),
    }
    cloud = PointCloud(stamp_ns, 0, "room", **{name: value.astype(np.float32) for name, value in arrays.items()})
    if not step.composite:
        return cloud
    half = n // 2
    return merge([cloud.select(np.arange(half)), cloud.select(np.arange(half, n))], MOUNTS)


def refuse_sick(tracks: Tracks, cloud: PointCloud, config: TrackerConfig, born: int) -> int:
    """Assert what holds of every result; returns the newest id."""
    ids = [track.id for track in tracks.tracks]
    assert len(ids) <= config.life.max_tracks
    assert ids == sorted(set(ids)), "in order, each once"
    gone = {track.id for track in tracks.deleted}
    assert not gone & set(ids)
    assert (tracks.stamp_ns, len(tracks.point_track_id)) == (cloud.stamp_ns, len(cloud))
    assert set(tracks.point_track_id.tolist()) <= {-1, *ids}
    for track in tracks.tracks:
        assert np.isfinite(track.position).all()
        assert np.isfinite(track.velocity).all()
        P = track.covariance
        assert np.isfinite(P).all()
        assert np.array_equal(P, P.T)
        scale = 1 / np.sqrt(np.diagonal(P))  # metres and metres per second may differ by many orders of magnitude
        assert np.linalg.eigvalsh(P * scale[:, None] * scale).min() > 0
        assert not (track.extent < 0).any()  # NaN: unknown
        assert 0 <= track.unseen <= track.age
        assert track.n_points == np.count_nonzero(tracks.point_track_id == track.id)
        assert (track.dof > 0) == (not np.isnan(track.nis))
        assert track.dof == 0 or track.nis >= 0
        assert track.dof == 0 or track.status != TrackStatus.COASTING
    new = [number for number in ids if number > born]
    assert all(track.age == 0 for track in tracks.tracks if track.id in new), "old ids do not come back"
    return max([born, *ids, *gone])


def numbers(tracks: Tracks) -> list[bytes]:
    """What a result says, as bytes."""
    parts = [tracks.point_track_id.tobytes()]
    for track in tracks.tracks:
        parts += [array.tobytes() for array in (track.position, track.velocity, track.covariance, track.extent)]
        parts.append(repr((track.id, track.status, track.age, track.unseen, track.n_points, track.nis, track.dof)).encode())
    return parts


def go(config: TrackerConfig, walk: list[Step]) -> None:
    """Feed a tracker with clouds of every kind; clouds from before are refused and change nothing."""
    tracker, now, born = PeopleTracker(config), None, 0
    for step in walk:
        cloud = cloud_of(step, max((now or 0) + step.dt_ns, 0))
        if now is None or cloud.stamp_ns >= now:
            now = cloud.stamp_ns
            born = refuse_sick(tracker.process(cloud), cloud, config, born)
            continue
        twin = copy.deepcopy(tracker)
        with pytest.raises(DataError, match="older"):
            tracker.process(cloud)
        assert tracker.dropped_points == twin.dropped_points
        again = cloud_of(step, now)
        assert numbers(copy.deepcopy(tracker).process(again)) == numbers(twin.process(again))


# The same examples in every run; what they are is in their seeds, so that shrinking to smaller numbers would say little.
calm = settings(
    max_examples=7,
    deadline=None,
    derandomize=True,
    phases=(Phase.explicit, Phase.generate),
    suppress_health_check=list(HealthCheck),
)


@pytest.mark.parametrize("estimator", ESTIMATORS)
@pytest.mark.parametrize("tracker", TRACKERS)
@calm
@given(walks)
def test_any_clouds_for_every_tracker_and_estimator(tracker, estimator, walk):
    """No exception, no warning, no NaN, covariances symmetric and positive definite, tracks bounded, ids new, the past refused."""
    go(load(TrackerConfig, {"tracker": tracker, "filter": {"estimator": {"name": estimator}}, "life": {"max_tracks": 20}}), walk)


CLUSTERINGS = ("dbscan", "optics", "kmeans", "grid_dbscan", "polar_dbscan")
configs = st.fixed_dictionaries(
    {
        "tracker": st.sampled_from(TRACKERS),
        "association": st.fixed_dictionaries(
            {
                "method": st.sampled_from(("euclidean", "mahalanobis")),
                "largest": st.sampled_from(("body", "points")),
                "split": st.sampled_from(("none", "kmeans", "optics")),
                "clustering": st.fixed_dictionaries(
                    {
                        "name": st.sampled_from(CLUSTERINGS),
                        "eps": st.sampled_from((0.01, 0.4, 2.0)),
                        "min_points": st.sampled_from((1, 2, 5)),
                        "max_points": st.sampled_from((10, 2000)),
                        "rate_weight": st.sampled_from((0.0, 0.5, 100.0)),
                    }
                ),
            }
        ),
        "filter": st.fixed_dictionaries(
            {
                "estimator": st.fixed_dictionaries(
                    {
                        "name": st.sampled_from(ESTIMATORS),
                        "motion": st.sampled_from(MOTIONS),
                        "filter": st.sampled_from(FILTERS),
                        "modes": st.tuples(st.sampled_from(MOTIONS), st.sampled_from(MOTIONS)),
                    }
                )
            }
        ),
        "life": st.fixed_dictionaries({"max_tracks": st.sampled_from((1, 20)), "merge_distance": st.sampled_from((0.0, 0.3, 1.0))}),
        "background": st.fixed_dictionaries({"enabled": st.booleans()}),
        "zones": st.sampled_from(({}, {"boundaries": (0, 5, -3, 3)}, {"entries": (0, 5, -3, 3), "settle": 0})),
        "min_distance": st.sampled_from((0.0, 0.3)),
    }
)


@pytest.mark.long
@settings(calm, max_examples=40)
@given(configs, walks)
def test_any_clouds_for_any_settings(knobs, walk):
    """The same with every other choice that a tracker offers: gates, clusterings, splits, motions, zones."""
    go(load(TrackerConfig, knobs), walk)


def small_cloud(k: int, step_ns: int, start_ns: int = 0) -> PointCloud:
    """Three points of somebody who circles 3 m before the radar and, of every five seconds, is hidden for the last two."""
    n = 0 if (k * step_ns // SECOND) % 5 >= 3 else 3
    t = k * step_ns / SECOND
    rng = np.random.default_rng(k)
    place = np.array([3 + np.sin(t), np.cos(t), 1.0]) + rng.normal(0, 0.1, (n, 3))
    x, y, z = place.astype(np.float32).T
    speed, snr = (np.full(n, value, np.float32) for value in (0.5, 15.0))
    return PointCloud(start_ns + k * step_ns, k, "room", x, y, z, radial_speed=speed, snr=snr)


@pytest.mark.long
@pytest.mark.parametrize(
    ("estimator", "n"), [("linear", 1500), ("imm", 1000), ("mm_vel_est", 1000), pytest.param("linear", 200_000, marks=pytest.mark.slow)]
)
def test_endurance(estimator, n):
    """A thousand clouds and more in which somebody comes and goes: healthy to the end, nothing grows, ids rise."""
    given = {"tracker": "group_clustering", "filter": {"estimator": {"name": estimator}}, "life": {"static_speed": 0.0}}
    config = load(TrackerConfig, given)
    tracker, ids, size = PeopleTracker(config), [], 0
    for k in range(n):
        cloud = small_cloud(k, 20_000_000)
        tracks = tracker.process(cloud)
        assert len(tracks.tracks) <= 4  # the range rates contradict the way: tracks may be lost, new ones begin before those end
        ids += [track.id for track in tracks.tracks if track.age == 0]
        if k % 50 == 0:
            refuse_sick(tracks, cloud, config, ids[-1])
        if k in (n // 2, n - 1):
            size, before = len(numbers_of(tracker)), size
    assert ids == sorted(set(ids))
    assert len(ids) >= n // 250 - 1, "somebody new every five seconds"
    assert size <= before + 1000, "after all clouds a tracker remembers no more than after half of them, but for a track"


def numbers_of(tracker: PeopleTracker) -> bytes:
    """Everything a tracker remembers."""
    return pickle.dumps(tracker)


@pytest.mark.parametrize("start_ns", [0, 2**31 * SECOND, 2**62, 2**63 - 1 - 100 * 20_000_000])
def test_stamps_up_to_the_last(start_ns):
    """The same clouds later give the same tracks, up to the largest stamp that 64 bits hold: durations are whole nanoseconds."""
    early, late = PeopleTracker(), PeopleTracker()
    for k in range(100):
        a, b = early.process(small_cloud(k, 20_000_000)), late.process(small_cloud(k, 20_000_000, start_ns))
        assert numbers(a) == numbers(b), k
    assert a.people_count == 1


@pytest.mark.long
def test_ten_thousand_births_have_ten_thousand_ids():
    """Fifty new people with every fourth cloud, half a second of nothing between: no id comes twice, and the list stays bounded."""
    rng = np.random.default_rng(1)
    corners = np.stack(np.meshgrid(np.arange(1, 11), np.arange(-2, 3), indexing="ij"), axis=-1).reshape(-1, 1, 2)
    tracker, ids, gone = PeopleTracker(), [], 0
    for k in range(400):
        plane = (corners + rng.normal(0, 0.05, (50, 3, 2))).reshape(-1, 2)[: 0 if k % 2 else None]
        n = len(plane)
        x, y = plane.astype(np.float32).T
        cloud = PointCloud(k * SECOND // 2, k, "room", x, y, np.ones(n, np.float32), radial_speed=np.full(n, 1, np.float32))
        tracks = tracker.process(cloud)
        ids += [track.id for track in tracks.tracks]
        gone += len(tracks.deleted)
        assert len(tracks.tracks) == (0 if k % 2 else 50)
    assert ids == list(range(1, 10_001))
    assert gone == 10_000
