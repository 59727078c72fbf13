"""The stages that are measured, in the order of the chain."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from importlib import import_module
from typing import TYPE_CHECKING, Final

from radar_core import ConfigError

if TYPE_CHECKING:
    from benchmarks.report import Found
    from benchmarks.tradeoff.config import StudyConfig


@dataclass(frozen=True)
class Stage:
    """One study of `handwave tradeoff`."""

    name: str  # of the stage's files
    title: str  # heading in the report
    packages: tuple[str, ...]  # whose code its figures depend on
    scene: bool  # whether `StudyConfig.scene` replaces its own
    module: str = ""  # that measures it; empty: that of its name beside this one

    @property
    def path(self) -> str:
        """Dotted name of the module that measures it."""
        return self.module or f"benchmarks.tradeoff.{self.name}"

    @property
    def measure(self) -> Callable[[StudyConfig], Found]:
        """What measures it; its imports take seconds, so they wait until then."""
        found: Callable[[StudyConfig], Found] = import_module(self.path).measure
        return found


_DSP: Final = ("radar_core", "radar_dsp")
_PEOPLE: Final = (*_DSP, "radar_sim", "radar_tracking")
_ALL: Final = (*_PEOPLE, "radar_gestures")

STAGES: Final[dict[str, Stage]] = {
    stage.name: stage
    for stage in (
        Stage("simulator", "Simulator: fidelity", ("radar_core", "radar_sim", "benchmarks/propagation.py"), True),
        Stage("transforms", "Baseband: sample type, FFT back end, word length", _DSP, False),
        Stage("detection", "Baseband: CFAR, detections kept, grouping", _DSP, False),
        Stage("directions", "Baseband: direction of arrival, refinement", _DSP, False),
        Stage("clustering", "Tracking: clustering alone", ("radar_core", "radar_tracking", "benchmarks/clustering_parts.py"), False),
        Stage("tracking", "Tracking: trackers, estimators, clustering", _PEOPLE, True),
        Stage("radar", "Radar: frame rate, number of transmitters", _PEOPLE, True),
        Stage("hand", "Hand: number of radars, filter", _PEOPLE, True),
        Stage("gestures", "Gestures: feature source, classifier", _ALL, False),
        Stage("budget", "Budget: levels of accuracy", _PEOPLE, True, "benchmarks.tradeoff.tune"),
        Stage("graph", "Graph: processes", _ALL, True, "benchmarks.graph"),
        Stage("chain", "The whole chain", _ALL, True),
    )
}
"""By name."""


def chosen(names: tuple[str, ...]) -> tuple[Stage, ...]:
    """Look stages up by name; none: all.

    Raises ConfigError: naming what there is not, and what there is.
    """
    unknown = [name for name in names if name not in STAGES]
    if unknown:
        raise ConfigError(f"--stage {unknown[0]}: there is no such stage; choose of {', '.join(STAGES)}")
    return tuple(stage for name, stage in STAGES.items() if not names or name in names)
