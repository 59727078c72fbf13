"""Levels of accuracy of a stage, the most accurate first, with their times on a machine: what `handwave tradeoff --tune` stores."""

from __future__ import annotations

import json
import math
import os
import platform
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from functools import cache
from pathlib import Path
from typing import Any, Final

from radar_core.errors import ConfigError, DataError

FORMAT: Final = 1
_BETTER: Final = ("lower", "higher")


@dataclass(frozen=True)
class Level:
    """One way to run a stage.

    Raises
    ------
    DataError
        When a number makes no sense.
    """

    name: str  # for people
    knobs: Mapping[str, Any]  # by dotted name, those that it sets apart from the stage's configuration
    every: int  # only one frame in so many is processed; the others are left out on purpose
    time_ms: float  # median time of a frame that is processed [ms]
    accuracy: float  # measured with it; `Ladder.figure` says what

    def __post_init__(self) -> None:
        if not (self.time_ms > 0 and math.isfinite(self.time_ms)):
            raise DataError(f"Level.time_ms of {self.name!r} is {self.time_ms}; it must be a positive finite number")
        if not math.isfinite(self.accuracy):
            raise DataError(f"Level.accuracy of {self.name!r} is {self.accuracy}; it must be a finite number")
        if self.every < 1:
            raise DataError(f"Level.every of {self.name!r} is {self.every}; it must be 1 (every frame) or more")

    @property
    def cost_ms(self) -> float:
        """Time for each frame of the radar on average, those included that are left out [ms]."""
        return self.time_ms / self.every


@dataclass(frozen=True)
class Ladder:
    """What a stage can do, from the most accurate level down to the quickest.

    Raises
    ------
    DataError
        When there is no level, or levels are not in order.
    """

    stage: str  # name of the node
    figure: str  # what accuracy means
    unit: str
    better: str  # ``lower`` or ``higher``
    levels: tuple[Level, ...]  # each quicker per frame of the radar than the one before
    machine: str = ""  # where it was measured

    def __post_init__(self) -> None:
        if not self.levels:
            raise DataError(f"Ladder.levels of {self.stage!r} is empty; a stage has one way to run at least")
        if self.better not in _BETTER:
            raise DataError(f"Ladder.better of {self.stage!r} is {self.better!r}; it must be one of {', '.join(_BETTER)}")
        for before, level in zip(self.levels, self.levels[1:], strict=False):
            if level.cost_ms >= before.cost_ms:
                raise DataError(f"Ladder.levels of {self.stage!r}: {level.name!r} is not quicker than {before.name!r} before it")


def save_ladders(path: Path, ladders: Sequence[Ladder]) -> None:
    """Write what was measured, one stage after the other; a run that is stopped meanwhile leaves the file of before, or none."""
    partial = path.with_suffix(".partial")
    content = {"format": FORMAT, "stages": {ladder.stage: asdict(ladder) for ladder in ladders}}
    partial.write_text(json.dumps(content, indent=1, allow_nan=False) + "\n", encoding="utf-8")
    os.replace(partial, path)


def load_ladders(path: str | Path) -> dict[str, Ladder]:
    """Read what was measured, by stage.

    Raises
    ------
    ConfigError
        When the file cannot be read or is not of this format.
    DataError
        When its numbers make no sense.
    """
    path = Path(path).expanduser()
    again = "make it anew: handwave tradeoff --tune -o FOLDER"
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise ConfigError(f"{path}: cannot be read ({error.strerror}); {again}") from None
    except ValueError as error:
        raise ConfigError(f"{path}: is no JSON ({error}); {again}") from None
    if not isinstance(content, dict) or content.get("format") != FORMAT:
        raise ConfigError(f"{path}: is no file of levels of format {FORMAT}; {again}")
    try:
        return {name: _ladder(stage) for name, stage in content["stages"].items()}
    except (KeyError, TypeError, AttributeError) as error:
        raise ConfigError(f"{path}: something is missing or of the wrong type ({error}); {again}") from None


def _ladder(stage: dict[str, Any]) -> Ladder:
    return Ladder(**{**stage, "levels": tuple(Level(**level) for level in stage["levels"])})


@cache
def machine() -> str:
    """Name processor, number of cores, system and Python: what measured times depend on and what does not change while it runs."""
    return f"{_processor()}, {os.cpu_count()} cores, {platform.system()} {platform.machine()}, Python {platform.python_version()}"


def _processor() -> str:
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        return platform.processor() or "unknown processor"
    names = [line.partition(":")[2].strip() for line in lines if line.startswith(("model name", "Model"))]
    return names[0] if names else platform.processor() or "unknown processor"
