"""What every benchmark and every study gives: flat figures, and rows that put the accuracy of a choice beside its time."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, TypeVar

import numpy as np
from numpy.typing import NDArray

from radar_core import DataError
from radar_core.config import load, nest

if TYPE_CHECKING:
    from radar_lab.training.validation import Validation

T = TypeVar("T")
Row = dict[str, Any]  # as `choice` makes it: plain data, ready for JSON


class AbsentError(DataError):
    """Something that a benchmark needs is not on this machine: recordings, a checkout, a library. The message says what to do."""


def checkout(*parts: str) -> Path:
    """Path of a file or folder of the checkout that this package stands in; raise AbsentError when there is none."""
    path = Path(__file__).resolve().parents[1].joinpath(*parts)
    if not path.exists():
        raise AbsentError(f"{path}: not there; this needs a checkout of the project, start it from there")
    return path


def timed(call: Callable[..., T], *arguments: Any) -> tuple[T, float]:
    """Call something once; returns its result and the milliseconds that it took."""
    start = time.perf_counter_ns()
    result = call(*arguments)
    return result, (time.perf_counter_ns() - start) * 1e-6


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
            times[name].append(timed(call)[1])
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
    """One accuracy knob setting: what it achieves (name, value and unit) and what it costs (milliseconds of single runs).

    ``reference_ms``: of the bare reference in the same run; None: this is the reference. ``at``: name and value of what is varied beside
    the choice, e.g. ``("echoes", 100)``: its rows become lines of time over that value. ``more``: further entries of the row, see `Panel`.
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


def choices(
    stage: str, figure: tuple[str, str], values: Mapping[str, float], times_ms: Mapping[str, Sequence[float]], reference: str, **more: Any
) -> list[Row]:
    """Rows of choices measured together: name and unit of their figure, values, times, and which of the times are the reference."""
    beside = times_ms[reference]
    return [
        choice(stage, name, accuracy=(figure[0], value, figure[1]), times_ms=times_ms[name], reference_ms=beside, **more)
        for name, value in values.items()
    ]


def against_first(stage: str, figure: str, found: Mapping[str, tuple[float, Sequence[float]]], unit: str = "") -> list[Row]:
    """Rows of values and times [ms] by name of the setting, see `choices`; the first is the reference."""
    values, times_ms = {name: value for name, (value, _) in found.items()}, {name: times for name, (_, times) in found.items()}
    return choices(stage, (figure, unit), values, times_ms, next(iter(found))) if found else []


@dataclass(frozen=True)
class Panel:
    """Choices of one knob that are compared with each other: one figure of accuracy, one reference."""

    name: str  # of the knob; no other panel has it
    # figure, unit: what accuracy means here, and its unit
    figure: str
    unit: str
    better: Literal["lower", "higher"]  # whether a ``lower`` or a ``higher`` figure is better
    default: str  # name of the choice that is the product's default
    reference: str  # what the times are compared with; need not be a choice

    def row(
        self, name: str, value: float, times_ms: Sequence[float], reference_ms: Sequence[float], *, margin: float = 0.0, **more: Any
    ) -> Row:
        """Make the row of one choice, see `choice`; ``margin``: differences of the accuracy below this are chance (two standard errors)."""
        return choice(
            self.name, name, accuracy=(self.figure, value, self.unit), times_ms=times_ms, reference_ms=reference_ms, better=self.better,
            default=name == self.default, reference=self.reference, margin=float(margin), **more,
        )  # fmt: skip

    def rows(
        self, values: Mapping[str, float], times_ms: Mapping[str, Sequence[float]], margin: Callable[[float], float] = lambda value: 0.0
    ) -> list[Row]:
        """Make rows of choices that were measured together with the bare reference, whose times are those of ``""``."""
        return [self.row(name, value, times_ms[name], times_ms[""], margin=margin(value)) for name, value in values.items()]


@dataclass
class Found:
    """What a study measured: rows, and choices that could not be measured here with the reasons."""

    rows: list[Row] = field(default_factory=list)
    left_out: list[dict[str, str]] = field(default_factory=list)

    def leave_out(self, panel: str, name: str, why: str) -> None:
        """Note a choice that is not measured."""
        self.left_out.append({"stage": panel, "choice": name, "why": why})

    def __add__(self, other: Found) -> Found:
        """Put two together, in order."""
        return Found(self.rows + other.rows, self.left_out + other.left_out)


def of_share(share: float, n: int) -> float:
    """Two standard errors of a share of ``n`` trials; at 0 and 1 the rule of three (3 / n)."""
    return 2 * (share * (1 - share) / n) ** 0.5 if 0 < share < 1 else 3.0 / n


def of_rms(value: float, n: int) -> float:
    """Two standard errors of a root mean square of ``n`` normal errors."""
    return float(2 * value / (2 * n) ** 0.5)


def scaled(rows: Sequence[Row], factor: float) -> list[Row]:
    """Multiply all times by a factor; ratios stay."""
    keys = ("time_ms", "parts")
    return [{**row, **{key: {name: value * factor for name, value in row[key].items()} for key in keys if key in row}} for row in rows]


def varied(cls: type[T], knobs: Mapping[str, Sequence[Any]]) -> dict[str, T]:
    """Give a configuration of all defaults, which stands first, and others that differ from it in one knob: ``dotted.name=value``."""
    made = {"default": cls()}
    return made | {f"{knob}={value}": load(cls, nest({knob: value})) for knob, values in knobs.items() for value in values}


def join(parts: Iterable[dict[str, Any]]) -> dict[str, Any]:
    """Put the results of several benchmarks into one, choices in order; raise ValueError when two have a figure of one name."""
    figures: dict[str, Any] = {}
    choices: list[Row] = []
    for part in parts:
        own = {key: value for key, value in part.items() if key != "choices"}
        if twice := sorted(figures.keys() & own.keys()):
            raise ValueError(f"two benchmarks give {', '.join(twice)}; show them apart")
        figures |= own
        choices += part["choices"]
    return figures | {"choices": choices}


def matrix(validation: Validation) -> dict[str, Any]:
    """Give a confusion matrix and the recalls as plain data; labels without samples have no recall."""
    recall = {name: float(value) for name, value in zip(validation.labels, validation.recall, strict=True) if not np.isnan(value)}
    return {"labels": list(validation.labels), "confusion": validation.confusion.tolist(), "recall": recall}


FASTER = 0.1  # a choice that saves less than this share of the time is not told apart from another: so much a machine drifts in a run


def front(time: NDArray[np.float64], loss: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Tell which points (time and loss, less is better, shape (n,)) no other dominates: is no worse in both, and better in one."""
    no_worse = (time[:, None] <= time) & (loss[:, None] <= loss)
    better = (time[:, None] < time) | (loss[:, None] < loss)
    return np.asarray(~(no_worse & better).any(axis=0))


def loss(row: Row) -> float:
    """Accuracy as what is better when less."""
    value = float(row["accuracy"]["value"])
    return -value if row["better"] == "higher" else value


def kept(rows: Sequence[Row]) -> NDArray[np.bool_]:
    """Tell which rows of a panel are on its front, shape (n_rows,)."""
    return front(np.array([row["time_ms"]["median"] for row in rows]), np.array([loss(row) for row in rows]))


def panels(rows: Sequence[Row]) -> Iterator[tuple[str, list[Row]]]:
    """Give the rows of each panel, in the order in which panels begin."""
    for name in dict.fromkeys(row["stage"] for row in rows):
        yield name, [row for row in rows if row["stage"] == name]


def beaten_by(row: Row, rows: Sequence[Row]) -> list[Row]:
    """Name the choices of a row's panel that are no worse in both, and in one better by more than chance; none: the row is on the front."""
    found = []
    for other in rows:
        quicker, own = other["time_ms"]["median"], row["time_ms"]["median"]
        gain = loss(row) - loss(other)
        clearly = quicker < (1 - FASTER) * own or gain > max(row["margin"], other["margin"])
        if other is not row and quicker <= own and gain >= 0 and clearly:
            found.append(other)
    return found


def share_interval(part: int, whole: int, z: float = 1.96) -> tuple[float, float]:
    """Give the interval of a share by Wilson's score (1927), 95 % by default; (0, 1) of nothing."""
    if not whole:
        return 0.0, 1.0
    share, n = part / whole, z * z / whole
    half = z * math.sqrt(share * (1 - share) / whole + n / (4 * whole))
    low, high = ((share + n / 2 + sign * half) / (1 + n) for sign in (-1, 1))
    return (low if part else 0.0), (high if part < whole else 1.0)


def rate_interval(count: int, time: float, level: float = 0.95) -> tuple[float, float]:
    """Give the exact interval of a Poisson rate (Garwood 1936) of ``count`` events in some time; (0, infinity) without time."""
    from scipy.stats import chi2  # half a second to import, and few need it

    if not time:
        return 0.0, math.inf
    tail = (1 - level) / 2
    low = float(chi2.ppf(tail, 2 * count)) / 2 if count else 0.0
    return low / time, float(chi2.ppf(1 - tail, 2 * count + 2)) / 2 / time


def share(name: str, part: int, whole: int) -> dict[str, Any]:
    """Give a share as ``name`` and its interval as ``name_interval``; both None of nothing."""
    interval = list(share_interval(part, whole)) if whole else None
    return {name: part / whole if whole else None, f"{name}_interval": interval}


def rate(name: str, count: int, time: float) -> dict[str, Any]:
    """Give a rate as ``name`` and its interval as ``name_interval``; both None without time."""
    interval = list(rate_interval(count, time)) if time else None
    return {name: count / time if time else None, f"{name}_interval": interval}


@dataclass(frozen=True)
class Tally:
    """What became of the gestures and tracks of some runs; two tallies add up to that of both."""

    minutes: float = 0.0
    # performed, right, wrong, missed: gestures, and what the person who performed them was credited with, see `score_gestures`
    performed: int = 0
    right: int = 0
    wrong: int = 0
    missed: int = 0
    false_gestures: int = 0  # published gestures without a performed one of that person; those of tracks on nobody too
    ghost_gestures: int = 0  # those of them whose track was on nobody
    crossed: int = 0  # those of them credited to somebody who performed none then, while others did
    # track_frames, ghost_track_frames: confirmed tracks summed over the moments; those of them without a person within the gate, see
    # `Matching`
    track_frames: int = 0
    ghost_track_frames: int = 0

    def __add__(self, other: Tally) -> Tally:
        return Tally(*(getattr(self, name) + getattr(other, name) for name in self.__dataclass_fields__))

    def figures(self) -> dict[str, Any]:
        """Shares of the gestures performed, and rates per minute; ``accuracy``: gestures credited rightly."""
        return {
            "performed": self.performed,
            **share("accuracy", self.right, self.performed),
            "wrong": self.wrong,
            "missed": self.missed,
            **share("cross_talk", self.crossed, self.performed),
            "ghosts": self.ghost_gestures,
        } | self.false_figures()

    def false_figures(self) -> dict[str, Any]:
        """Say what was found where nothing was: false gestures and ghosts."""
        return {
            "false_gestures": self.false_gestures,
            **rate("false_gestures_per_minute", self.false_gestures, self.minutes),
            "ghost_track_frames": self.ghost_track_frames,
            "ghost_track_frames_per_minute": self.ghost_track_frames / self.minutes if self.minutes else None,
            "ghost_share_of_track_frames": self.ghost_track_frames / self.track_frames if self.track_frames else None,
        }
