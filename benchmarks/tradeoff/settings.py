"""How much is measured, and on what."""

from __future__ import annotations

import functools
import hashlib
from dataclasses import dataclass
from pathlib import Path
from typing import TypeVar

T = TypeVar("T")


@dataclass(frozen=True)
class Settings:
    """What a stage needs to know.

    Attributes
    ----------
    folder : Path
        Where it may keep what it simulated, for a run that goes on later.
    quick : bool
        Little data and few repetitions.
    seed : int
        Of everything random.
    scene : str or None
        Scene file, or one of ours by name, in place of a stage's own; None: its own.
    domain : int or None
        ROS domain of stages that run a graph; None: a free one of the upper half.
    """

    folder: Path
    quick: bool = False
    seed: int = 1
    scene: str | None = None
    domain: int | None = None

    def pick(self, quick: T, full: T) -> T:
        """Choose between an amount for quick runs and one for full ones."""
        return quick if self.quick else full


@functools.cache
def sources(parts: tuple[str, ...]) -> str:
    """Digest the code of packages, or of single modules, by their paths: figures of other code are not these."""
    root, found = Path(__file__).resolve().parents[2], hashlib.sha256()
    for part in parts:
        for path in sorted((root / part).rglob("*.py")) or [root / part]:
            found.update(f"{path.relative_to(root)}\n{path.read_text(encoding='utf-8')}\n".encode())
    return found.hexdigest()[:16]
