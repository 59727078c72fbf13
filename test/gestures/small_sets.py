"""A data set small enough for tests: a radar with few samples, bodies of ellipsoids, short gestures."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np

from radar_core import PointCloud, RadarInfo, Waveform
from radar_gestures.features import FEATURE_NAMES
from radar_lab.datasets.samples import SampleSet
from radar_lab.datasets.synthesis import synthesise
from radar_lab.datasets.synthesis_plan import Plan

INFO = RadarInfo(waveform=Waveform(n_sample=32, bandwidth=0.75e9, frame_interval=0.04))
"""Half the samples over half the bandwidth and half the frames of the default radar: as far, and as fast, at a quarter of the work."""
PLAN = Plan(gestures=("push", "pull"), sides=(0.0,), turn=0.0, spread=math.radians(2.0))


def make(folder: str | Path, n_samples: int, n_jobs: int | None = 1, seed: int = 3, **more: object) -> int:
    """Make, or go on with, a small data set."""
    given = {"plan": PLAN, "info": INFO, "body": "ellipsoids", "progress": False} | more
    return synthesise(folder, n_samples, seed=seed, n_jobs=n_jobs, **given)


def contents(folder: Path) -> dict[str, bytes]:
    """Every file's bytes by name."""
    return {path.name: path.read_bytes() for path in sorted(folder.iterdir())}


def stroke_clouds(speed: float = -1.5, start: float = 0.6, length: float = 0.5, end: float = 1.8, step: float = 0.02) -> list[PointCloud]:
    """Clouds of somebody 2 m away, in the sensor frame: a body of twelve points that rests, and an arm of three that moves at ``speed``.

    The arm moves from ``start`` for ``length`` seconds; stamps begin at 1 s.
    """
    rng, clouds = np.random.default_rng(5), []
    for k in range(round(end / step)):
        moves = start <= k * step < start + length
        n = 15 if moves else 12
        way = np.r_[np.full(12, 2.0), np.full(n - 12, 1.7)] + 0.05 * rng.standard_normal(n)
        azimuth, elevation = 0.05 * rng.standard_normal((2, n))
        direction = np.stack([np.cos(elevation) * np.cos(azimuth), np.cos(elevation) * np.sin(azimuth), np.sin(elevation)])
        rate = np.r_[0.02 * rng.standard_normal(12), np.full(n - 12, speed) + 0.2 * np.arange(n - 12)]
        columns = {
            **dict(zip("xyz", way * direction, strict=True)),
            "range": way,
            "azimuth": azimuth,
            "elevation": elevation,
            "radial_speed": rate,
            "snr": np.full(n, 25.0),
            "azimuth_std": np.full(n, 0.01),
        }
        clouds.append(PointCloud(10**9 + round(k * step * 1e9), k, "radar", **{name: a.astype(np.float32) for name, a in columns.items()}))
    return clouds


def random_set(n: int, labels: tuple[int, ...], shift: float = 0.0, seed: int = 0, spread: float = 3.0) -> SampleSet:
    """Gaussian features, ``n`` a label, with means ``spread`` apart, all shifted; the means depend on the label alone."""
    means = np.random.default_rng(9).standard_normal((10, len(FEATURE_NAMES))) * spread
    rng = np.random.default_rng(seed)
    label = np.repeat(np.array(labels, np.int64), n)
    features = means[label] + rng.standard_normal((len(label), len(FEATURE_NAMES))) + shift
    return SampleSet(features, label, rng.integers(10, size=len(label)), np.zeros(len(label)), np.zeros(10, np.int64), {})
