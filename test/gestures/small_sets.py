"""A data set small enough for tests: a radar with few samples, bodies of ellipsoids, short gestures."""

from __future__ import annotations

import math
from pathlib import Path

from radar_core import RadarInfo, Waveform
from radar_gestures.synthesis import synthesise
from radar_gestures.synthesis_plan import Plan

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
