"""Clustering on its own: every method at 20 to 500 points, beside scikit-learn's; the parts of a larger benchmark."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
from sklearn.cluster import DBSCAN

from benchmarks.report import Found, Panel, against_first, measure_together
from benchmarks.tradeoff.stages import StudyConfig
from radar_tracking import AssociationConfig
from radar_tracking.clustering import Clustering, ClusteringConfig, cluster, kmeans, optics, seen_from, split

SIZES = (20, 50, 200, 500)
EPS, MIN_POINTS, MAX_EPS = 0.3, 3, 2.0
CENTRES = np.array([[2.0, 0.0], [3.3, 0.0], [2.0, 1.5]])  # three people, 1.3 to 2 m apart
SCATTER = (0.10, 0.14)  # m: depth and width of a body's points
STRAY = 0.1  # share of points that are nobody's
Points = np.ndarray[Any, np.dtype[np.float64]]
Call = Callable[[], Any]


def people(n: int, rng: np.random.Generator | None = None) -> tuple[Points, Points]:
    """Points of three people with clutter around them, shape (n, 2) [m], and who each point is of; -1: nobody. None: drawn from ``n``."""
    rng = rng or np.random.default_rng(n)
    owner = rng.integers(0, len(CENTRES), n)
    points = CENTRES[owner] + rng.normal(0, SCATTER, (n, 2))
    stray = rng.random(n) < STRAY
    points[stray] = rng.uniform((1.0, -2.0), (5.0, 3.0), (np.count_nonzero(stray), 2))
    return points, np.where(stray, -1, owner)


def same(labels: Points, expected: Points) -> float:
    """Share of equal labels."""
    return float(np.mean(labels == expected))


def agreement(labels: np.ndarray[Any, Any], owner: Points) -> float:
    """Compute the adjusted Rand index over the points that are somebody's; 1: everybody one cluster of their own."""
    from sklearn.metrics import adjusted_rand_score

    own = owner >= 0
    return float(adjusted_rand_score(owner[own], labels[own]))


def against_sklearn(n: int, repeat: int) -> tuple[list[dict[str, Any]], float]:
    """DBSCAN, OPTICS and k-means beside scikit-learn's; accuracy: share of equal labels. Also the ratio of DBSCAN."""
    from sklearn.cluster import DBSCAN, OPTICS, KMeans

    points, _ = people(n)
    start = CENTRES + 0.2
    pairs: dict[str, tuple[Call, Call, int]] = {
        "dbscan": (
            lambda: DBSCAN(eps=EPS, min_samples=MIN_POINTS).fit_predict(points),
            lambda: cluster(points, EPS, MIN_POINTS, 2000),
            repeat,
        ),
        "optics": (
            lambda: OPTICS(min_samples=MIN_POINTS, max_eps=MAX_EPS, cluster_method="dbscan", eps=EPS).fit_predict(points),
            lambda: optics(points, MIN_POINTS, MAX_EPS).labels(EPS),
            min(repeat, 5),  # scikit-learn's takes up to a quarter of a second
        ),
        "kmeans": (
            lambda: KMeans(len(start), init=start, n_init=1, tol=0, algorithm="lloyd").fit_predict(points),
            lambda: kmeans(points, start, 300)[0],
            repeat,
        ),
    }
    rows = []
    for name, (theirs, ours, times) in pairs.items():
        measured = measure_together({"sklearn": theirs, "ours": ours}, repeat=times, warmup=min(times - 1, 3))
        found = {f"{name}: sklearn n={n}": (1.0, measured["sklearn"]), f"{name}: ours n={n}": (same(ours(), theirs()), measured["ours"])}
        rows += against_first("clustering", "labels equal", found)
    return rows, rows[1]["ratio"]


def by_name(n: int, repeat: int) -> list[dict[str, Any]]:
    """Every method as the trackers call it, and the two that split a cluster: adjusted Rand index; ratio to scikit-learn's DBSCAN."""
    from sklearn.cluster import DBSCAN

    points, owner = people(n)
    seen = seen_from(points, np.zeros(2))
    calls: dict[str, Call] = {"sklearn dbscan": lambda: DBSCAN(eps=EPS, min_samples=MIN_POINTS).fit_predict(points)}
    for name in ("dbscan", "optics", "kmeans", "grid_dbscan", "polar_dbscan"):
        made = Clustering(ClusteringConfig(name=name, eps=EPS, min_points=MIN_POINTS, max_eps=MAX_EPS, n_clusters=len(CENTRES)))
        calls[f"name={name}"] = partial(made.labels, seen)
    calls["split by optics"] = lambda: split(points, len(CENTRES), CENTRES + 0.2)[0]
    calls["split by kmeans"] = lambda: kmeans(points, CENTRES + 0.2)[0]
    times = measure_together(calls, repeat=repeat, warmup=min(repeat - 1, 3))
    found = {f"{name} n={n}": (agreement(call(), owner), times[name]) for name, call in calls.items()}
    return against_first("clustering", "adjusted Rand index", found)


def figures(quick: bool) -> dict[str, Any]:
    """``choices``, and ``dbscan_over_sklearn_n20``, ``_n50``, ``_n200``, ``_n500``: time over scikit-learn's, of equal labels."""
    result: dict[str, Any] = {}
    rows: list[dict[str, Any]] = []
    repeat = 1 if quick else 100
    for n in SIZES:
        compared, ratio = against_sklearn(n, repeat)
        result[f"dbscan_over_sklearn_n{n}"] = ratio
        rows += compared + by_name(n, repeat)
    return {**result, "choices": rows}


N_POINTS = 100
PANEL = Panel(
    "clustering", "adjusted Rand index", "", "higher", AssociationConfig().clustering.name, f"scikit-learn's DBSCAN of {N_POINTS} points"
)


def measure(study: StudyConfig) -> Found:
    """Compare the clusterings on clouds of three people with a tenth of stray points."""
    rng = np.random.default_rng([study.seed, 11])
    clouds = [people(N_POINTS, rng) for _ in range(study.pick(40, 400))]
    points = clouds[0][0]
    methods = {
        name: Clustering(ClusteringConfig(name=name, eps=EPS, min_points=MIN_POINTS, max_eps=MAX_EPS, n_clusters=len(CENTRES)))
        for name in ("dbscan", "optics", "kmeans", "grid_dbscan", "polar_dbscan")
    }
    seen = seen_from(points, np.zeros(2))
    calls: dict[str, Callable[[], Any]] = {"": lambda: DBSCAN(eps=EPS, min_samples=MIN_POINTS).fit_predict(points)}
    calls |= {name: partial(made.labels, seen) for name, made in methods.items()}
    times = measure_together(calls, repeat=study.pick(20, 300))
    found = Found()
    for name, made in methods.items():
        values = [agreement(made.labels(seen_from(cloud, np.zeros(2))), owner) for cloud, owner in clouds]
        margin = 2 * float(np.std(values)) / len(values) ** 0.5
        found.rows.append(PANEL.row(name, float(np.mean(values)), times[name], times[""], margin=margin))
    return found
