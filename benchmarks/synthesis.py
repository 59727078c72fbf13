"""A synthetic data set: what one sample of one stroke costs on one core, and so how long the thesis's 600 take on two.

Samples are timed one after the other in one process, one of each of the thesis's ten animations, with everything that a worker does for
them: scene, body, echoes, baseband, tracking, events, features, file.
"""

from __future__ import annotations

import tempfile
import time
from pathlib import Path

import numpy as np
from threadpoolctl import threadpool_limits

from radar_core import RadarInfo
from radar_gestures.recognizer import GestureConfig
from radar_gestures.synthesis import Job, write_sample
from radar_gestures.synthesis_plan import Plan

N_SAMPLES, N_CORES = 600, 2
BODIES = ("mesh", "ellipsoids")


def times(body: str, n: int, seed: int = 1) -> list[float]:
    """Seconds of each of the first ``n`` samples."""
    seconds = []
    with tempfile.TemporaryDirectory() as folder, threadpool_limits(1):
        job = Job(Path(folder), seed, Plan(), body, False, GestureConfig(), RadarInfo())
        write_sample(job, n)  # compiles and designs what a worker prepares once
        for number in range(n):
            start = time.perf_counter()
            write_sample(job, number)
            seconds.append(time.perf_counter() - start)
    return seconds


def measure(n: int = 10) -> dict[str, float]:
    """Seconds a sample takes with either body on one core, and minutes of 600 mesh samples on two.

    Parameters
    ----------
    n : int
        Samples of each body.
    """
    mean = {body: float(np.mean(times(body, n))) for body in BODIES}
    return {
        **{f"seconds_per_sample_{body}": value for body, value in mean.items()},
        "minutes_for_600_on_two_cores": N_SAMPLES * mean["mesh"] / N_CORES / 60,
    }
