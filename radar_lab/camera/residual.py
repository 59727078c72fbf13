"""Residuals of hand tracks against a reference that has errors of its own (thesis, Figs. 7.10 and 7.11)."""

from __future__ import annotations

import bisect
from collections import deque
from dataclasses import dataclass, field

import numpy as np

from radar_core import DataError
from radar_core.checks import require_finite, require_shape
from radar_core.config import config, knob
from radar_core.linalg import symmetrise
from radar_core.types import Float64Array

PARTS = ("pixel", "depth", "skin", "latency", "mount", "interpolation")
"""Errors of a reference at a track's stamp: those of `radar_lab.camera.truth.PARTS`, and what lies between two of its images."""
_FRESH = np.array([True, True, False, False, False])  # drawn anew in every image; the others are the same in all of them
_SECOND = 1e-9


@config
class ResidualConfig:
    """How tracks and reference are brought together, and how sure the figures are."""

    max_gap: float = knob(
        0.15, unit="s", low=0.001, high=10.0, doc="two places of the reference farther apart than this are not interpolated between"
    )
    wait: float = knob(
        2.0, unit="s", low=0.01, high=60.0, doc="a track waits this long for the reference, which comes later than the radar"
    )
    acceleration: float = knob(
        5.0, unit="m/s^2", low=0.0, high=200.0, doc="rms acceleration of a hand: how far it strays from the line between two places"
    )
    block: float = knob(0.5, unit="s", low=0.01, high=60.0, doc="residuals farther apart than this do not hang together any more")
    resamples: int = knob(1000, low=100, high=100_000, doc="times that the blocks are drawn again for the confidence interval")
    confidence: float = knob(0.95, low=0.5, high=0.999, doc="of the interval")
    seed: int = knob(0, low=0, high=1 << 62, doc="of drawing the blocks")


def _check(sample: object, **shapes: tuple[int, ...]) -> None:
    """Raise `DataError` for a field of a sample that has another shape or is not finite."""
    for name, shape in shapes.items():
        require_shape(f"{type(sample).__name__}.{name}", getattr(sample, name), shape)
        require_finite(f"{type(sample).__name__}.{name}", getattr(sample, name))


@dataclass(frozen=True, eq=False)
class ReferenceSample:
    """Where the hand is, says the reference."""

    stamp_ns: int  # when [ns]
    position: Float64Array  # in ``room``, shape (3,) [m]
    # covariance, common: of all errors, and of those that are the same in all samples, shape (3, 3) [m^2]
    covariance: Float64Array = field(default_factory=lambda: np.zeros((3, 3)))
    common: Float64Array = field(default_factory=lambda: np.zeros((3, 3)))
    # Root mean square length of the errors named by the first five of `PARTS`, shape (5,) [m]
    part_std: Float64Array = field(default_factory=lambda: np.zeros(5))

    def __post_init__(self) -> None:
        _check(self, position=(3,), covariance=(3, 3), common=(3, 3), part_std=(5,))


@dataclass(frozen=True, eq=False)
class TrackSample:
    """Where the hand is, says one of the trackers that are compared."""

    track: str  # which tracker, e.g. its topic
    stamp_ns: int  # when [ns]
    position: Float64Array  # in ``room``, shape (3,) [m]
    covariance: Float64Array  # of the position, shape (3, 3) [m^2]

    def __post_init__(self) -> None:
        _check(self, position=(3,), covariance=(3, 3))


@dataclass(frozen=True, eq=False)
class Residual:
    """A track less the reference at one moment."""

    sample: TrackSample  # the track
    reference: Float64Array  # place of the reference, interpolated to the track's stamp, shape (3,) [m]
    residual: Float64Array  # track less reference, shape (3,) [m]
    # covariance, common: of the reference there: all errors, and those that are the same at all times, shape (3, 3) [m^2]
    covariance: Float64Array
    common: Float64Array
    part_std: Float64Array  # root mean square length of the errors named by `PARTS`, shape (6,) [m]


class HandResiduals:
    """Bring tracks and a reference together by their stamps; counts, as ``unmatched``, samples of tracks without a reference near enough.

    The reference is interpolated linearly to the stamp of a track. Errors that are drawn anew in every image get smaller between two of
    them, the others stay, and that a hand does not move in a straight line is an error of its own. Samples may come in any order between
    the trackers and the reference, but each in the order of its own stamps; a track waits until the reference has gone past it.
    """

    def __init__(self, config: ResidualConfig | None = None) -> None:
        self.config = config or ResidualConfig()
        self._wait_ns, self._gap_ns = round(self.config.wait / _SECOND), round(self.config.max_gap / _SECOND)
        self.reset()

    def reset(self) -> None:
        """Forget what waits, for a recording that starts again; what was counted stays."""
        self._references: deque[ReferenceSample] = deque()
        self._waiting: deque[TrackSample] = deque()
        self._newest: dict[str, int] = {}
        self.unmatched = getattr(self, "unmatched", 0)

    def process(self, sample: ReferenceSample | TrackSample) -> tuple[Residual, ...]:
        """Take in one sample of a track or of the reference; gives the residuals that are known now, in the order in which the tracks came.

        Raises `DataError` when a sample is not newer than the one before of the same source.
        """
        source = sample.track if isinstance(sample, TrackSample) else ""
        last = self._newest.get(source)
        if last is not None and sample.stamp_ns <= last:
            who = f"track {source!r}" if source else "the reference"
            raise DataError(f"a sample of {who} is not newer than the one before; reset() before another recording")
        self._newest[source] = sample.stamp_ns
        if isinstance(sample, TrackSample):
            self._waiting.append(sample)
        else:
            self._references.append(sample)
        found = self._settle()
        self._forget()
        return found

    def finish(self) -> None:
        """Count what still waits as unmatched: nothing more will come."""
        self.unmatched += len(self._waiting)
        self._waiting.clear()

    def _settle(self) -> tuple[Residual, ...]:
        """Make the residuals of tracks that the reference has gone past."""
        if not self._references:
            return ()
        newest = self._references[-1].stamp_ns
        if not any(sample.stamp_ns <= newest for sample in self._waiting):
            return ()
        stamps = [reference.stamp_ns for reference in self._references]
        found = []
        left: deque[TrackSample] = deque()
        for sample in self._waiting:
            if sample.stamp_ns > newest:
                left.append(sample)
                continue
            after = bisect.bisect_left(stamps, sample.stamp_ns)
            made = self._at(sample, after) if stamps[0] <= sample.stamp_ns else None
            if made is None:
                self.unmatched += 1
            else:
                found.append(made)
        self._waiting = left
        return tuple(found)

    def _at(self, sample: TrackSample, after: int) -> Residual | None:
        """Residual of a track between two references, the second of which is number ``after``; None: they are too far apart."""
        second = self._references[after]
        first = self._references[max(after - 1, 0)]
        if second.stamp_ns - first.stamp_ns > self._gap_ns:
            if second.stamp_ns != sample.stamp_ns:
                return None
            first = second
        gap_ns = second.stamp_ns - first.stamp_ns
        gap = gap_ns * _SECOND
        share = (sample.stamp_ns - first.stamp_ns) / gap_ns if gap_ns else 1.0
        reference = first.position + share * (second.position - first.position)
        bend = 0.5 * share * (1.0 - share) * gap**2 * self.config.acceleration
        common = (1 - share) * first.common + share * second.common
        fresh = (1 - share) ** 2 * (first.covariance - first.common) + share**2 * (second.covariance - second.common)
        before, behind = first.part_std**2, second.part_std**2
        parts = np.where(_FRESH, (1 - share) ** 2 * before + share**2 * behind, (1 - share) * before + share * behind)
        return Residual(
            sample=sample,
            reference=reference,
            residual=sample.position - reference,
            covariance=symmetrise(fresh + common + np.eye(3) * bend**2 / 3),
            common=symmetrise(common),
            part_std=np.sqrt(np.append(np.maximum(parts, 0.0), bend**2)),
        )

    def _forget(self) -> None:
        """Let go of tracks that have waited for too long, and of references that no track can need any more."""
        newest = max(self._newest.values())
        while self._waiting and newest - self._waiting[0].stamp_ns > self._wait_ns:
            self._waiting.popleft()
            self.unmatched += 1
        while len(self._references) > 2 and newest - self._references[1].stamp_ns > self._wait_ns:
            self._references.popleft()
