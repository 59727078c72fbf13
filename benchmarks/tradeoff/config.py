"""How much a study measures, and on what."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TypeVar

T = TypeVar("T")


@dataclass(frozen=True)
class StudyConfig:
    """What a study needs to know.

    Attributes
    ----------
    folder : Path
        Where it may keep what it simulated, for a run that goes on later.
    quick : bool
        Little data and few repetitions.
    seed : int
        Of everything random.
    scene : str or None
        Scene file, or one of ours by name, in place of a study's own; None: its own.
    domain : int or None
        ROS domain of studies that run a graph; None: as in the environment.
    """

    folder: Path
    quick: bool = False
    seed: int = 1
    scene: str | None = None
    domain: int | None = None

    def pick(self, quick: T, full: T) -> T:
        """Choose between an amount for quick runs and one for full ones."""
        return quick if self.quick else full
