"""What every benchmark emits: flat figures, and choices that put accuracy beside time."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable
from typing import Any

import numpy as np

from radar_gestures.classifiers.validation import Validation


def measure(call: Callable[[], Any], *, repeat: int = 50, warmup: int = 3) -> list[float]:
    """Time ``call`` and return milliseconds per run."""
    for _ in range(warmup):
        call()
    times = []
    for _ in range(repeat):
        start = time.perf_counter_ns()
        call()
        times.append((time.perf_counter_ns() - start) * 1e-6)
    return times


def measure_together(calls: dict[str, Callable[[], Any]], *, repeat: int = 50, warmup: int = 3) -> dict[str, list[float]]:
    """Time several calls in turn (A B C, A B C, ...), so that a drifting machine does not favour one of them; milliseconds per run."""
    for call in calls.values():
        for _ in range(warmup):
            call()
    times: dict[str, list[float]] = {name: [] for name in calls}
    for _ in range(repeat):
        for name, call in calls.items():
            start = time.perf_counter_ns()
            call()
            times[name].append((time.perf_counter_ns() - start) * 1e-6)
    return times


def choice(
    stage: str,
    name: str,
    *,
    accuracy: tuple[str, float, str],
    times_ms: list[float],
    reference_ms: list[float] | None = None,
    at: tuple[str, float] | None = None,
) -> dict[str, Any]:
    """One accuracy knob setting: what it achieves and what it costs.

    Parameters
    ----------
    stage : str
        E.g. ``"baseband"``.
    name : str
        The setting, e.g. ``"window=hann"``.
    accuracy : tuple of (str, float, str)
        Name, value and unit of the accuracy figure.
    times_ms : list of float
        Milliseconds of the single runs.
    reference_ms : list of float or None
        Milliseconds of the bare reference in the same run; None: this is the reference.
    at : tuple of (str, float) or None
        Name and value of what is varied beside the choice, e.g. ``("echoes", 100)``: its rows become lines of time over that value.
    """
    label, value, unit = accuracy
    return {
        "stage": stage,
        "choice": name,
        "accuracy": {"name": label, "value": float(value), "unit": unit},
        "time_ms": {"median": float(np.median(times_ms)), "p95": float(np.percentile(times_ms, 95))},
        "ratio": float(np.median(times_ms) / np.median(reference_ms)) if reference_ms else 1.0,
        **({"at": {"name": at[0], "value": at[1]}} if at else {}),
    }


def join(parts: Iterable[dict[str, Any]]) -> dict[str, Any]:
    """Put the results of several benchmarks into one: all figures, and the choices of all in order.

    Raises
    ------
    ValueError
        When two of them have a figure of one name.
    """
    figures: dict[str, Any] = {}
    choices: list[dict[str, Any]] = []
    for part in parts:
        own = {key: value for key, value in part.items() if key != "choices"}
        if twice := sorted(figures.keys() & own.keys()):
            raise ValueError(f"two benchmarks give {', '.join(twice)}; show them apart")
        figures |= own
        choices += part["choices"]
    return figures | {"choices": choices}


def matrix(validation: Validation) -> dict[str, Any]:
    """Give a confusion matrix and the recalls as plain data."""
    recall = {name: float(value) for name, value in zip(validation.labels, validation.recall, strict=True)}
    return {"labels": list(validation.labels), "confusion": validation.confusion.tolist(), "recall": recall}
