"""Every knob of the people tracker, one at a time: accuracy beside time; and the tracker's speed on ten people of thirty points."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from typing import Any, Final

import numpy as np

from benchmarks.report import against_first, timed
from benchmarks.tracking_score import Score, total
from benchmarks.tracking_suite import TRACKERS, Done, changed
from radar_core import PointCloud, RadarInfo
from radar_core.geometry import cartesian_to_spherical
from radar_tracking import TrackerConfig, make_tracker

DEFAULT: Final = "default"
THESIS: Final = "group_clustering"
PRODUCTS: Final = ("tracker", "bodies", "believing in people")
"""Stages whose choices are compared with the product's tracker; those of others with `THESIS`."""
N_PEOPLE, N_POINTS = 10, 30
_FRAME_NS = 20_000_000

KNOBS: Final[Mapping[str, Mapping[str, Sequence[Any]]]] = {
    "tracker": {"tracker": ("group_clustering", "group", "cluster_first")},
    "bodies": {
        "poisson.torso_std": (0.12, 0.25),
        "poisson.limb_std": (0.3, 0.65),
        "poisson.limb_share": (0.15, 0.5),
        "poisson.torso_speed": (0.25, 0.6),
        "poisson.limb_speed": (1.0, 2.5),
        "poisson.angle_std": (0.03, 0.12),
        "poisson.range_std": (0.02, 0.1),
        "poisson.position_std": (0.04, 0.12),
        "poisson.swing_std": (0.06, 0.25),
        "poisson.surface": (0.0, 0.12),
        "poisson.body_height": (0.9, 1.4),
        "poisson.height_std": (0.2, 0.6),
        "poisson.acceleration": (0.6, 2.5),
        "poisson.body_width": (0.25, 0.5),
    },
    "believing in people": {
        "poisson.reach": (0.6, 1.3),
        "poisson.arm_time": (1.5, 6.0),
        "poisson.moved": (0.1, 0.4),
        "poisson.correlation_time": (0.08, 0.3),
        "poisson.leave_time": (0.4, 1.5),
        "poisson.stay_time": (2.0, 8.0),
        "poisson.clutter_density": (0.01, 0.2),
        "poisson.clutter_time": (4.0, 16.0),
    },
    "association": {
        "association.method": ("mahalanobis",),
        "association.gate": (0.6, 1.5),
        "association.largest": ("points",),
        "association.body_radius": (0.2, 0.7),
        "association.arm_depth": (0.15, 100.0),
        "association.arm_speed": (0.2, 100.0),
        "association.reach": (0.0, 0.5),
        "association.torso_depth": (0.0, 0.5),
        "association.torso_echo": (0.5, 8.0),
        "association.arm_length": (0.4, 1.0),
        "association.body_depth": (0.2, 10.0),
        "association.body_width": (0.0, 0.45),
        "association.arm_height": (1.2,),
        "min_distance": (0.0,),
        "min_speed": (0.1,),
    },
    "clustering within the tracker": {
        "association.clustering.name": ("optics", "kmeans", "grid_dbscan", "polar_dbscan"),
        "association.clustering.eps": (0.25, 0.6),
        "association.clustering.min_points": (1, 3),
        "association.clustering.rate_weight": (0.2,),
    },
    "estimator": {
        "filter.estimator.name": ("extended", "unscented", "imm", "mmae", "mm_vel_est"),
        "filter.estimator.motion": ("constant_acceleration", "coordinated_turn"),
        "filter.estimator.process_noise": (0.1, 0.3, 3.0, 10.0),
        "filter.estimator.height_noise": (0.01,),
        "filter.angle_std": (0.01, 0.1),
    },
    "measurement of bodies": {
        "filter.position_std": (0.05, 0.2),
        "filter.pull": (0.25, 1.0, 100.0),
        "filter.surface": (0.0, 0.2),
        "filter.surface_walking": (0.0, 0.12),
        "filter.damping": (0.3, 3.0),
        "filter.initial_speed_std": (0.3, 3.0),
    },
    "track management": {
        "life.birth_points": (2, 5),
        "life.birth_snr": (5.0, 20.0),
        "life.birth_distance": (0.4, 1.2),
        "life.birth_behind": (0.2, 0.8),
        "life.birth_before": (0.8, 1.5),
        "life.birth_together": (0.4, 0.8),
        "life.confirm_after": (0.1, 0.5),
        "life.confirm_matches": (1, 10),
        "life.confirm_points": (0.0, 4.0),
        "life.confirm_speed": (0.05, 0.3),
        "life.confirm_activity": (0.0, 0.6),
        "life.tentative_after": (0.05, 0.3),
        "life.delete_after": (0.5, 2.0),
        "life.delete_static_after": (1.0, 10.0),
        "life.delete_idle_after": (5.0, 1e6),
        "life.walk_distance": (0.4, 1.5),
        "life.left_after": (0.05, 1.0),
        "life.static_speed": (0.1, 0.6),
        "life.pair_distance": (0.0, 0.3, 0.6),
        "life.pair_time": (0.5, 2.0),
        "life.reflection_after": (0.5, 3.0),
        "life.reflection_weaker": (0.0, 4.0),
        "life.reflection_depth": (0.2, 0.6),
        "life.reflection_time": (0.3, 3.0),
        "life.merge_distance": (0.0, 0.5),
        "life.merge_after": (0.3, 3.0),
    },
    "background": {
        "background.enabled": (False,),
        "background.learn_time": (2.0, 15.0),
        "background.share": (0.1, 0.5),
        "background.stronger": (3.0, 20.0),
        "background.body": (0.0, 1.0),
        "background.still_speed": (0.05, 0.2),
        "background.unlearn_time": (0.3, 3.0),
        "background.range_cell": (0.1, 0.3),
        "background.azimuth_cell": (0.03, 0.12),
    },
}
"""Stage to knobs to values other than the default."""
COMBINED: Final[Mapping[str, Mapping[str, Mapping[str, Any]]]] = {
    "tracker": {
        "tracker=cluster_first, split=kmeans": {"tracker": "cluster_first", "association.split": "kmeans"},
        "tracker=cluster_first, split=optics": {"tracker": "cluster_first", "association.split": "optics"},
    },
    "association": {
        "no arms (arm_depth, arm_speed off)": {"association.arm_depth": 100.0, "association.arm_speed": 100.0},
        "method=mahalanobis, gate_sigmas=3": {"association.method": "mahalanobis", "association.gate_sigmas": 3.0},
    },
    "track management": {"reflection_after=3, farther=0": {"life.reflection_after": 3.0, "life.reflection_farther": 0.0}},
    "clustering within the tracker": {
        "name=polar_dbscan, angle_reach=0.2": {"association.clustering.name": "polar_dbscan", "association.clustering.angle_reach": 0.2},
        "name=polar_dbscan, density_exponent=2": {
            "association.clustering.name": "polar_dbscan",
            "association.clustering.density_exponent": 2.0,
        },
        "name=grid_dbscan, angle_reach=0.2": {"association.clustering.name": "grid_dbscan", "association.clustering.angle_reach": 0.2},
    },
    "estimator": {
        "name=imm of extended filters": {"filter.estimator.name": "imm", "filter.estimator.filter": "extended"},
        "name=imm of three modes": {
            "filter.estimator.name": "imm",
            "filter.estimator.modes": ["constant_velocity", "constant_velocity", "coordinated_turn"],
            "filter.estimator.noise_scale": [0.1, 5.0, 1.0],
            "filter.estimator.sojourn": [2.0, 0.5, 1.0],
        },
    },
}
"""Stage to what takes several knobs."""
UNVARIED: Final[Mapping[str, str]] = {
    "association.clustering.max_points": "bounds the time of clouds larger than these",
    "association.clustering.max_eps": "of OPTICS; changes nothing beyond eps",
    "association.clustering.n_clusters": "of k-means, which is not meant for this",
    "association.clustering.max_iterations": "of k-means, which is not meant for this",
    "association.clustering.reference_range": "with density_exponent",
    "association.clustering.min_points_far": "with density_exponent",
    "association.clustering.range_cell": "of the grid; belongs to the radar's resolution",
    "association.clustering.azimuth_cell": "of the grid; belongs to the radar's resolution",
    "association.clustering.rate_cell": "of the grid; belongs to the radar's resolution",
    "filter.estimator.jerk_noise": "with its motion model, whose consistency is tested",
    "filter.estimator.turn_noise": "with its motion model, whose consistency is tested",
    "filter.estimator.acceleration_std": "of a first guess",
    "filter.estimator.turn_std": "of a first guess",
    "filter.estimator.least_weight": "keeps modes alive; numerical",
    "filter.estimator.sigma_spread": "of the unscented filter; numerical",
    "life.max_tracks": "bounds the time of crowds larger than these",
    "zones.boundaries": "says where the room is",
    "zones.entries": "says where the room is",
    "zones.settle": "with entries",
    "zones.walls": "says where the room is",
    "zones.areas": "says where the room is; benchmark zones",
    "zones.counted": "counts only",
    "zones.counted_boxes": "counts only",
    "max_distance": "says where the room is",
}
"""Knobs of the tracker that are not varied, and why."""


def tried() -> Iterator[tuple[str, str, Mapping[str, Any]]]:
    """Stage, name and knobs of everything that is tried."""
    for stage, knobs in KNOBS.items():
        for knob, values in knobs.items():
            for value in values:
                yield stage, f"{knob.split('.')[-1]}={value}", {knob: value}
        for label, several in COMBINED.get(stage, {}).items():
            yield stage, label, several


def variants() -> dict[str, TrackerConfig]:
    """Make configurations by "stage: name"; the first is the default, and what equals it is left out.

    Knobs of the thesis's trackers are tried with `THESIS`.
    """
    default = TrackerConfig()
    own = {f"{stage}: {label}": changed(_basis(stage) | dict(knobs)) for stage, label, knobs in tried()}
    return {DEFAULT: default, **{label: config for label, config in own.items() if config != default}}


def _basis(stage: str) -> dict[str, Any]:
    """Knobs of the configuration that the choices of a stage are compared with."""
    return {} if stage in PRODUCTS else {"tracker": THESIS}


def _reference(stage: str) -> str:
    return DEFAULT if stage in PRODUCTS else f"tracker: tracker={THESIS}"


def rows(done: Sequence[Done]) -> list[dict[str, Any]]:
    """One row per choice, pooled over the scenes in which choices ran: GOSPA beside the time per cloud."""
    with_choices = [d for d in done if d.choices]
    if not with_choices:
        return []
    scores = {label: total([d.choices[label] for d in with_choices]) for label in with_choices[0].choices}
    stages = dict.fromkeys(label.split(": ", 1)[0] for label in scores if label != DEFAULT)
    found = []
    for stage in stages:
        usual = _reference(stage)
        own = {DEFAULT: scores[usual]} if usual in scores else {}
        own |= {label.removeprefix(f"{stage}: "): one for label, one in scores.items() if label.startswith(f"{stage}: ")}
        found += against_first(
            stage, "mean GOSPA", {titled(label, one): (one.mean_gospa, one.times.tolist()) for label, one in own.items()}, "m"
        )
    return found


def titled(label: str, score: Score) -> str:
    """Name of a row, with the figures beside its own."""
    return f"{label}, MOTA {score.mota:.3f}, {score.switches:.0f} switches"


def crowd(n_clouds: int, seed: int = 1) -> list[PointCloud]:
    """Clouds of ten people who walk in circles at 0.6 m/s, thirty points each, without a simulator."""
    rng = np.random.default_rng(seed)
    info = RadarInfo()
    centre = np.array([(x, y) for x, n in ((1.8, 2), (3.2, 3), (4.6, 5)) for y in 1.4 * (np.arange(n) - (n - 1) / 2)])
    clouds = []
    for k in range(n_clouds):
        angle = 2.0 * k * _FRAME_NS * 1e-9
        body = np.column_stack([centre + 0.3 * np.array([math.cos(angle), math.sin(angle)]), np.full(N_PEOPLE, 1.0)])
        motion = 0.6 * np.array([-math.sin(angle), math.cos(angle), 0.0])
        place = (body[:, None] + rng.normal(0, (0.08, 0.12, 0.3), (N_PEOPLE, N_POINTS, 3))).reshape(-1, 3)
        distance, azimuth, elevation = cartesian_to_spherical(info.mount.from_room(place))
        away = place - info.mount.origin
        rate = away @ motion / np.linalg.norm(away, axis=-1) + rng.normal(0, 0.2, len(place))
        arrays: dict[str, Any] = {
            "x": place[:, 0],
            "y": place[:, 1],
            "z": place[:, 2],
            "range": distance,
            "azimuth": azimuth,
            "elevation": elevation,
        }
        arrays |= {"radial_speed": rate, "snr": rng.uniform(12, 25, len(place))}
        clouds.append(PointCloud(k * _FRAME_NS, k, "room", **{name: value.astype(np.float32) for name, value in arrays.items()}))
    return clouds


def speed(quick: bool) -> dict[str, Any]:
    """Time the whole step of each tracker on `crowd`, in turn; ``step_ms_10_tracks_300_points`` is the product's, and ``choices``."""
    clouds = crowd(40 if quick else 500)
    trackers = {name: make_tracker(config, RadarInfo()) for name, config in TRACKERS.items()}
    times: dict[str, list[float]] = {name: [] for name in trackers}
    followed = dict.fromkeys(trackers, 0)
    for k, cloud in enumerate(clouds):
        for name, tracker in trackers.items():
            tracks, spent = timed(tracker.process, cloud)
            if k >= len(clouds) // 4:  # everybody is confirmed
                times[name].append(spent)
                followed[name] += tracks.people_count
    rows = against_first("10 people, 300 points", "tracks", {f"tracker={name}": (followed[name] / len(t), t) for name, t in times.items()})
    return {"step_ms_10_tracks_300_points": rows[0]["time_ms"]["median"], "choices": rows}
