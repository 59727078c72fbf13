"""Clustering: agreement with the true owners of points, beside the time of a cloud."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
from sklearn.cluster import DBSCAN

from benchmarks.clustering_parts import CENTRES, EPS, MAX_EPS, MIN_POINTS, agreement, people
from benchmarks.report import Found, Panel, measure_together
from benchmarks.tradeoff.config import StudyConfig
from radar_tracking import AssociationConfig
from radar_tracking.clustering import ClusteringConfig, make_clustering, seen_from

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
        name: make_clustering(ClusteringConfig(name=name, eps=EPS, min_points=MIN_POINTS, max_eps=MAX_EPS, n_clusters=len(CENTRES)))
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
