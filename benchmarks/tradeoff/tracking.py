"""Trackers and estimators of people: GOSPA on simulated scenes, beside the time of a cloud."""

from __future__ import annotations

from benchmarks.report import Found, Panel
from benchmarks.tradeoff.config import StudyConfig
from benchmarks.tradeoff.people import rows, track
from radar_core.config import load, nest
from radar_tracking import TrackerConfig

_REFERENCE = "the baseband's time of the same frames"
TRACKER = Panel("tracker", "mean GOSPA", "m", "lower", "group_clustering", _REFERENCE)
ESTIMATOR = Panel("estimator", "mean GOSPA", "m", "lower", "linear", _REFERENCE)
WITHIN = Panel("clustering within the tracker", "mean GOSPA", "m", "lower", "dbscan", _REFERENCE)

KNOBS: dict[Panel, dict[str, dict[str, str]]] = {
    TRACKER: {
        "group_clustering": {},
        "group": {"tracker": "group"},
        "cluster_first": {"tracker": "cluster_first"},
        "cluster_first, split=kmeans": {"tracker": "cluster_first", "association.split": "kmeans"},
    },
    ESTIMATOR: {
        name: {"filter.estimator.name": name} for name in ("linear", "extended", "unscented", "imm", "mmae", "mm_vel_est")
    },
    WITHIN: {
        name: {"association.clustering.name": name} for name in ("dbscan", "optics", "kmeans", "grid_dbscan", "polar_dbscan")
    },
}  # fmt: skip


def measure(study: StudyConfig) -> Found:
    """Compare trackers, estimators and clusterings within the tracker on the same clouds."""
    configs = {f"{panel.name}: {name}": load(TrackerConfig, nest(knobs)) for panel, own in KNOBS.items() for name, knobs in own.items()}
    judges, _, baseband = track(configs, study)
    return Found([row for panel, own in KNOBS.items() for row in rows(panel, {n: judges[f"{panel.name}: {n}"] for n in own}, baseband)])
