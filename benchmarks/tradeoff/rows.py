"""One row per choice: what it achieves and what it takes. Benchmarks and `handwave tradeoff` share these."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

Row = dict[str, Any]
"""As `choice` makes it: plain data, ready for JSON."""


def measure(call: Callable[[], Any], *, repeat: int = 50, warmup: int = 3) -> list[float]:
    """Time ``call`` and return milliseconds per run."""
    return measure_together({"": call}, repeat=repeat, warmup=warmup)[""]


def measure_together(calls: Mapping[str, Callable[[], Any]], *, repeat: int = 50, warmup: int = 3) -> dict[str, list[float]]:
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
    times_ms: Sequence[float],
    reference_ms: Sequence[float] | None = None,
    at: tuple[str, float] | None = None,
    **more: Any,
) -> Row:
    """One accuracy knob setting: what it achieves and what it costs.

    Parameters
    ----------
    stage : str
        E.g. ``"baseband"``.
    name : str
        The setting, e.g. ``"window=hann"``.
    accuracy : tuple of (str, float, str)
        Name, value and unit of the accuracy figure.
    times_ms : sequence of float
        Milliseconds of the single runs.
    reference_ms : sequence of float or None
        Milliseconds of the bare reference in the same run; None: this is the reference.
    at : tuple of (str, float) or None
        Name and value of what is varied beside the choice, e.g. ``("echoes", 100)``: its rows become lines of time over that value.
    **more
        Further entries of the row, e.g. ``default=True``; see `Panel`.
    """
    label, value, unit = accuracy
    return {
        "stage": stage,
        "choice": name,
        "accuracy": {"name": label, "value": float(value), "unit": unit},
        "time_ms": {"median": float(np.median(times_ms)), "p95": float(np.percentile(times_ms, 95))},
        "ratio": float(np.median(times_ms) / np.median(reference_ms)) if reference_ms else 1.0,
        **({"at": {"name": at[0], "value": at[1]}} if at else {}),
        **more,
    }


@dataclass(frozen=True)
class Panel:
    """Choices of one knob that are compared with each other: one figure of accuracy, one reference.

    Attributes
    ----------
    name : str
        Of the knob; no other panel has it.
    figure : str
        What accuracy means here.
    unit : str
        Its unit.
    better : str
        ``lower`` or ``higher``.
    default : str
        Name of the choice that is the product's default.
    reference : str
        What the times are compared with; need not be a choice.
    """

    name: str
    figure: str
    unit: str
    better: str
    default: str
    reference: str

    def row(
        self, name: str, value: float, times_ms: Sequence[float], reference_ms: Sequence[float], *, margin: float = 0.0, **more: Any
    ) -> Row:
        """Make the row of one choice.

        Parameters
        ----------
        name : str
            Of the choice.
        value : float
            Its accuracy.
        times_ms, reference_ms : sequence of float
            Of the choice and of the bare reference, in the same run [ms].
        margin : float
            Differences of the accuracy below this are chance (about two standard errors).
        **more
            Further entries, e.g. ``parts``.
        """
        return choice(
            self.name, name, accuracy=(self.figure, value, self.unit), times_ms=times_ms, reference_ms=reference_ms, better=self.better,
            default=name == self.default, reference=self.reference, margin=float(margin), **more,
        )  # fmt: skip


@dataclass
class Found:
    """What a stage measured: rows, and choices that could not be measured here with the reasons."""

    rows: list[Row] = field(default_factory=list)
    left_out: list[dict[str, str]] = field(default_factory=list)

    def leave_out(self, panel: str, name: str, why: str) -> None:
        """Note a choice that is not measured."""
        self.left_out.append({"stage": panel, "choice": name, "why": why})


def of_share(share: float, n: int) -> float:
    """Two standard errors of a share of ``n`` trials; at 0 and 1 the rule of three (3 / n)."""
    return 2 * (share * (1 - share) / n) ** 0.5 if 0 < share < 1 else 3.0 / n


def of_rms(value: float, n: int) -> float:
    """Two standard errors of a root mean square of ``n`` normal errors."""
    return float(2 * value / (2 * n) ** 0.5)


def scaled(rows: Sequence[Row], factor: float) -> list[Row]:
    """Multiply all times by a factor; ratios stay."""
    result = []
    for row in rows:
        times = {name: value * factor for name, value in row["time_ms"].items()}
        parts = {"parts": {name: value * factor for name, value in row["parts"].items()}} if "parts" in row else {}
        result.append({**row, "time_ms": times, **parts})
    return result
