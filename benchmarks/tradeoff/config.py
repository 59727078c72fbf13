"""How much a study measures, and on what."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TypeVar

T = TypeVar("T")


@dataclass(frozen=True)
class StudyConfig:
    """What a study needs to know."""

    folder: Path  # where it may keep what it simulated, for a run that goes on later
    quick: bool = False  # little data and few repetitions
    seed: int = 1
    scene: str | None = None  # scene file, or one of ours by name, in place of a study's own; None: its own
    domain: int | None = None  # ROS domain of studies that run a graph; None: as in the environment

    def pick(self, quick: T, full: T) -> T:
        """Choose between an amount for quick runs and one for full ones."""
        return quick if self.quick else full
