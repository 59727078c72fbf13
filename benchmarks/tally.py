"""What every study of gestures counts, and how it reports: shares and rates with their 95 % intervals."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from scipy.stats import chi2


def share_interval(part: int, whole: int, z: float = 1.96) -> tuple[float, float]:
    """Give the interval of a share by Wilson's score (1927), 95 % by default; (0, 1) of nothing."""
    if not whole:
        return 0.0, 1.0
    share, n = part / whole, z * z / whole
    half = z * math.sqrt(share * (1 - share) / whole + n / (4 * whole))
    return max(0.0, (share + n / 2 - half) / (1 + n)), min(1.0, (share + n / 2 + half) / (1 + n))


def rate_interval(count: int, time: float, level: float = 0.95) -> tuple[float, float]:
    """Give the exact interval of a Poisson rate (Garwood 1936) of ``count`` events in some time; (0, infinity) without time."""
    if not time:
        return 0.0, math.inf
    tail = (1 - level) / 2
    low = float(chi2.ppf(tail, 2 * count)) / 2 if count else 0.0
    return low / time, float(chi2.ppf(1 - tail, 2 * count + 2)) / 2 / time


@dataclass(frozen=True)
class Tally:
    """What every evaluation of gestures counts; two tallies add up to that of both.

    Attributes
    ----------
    minutes : float
        Length [min].
    performed, right, wrong, missed : int
        Gestures that people performed, and what they were credited with.
    false_gestures : int
        Published gestures without a performed one, those of ghosts too.
    ghost_gestures : int
        Those of them whose track was on nobody.
    track_frames, ghost_track_frames : int
        Confirmed tracks summed over the moments; those of them without a person within the gate.
    """

    minutes: float = 0.0
    performed: int = 0
    right: int = 0
    wrong: int = 0
    missed: int = 0
    false_gestures: int = 0
    ghost_gestures: int = 0
    track_frames: int = 0
    ghost_track_frames: int = 0

    @classmethod
    def of(cls, report: Mapping[str, Any]) -> Tally:
        """Take what counts out of the report of an `Evaluator`."""
        gestures = report["gestures"]
        names = {"performed": "total", "right": "hits", "wrong": "wrong", "missed": "misses"}
        same = ("false_gestures", "ghost_gestures")
        return cls(
            **{name: report[name] for name in ("minutes", "track_frames", "ghost_track_frames")},
            **{name: gestures[key] for name, key in names.items()},
            **{name: gestures[name] for name in same},
        )

    def __add__(self, other: Tally) -> Tally:
        return Tally(*(getattr(self, name) + getattr(other, name) for name in self.__dataclass_fields__))

    def figures(self) -> dict[str, Any]:
        """Shares of the gestures performed and rates per minute with their 95 % intervals; None where there is nothing to divide by."""
        right = share_interval(self.right, self.performed) if self.performed else None
        false = rate_interval(self.false_gestures, self.minutes) if self.minutes else None
        return {
            "performed": self.performed,
            "right_share": self.right / self.performed if self.performed else None,
            "right_share_interval": right,
            "false_gestures": self.false_gestures,
            "false_gestures_per_minute": self.false_gestures / self.minutes if self.minutes else None,
            "false_gestures_per_minute_interval": false,
            "ghost_track_frames": self.ghost_track_frames,
            "ghost_track_frames_per_minute": self.ghost_track_frames / self.minutes if self.minutes else None,
            "ghost_share_of_track_frames": self.ghost_track_frames / self.track_frames if self.track_frames else None,
        }
