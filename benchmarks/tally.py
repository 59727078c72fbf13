"""What every study of gestures counts, and how it reports: shares and rates with their 95 % intervals."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

from scipy.stats import chi2


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
