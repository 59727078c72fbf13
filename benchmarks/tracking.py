"""People and hand tracking on simulated scenes with truth: accuracy and identity switches beside the time per cloud."""

from __future__ import annotations

import dataclasses
import time
from typing import Any

import numpy as np
from scipy.optimize import linear_sum_assignment

from benchmarks.report import choice, measure_together
from radar_core import ConfigError, PointCloud
from radar_dsp import Baseband, BasebandConfig
from radar_sim import Simulator, Truth, load_scene
from radar_tracking import HandTracker, PeopleTracker, TrackedCloud, TrackerConfig, Tracks, TrackStatus, dbscan

Scene = list[tuple[PointCloud, Truth]]
RADIUS = 0.7  # m: a person is tracked while a track is this near on the floor plane


def scene(name: str, quick: bool) -> Scene:
    """Clouds in the room with the truth of their moments; quick: five seconds in which people gesture."""
    simulator = Simulator(load_scene(name))
    baseband = Baseband(BasebandConfig(), simulator.info)
    frames = range(simulator.n_frames)[300:550] if quick else range(simulator.n_frames)
    made = (simulator.process(k) for k in frames)
    return [(baseband.process(m.frame).to_room(simulator.info.mount), m.truth) for m in made]


def follow(clouds: Scene, config: TrackerConfig) -> tuple[list[Tracks], list[float]]:
    """Run a tracker; results and milliseconds per cloud."""
    tracker, results, times = PeopleTracker(config), [], []
    for cloud, _ in clouds:
        start = time.perf_counter_ns()
        results.append(tracker.process(cloud))
        times.append((time.perf_counter_ns() - start) * 1e-6)
    return results, times


def score(clouds: Scene, results: list[Tracks]) -> dict[str, float]:
    """Tracked fraction of the person followed worst, identity switches, position rms, share of clouds with a false track (CLEAR-MOT)."""
    last: dict[int, int] = {}
    n_people = max(len(truth.person_id) for _, truth in clouds)
    seen, errors, switches, false = np.zeros(n_people), [], 0, 0
    for (_, truth), tracks in zip(clouds, results, strict=True):
        people = [t for t in tracks.tracks if t.status is not TrackStatus.TENTATIVE]
        place = np.array([t.position[:2] for t in people]).reshape(-1, 2)
        distance = np.hypot(*np.moveaxis(place[None] - truth.position[:, None, :2], -1, 0))
        cost = np.where(distance < RADIUS, distance, 1e6)
        for row, identity in last.items():
            for column, track in enumerate(people):
                if track.id == identity and distance[row, column] < RADIUS:
                    cost[row, column] = -1.0
        pairs = [(r, c) for r, c in zip(*linear_sum_assignment(cost), strict=True) if cost[r, c] < 1e6]
        for row, column in pairs:
            switches += last.get(row, people[column].id) != people[column].id
            last[row] = people[column].id
            seen[row] += 1
            errors.append(distance[row, column])
        false += len(people) > len(pairs)
    rms = float(np.sqrt(np.mean(np.square(errors)))) if errors else float(RADIUS)
    return {"tracked": float(seen.min() / len(clouds)), "switches": switches, "rms": rms, "false": false / len(clouds)}


def hand(clouds: Scene, results: list[Tracks]) -> dict[str, float]:
    """Follow the first hand that draws, started by the truth; rms and share of the drawing in which it was active."""
    tracker, person, errors, drawing = HandTracker(), None, [], 0
    for (cloud, truth), tracks in zip(clouds, results, strict=True):
        draws = np.flatnonzero(truth.drawing)
        if person is None and len(draws) and tracks.people_count:
            person = int(draws[0])
            people = [t for t in tracks.tracks if t.status is not TrackStatus.TENTATIVE]
            nearest = min(people, key=lambda t: float(np.hypot(*(t.position - truth.position[person])[:2])))
            tracker.start(nearest.id, cloud.stamp_ns)
        found = tracker.process(TrackedCloud(cloud, tracks))
        if person is not None and truth.drawing[person]:
            drawing += 1
            if found is not None and found.active:
                errors.append(float(((found.position - truth.hand_position[person]) ** 2).sum()))
    if not errors:
        return {}
    return {"hand_rms_m": float(np.sqrt(np.mean(errors))), "hand_active": len(errors) / drawing}


def variants() -> dict[str, TrackerConfig]:
    """Name what can be chosen, one knob at a time; the first is the default."""
    base = TrackerConfig()

    def change(part: str, **knobs: Any) -> TrackerConfig:
        return dataclasses.replace(base, **{part: dataclasses.replace(getattr(base, part), **knobs)})

    return {
        "default": base,
        "gate=mahalanobis": change("association", method="mahalanobis"),
        "gate=0.6": change("association", gate=0.6),
        "gate=1.5": change("association", gate=1.5),
        "eps=0.25": change("association", eps=0.25),
        "eps=0.6": change("association", eps=0.6),
        "min_points=1": change("association", min_points=1),
        "process_noise=0.1": change("filter", process_noise=0.1),
        "process_noise=3": change("filter", process_noise=3.0),
        "no arms (torso weights off)": change("association", arm_depth=100.0, arm_speed=100.0),
    }


def clustering(quick: bool) -> list[dict[str, Any]]:
    """DBSCAN of ours against scikit-learn's: share of equal labels, and time."""
    from sklearn.cluster import DBSCAN

    rows = []
    for n in (20, 50, 200, 500):
        rng = np.random.default_rng(n)
        points = rng.normal(0, 0.2, (n, 2)) + np.array([[0, 0], [1.3, 0], [0, 1.5]])[rng.integers(0, 3, n)]
        reference = DBSCAN(eps=0.3, min_samples=3)
        calls = {"sklearn": lambda p=points, r=reference: r.fit_predict(p), "ours": lambda p=points: dbscan(p, 0.3, 3)}
        times = measure_together(calls, repeat=10 if quick else 100)
        equal = float(np.mean(calls["ours"]() == calls["sklearn"]()))
        rows.append(choice("clustering", f"sklearn n={n}", accuracy=("labels equal", 1.0, ""), times_ms=times["sklearn"]))
        row = choice(
            "clustering", f"ours n={n}", accuracy=("labels equal", equal, ""), times_ms=times["ours"], reference_ms=times["sklearn"]
        )
        rows.append(row)
    return rows


def run(quick: bool) -> dict[str, Any]:
    """Measure; flat keys are those of the default configuration."""
    result: dict[str, Any] = {}
    rows: list[dict[str, Any]] = []
    for name in ("demo",) if quick else ("demo", "two_crossing"):
        try:
            clouds = scene(name, quick)
        except ConfigError:
            continue  # a scene that this installation does not have
        reference = None
        for label, config in variants().items():
            tracks, times = follow(clouds, config)
            found = score(clouds, tracks)
            if label == "default":
                reference = times
                result |= {f"{name}_{key}": value for key, value in found.items()} | hand(clouds, tracks)
                result[f"{name}_ms"] = float(np.median(times))
            accuracy = ("position rms", found["rms"], "m")
            title = f"{name}: {label}, {found['switches']:.0f} switches, {found['tracked']:.3f} tracked"
            rows.append(choice("tracking", title, accuracy=accuracy, times_ms=times, reference_ms=reference))
    return {**result, "choices": rows + clustering(quick)}
