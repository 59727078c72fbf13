"""What every benchmark emits: flat figures, and choices that put accuracy beside time."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from benchmarks.tradeoff.rows import choice, measure, measure_together
from radar_lab.training.validation import Validation

__all__ = ["choice", "join", "matrix", "measure", "measure_together"]


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
