"""The measured choices of `handwave tradeoff`: what each achieves, what it takes, and which parameters it sets."""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from radar_core import ConfigError
from radar_core.paths import share_dir

Settings = Mapping[str, Any]
"""Parameters by node and name: ``tracking.tracker``; a parameter that is not named keeps its default."""


@dataclass(frozen=True)
class Choice:
    """One measured choice."""

    panel: str  # the knob that it is a choice of
    name: str
    # figure, unit, better: what accuracy means here, its unit, and whether a lower or a higher one is better
    figure: str
    unit: str
    better: str
    accuracy: float
    margin: float  # differences of the accuracy below this are chance
    time: float  # median [ms]
    slow: float  # 95th percentile of the time [ms]
    default: bool  # whether the product does so unless told otherwise
    reference: str  # what the ratio is to
    ratio: float
    settings: Settings | None  # what it sets; None: not by parameters

    @property
    def loss(self) -> float:
        """Accuracy as what is better when less."""
        return -self.accuracy if self.better == "higher" else self.accuracy


def default_folder() -> Path:
    """Folder with the results that come with Handwave."""
    return share_dir() / "config" / "tradeoff"


def load_choices(folder: Path) -> dict[str, list[Choice]]:
    """Read what `handwave tradeoff -o FOLDER` wrote: the choices of each knob.

    A `ConfigError` says that there are no results, or that they cannot be read.
    """
    panels: dict[str, list[Choice]] = {}
    for path in sorted(folder.glob("*.json")):
        try:
            rows = json.loads(path.read_text(encoding="utf-8"))["rows"]
            for row in rows:
                panels.setdefault(row["stage"], []).append(_choice(row))
        except (OSError, ValueError, KeyError, TypeError, AttributeError) as error:
            raise ConfigError(f"{path}: is no result of handwave tradeoff ({error!r}); give the folder that its -o names") from None
    if not panels:
        raise ConfigError(f"{folder}: holds no results; make some with: handwave lab tradeoff -o {folder}")
    return panels


def _choice(row: Mapping[str, Any]) -> Choice:
    accuracy, time = row["accuracy"], row["time_ms"]
    return Choice(
        row["stage"], row["choice"], accuracy["name"], accuracy["unit"], row["better"], float(accuracy["value"]), float(row["margin"]),
        float(time["median"]), float(time["p95"]), bool(row["default"]), row["reference"], float(row["ratio"]),
        settings(row["stage"], row["choice"]),
    )  # fmt: skip


def on_front(choice: Choice, others: list[Choice]) -> bool:
    """Whether no other choice is better in one, time or accuracy, and no worse in the other."""
    return not any(
        other.time <= choice.time and other.loss <= choice.loss and (other.time < choice.time or other.loss < choice.loss)
        for other in others
    )


def settings(panel: str, name: str) -> Settings | None:
    """Which parameters a choice sets; None: it is no matter of parameters."""
    for known, pattern, made in _RULES:
        if panel == known and (found := re.fullmatch(pattern, name)):
            return made(*found.groups())
    return None


def _one(parameter: str) -> Callable[..., Settings]:
    """Make what sets one parameter to the name of the choice."""
    return lambda value: {parameter: value}


_GROUPS: Final[Settings] = {"tracking.tracker": "group_clustering"}  # estimators and clusterings are of the thesis's trackers


def _of_groups(parameter: str) -> Callable[..., Settings]:
    """Make the same of a parameter of the thesis's trackers."""
    return lambda value: {**_GROUPS, parameter: value}


def _level(levels: Mapping[str, Settings]) -> Callable[..., Settings | None]:
    """Make what sets a level of a budget; one of which one frame in so many is used is set by no parameter, but chosen by the budget."""
    return lambda name, every: None if every else levels[name]


_BASEBAND_LEVELS: Final[Mapping[str, Settings]] = {
    "one refinement step": {"baseband.doa.newton_steps": 1},
    "one echo in a cell": {},
    "two echoes in a cell": {"baseband.doa.method": "dml2"},
    "one echo, refined on the samples": {"baseband.refine": "ml"},
    "two echoes, refined on the samples": {"baseband.doa.method": "dml2", "baseband.refine": "ml"},
}
_TRACKING_LEVELS: Final[Mapping[str, Settings]] = {
    "every frame": {},
    "linear filter, group tracker": {"tracking.tracker": "group"},
    "linear filter": _GROUPS,
    "velocity filter": {**_GROUPS, "tracking.filter.estimator.name": "mm_vel_est"},
    "unscented filter": {**_GROUPS, "tracking.filter.estimator.name": "unscented"},
}
_CHAINS: Final[Mapping[str, Settings]] = {
    "fast": {"baseband.doa.newton_steps": 1},
    "default": {},
    "people": {"baseband.doa.method": "dml2"},
    "thorough": {"baseband.doa.method": "dml2", "baseband.doa.newton_steps": 3},
    "most thorough": {
        "baseband.doa.method": "dml2",
        "baseband.doa.newton_steps": 3,
        "baseband.refine": "ml",
    },
}
_EVERY: Final = r"(.+?)(?:, one frame in (\d+))?"
_CFAR: Final = r"cfar=(\w+), window=(\w+)"


def _cfar(algorithm: str, window: str) -> Settings:
    return {"baseband.cfar.algorithm": algorithm, "baseband.cfar.window": window}


def _grid(azimuth: str, elevation: str) -> Settings:
    return {"baseband.doa.grid_azimuth": int(azimuth), "baseband.doa.grid_elevation": int(elevation)}


_RULES: Final[tuple[tuple[str, str, Callable[..., Settings | None]], ...]] = (
    ("FFT back end and word length", r"fft=(numpy|scipy|fftw)", _one("baseband.spectrum.fft")),
    (
        "FFT back end and word length",
        r"fft=fixed, (\d+) bit",
        lambda bits: {"baseband.spectrum.fft": "fixed", "baseband.spectrum.word_length": int(bits)},
    ),
    ("1% of the chirps lost", r"missing=(\w+)", _one("baseband.spectrum.missing")),
    ("10% of the chirps lost", r"missing=(\w+)", _one("baseband.spectrum.missing")),
    ("CFAR, a weak echo alone", _CFAR, _cfar),
    ("CFAR, a weak echo beside a strong one", _CFAR, _cfar),
    ("detections kept", r"at most (\d+)", lambda count: {"baseband.max_detections": int(count)}),
    ("grouping of cells", r"grouping=(\w+)", _one("baseband.grouping")),
    ("grouping of cells", r"select=(\w+)", _one("baseband.select")),
    (
        "DoA grid and refinement",
        r"grid (\d+)x(\d+), (\d+) steps",
        lambda azimuth, elevation, steps: {**_grid(azimuth, elevation), "baseband.doa.newton_steps": int(steps)},
    ),
    (
        "DoA grid and refinement",
        r"search of (\d+)x(\d+)",
        lambda azimuth, elevation: {"baseband.doa.search": "grid", **_grid(azimuth, elevation)},
    ),
    ("DoA method, two echoes in one cell", r"method=(\w+)", _one("baseband.doa.method")),
    ("refinement of range, speed and direction", r"refine=(\w+)", _one("baseband.refine")),
    ("clustering", r"(\w+)", _of_groups("tracking.association.clustering.name")),
    ("clustering within the tracker", r"(\w+)", _of_groups("tracking.association.clustering.name")),
    ("tracker", r"(\w+)", _one("tracking.tracker")),
    (
        "tracker",
        r"cluster_first, split=(\w+)",
        lambda split: {"tracking.tracker": "cluster_first", "tracking.association.split": split},
    ),
    ("estimator", r"(\w+)", _of_groups("tracking.filter.estimator.name")),
    ("hand filter", r"(\w+)", _one("hand.estimator.name")),
    ("levels of the baseband", _EVERY, _level(_BASEBAND_LEVELS)),
    ("levels of the tracking", _EVERY, _level(_TRACKING_LEVELS)),
    ("whole chain", r"([\w ]+)", lambda name: _CHAINS.get(name)),
)  # fmt: skip
