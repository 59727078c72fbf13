"""A synthetic data set: what one sample of one stroke costs on one core and on disk, and so how long the thesis's 600 take on two.

Samples are timed one after the other in one process, one of each of the thesis's ten animations, with everything that a worker does for
them: scene, body, echoes, baseband, tracking, events, features, file.
"""

from __future__ import annotations

import tempfile
from pathlib import Path

import numpy as np
from threadpoolctl import threadpool_limits

from benchmarks.report import timed
from radar_core import RadarInfo
from radar_gestures.stage import GestureConfig
from radar_lab.datasets.readings import read
from radar_lab.datasets.samples import read_sample
from radar_lab.datasets.synthesis import Job, write_sample
from radar_lab.datasets.synthesis_plan import PLANS

N_SAMPLES, N_CORES = 600, 2
BODIES = ("mesh", "ellipsoids")


def times(body: str, n: int, seed: int = 1) -> dict[str, list[float]]:
    """Seconds to make, to load and to read again each of the first ``n`` samples, and the bytes of its file."""
    taken: dict[str, list[float]] = {"make": [], "load": [], "read": [], "bytes": []}
    with tempfile.TemporaryDirectory() as folder, threadpool_limits(1):
        job = Job(Path(folder), seed, PLANS["thesis"], body, False, False, GestureConfig(), RadarInfo())
        write_sample(job, n)  # compiles and designs what a worker prepares once
        for number in range(n):
            made = timed(write_sample, job, number)[1]
            sample, loaded = timed(read_sample, job.path(number))
            for name, value in (("make", made), ("load", loaded), ("read", timed(read, sample)[1])):
                taken[name].append(1e-3 * value)
            taken["bytes"].append(job.path(number).stat().st_size)
    return taken


def measure(n: int = 10) -> dict[str, float]:
    """Seconds a sample takes with either body on one core, minutes of 600 mesh samples on two, and what a file takes."""
    taken = {body: times(body, n) for body in BODIES}
    mesh = taken["mesh"]
    return {
        **{f"seconds_per_sample_{body}": float(np.mean(value["make"])) for body, value in taken.items()},
        "minutes_for_600_on_two_cores": N_SAMPLES * float(np.mean(mesh["make"])) / N_CORES / 60,
        "sample_bytes": float(np.mean(mesh["bytes"])),
        "sample_load_ms": 1e3 * float(np.median(mesh["load"])),
        "sample_read_again_ms": 1e3 * float(np.median(mesh["read"])),
    }
