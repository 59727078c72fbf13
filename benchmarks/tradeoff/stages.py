"""The stages that are measured, in the order of the chain."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Final, TypeVar

from radar_core import ConfigError

if TYPE_CHECKING:
    from benchmarks.report import Found

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


@dataclass(frozen=True)
class Stage:
    """One study of `handwave tradeoff`."""

    name: str  # of the stage's files
    title: str  # heading in the report
    packages: tuple[str, ...]  # whose code its figures depend on
    scene: bool  # whether `StudyConfig.scene` replaces its own
    module: str  # that measures it
    function: str = "measure"  # of that module

    @property
    def measure(self) -> Callable[[StudyConfig], Found]:
        """What measures it; its imports take seconds, so they wait until then."""
        found: Callable[[StudyConfig], Found] = getattr(import_module(self.module), self.function)
        return found


_DSP: Final = ("radar_core", "radar_dsp")
_LOSSES: Final = (*_DSP, "benchmarks/dsp_losses.py")
_PEOPLE: Final = (*_DSP, "radar_sim", "radar_tracking")
_ALL: Final = (*_PEOPLE, "radar_gestures")
_BASEBAND, _ROOM = "benchmarks.tradeoff.baseband", "benchmarks.tradeoff.people"

STAGES: Final[dict[str, Stage]] = {
    stage.name: stage
    for stage in (
        Stage("simulator", "Simulator: fidelity", ("radar_core", "radar_sim"), True, "benchmarks.propagation", "fidelity"),
        Stage("transforms", "Baseband: sample type, FFT back end, word length, lost chirps", _LOSSES, False, _BASEBAND, "transforms"),
        Stage("detection", "Baseband: CFAR, detections kept, grouping", _DSP, False, _BASEBAND, "detection"),
        Stage("directions", "Baseband: direction of arrival, refinement", _DSP, False, _BASEBAND, "directions"),
        Stage("clustering", "Tracking: clustering alone", ("radar_core", "radar_tracking"), False, "benchmarks.clustering_parts"),
        Stage("tracking", "Tracking: trackers, estimators, clustering", _PEOPLE, True, _ROOM, "trackers"),
        Stage("radar", "Radar: frame rate, number of transmitters", _PEOPLE, True, _ROOM, "radars"),
        Stage("hand", "Hand: number of radars, filter", _PEOPLE, True, "benchmarks.hand", "filters"),
        Stage("gestures", "Gestures: feature source, classifier", _ALL, False, "benchmarks.gesture_knobs", "features"),
        Stage("budget", "Budget: levels of accuracy", _PEOPLE, True, "benchmarks.tradeoff.tune"),
        Stage("graph", "Graph: processes", _ALL, True, "benchmarks.graph"),
        Stage("chain", "The whole chain", _ALL, True, _ROOM, "chain"),
    )
}
"""By name."""


def chosen(names: tuple[str, ...]) -> tuple[Stage, ...]:
    """Look stages up by name; none: all. Raises ConfigError: naming what there is not, and what there is."""
    unknown = [name for name in names if name not in STAGES]
    if unknown:
        raise ConfigError(f"--stage {unknown[0]}: there is no such stage; choose of {', '.join(STAGES)}")
    return tuple(stage for name, stage in STAGES.items() if not names or name in names)
