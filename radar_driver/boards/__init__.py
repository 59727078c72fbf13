"""Sources that Handwave knows, by name. Each module of this package says what it is in ``BOARD``; a new board is one new module.

Boards of other people's packages are found by their entry points in the group ``handwave.boards`` (docs/how-to/adding-a-board.md). A later
room calls `register`.
"""

from __future__ import annotations

import importlib
import importlib.metadata
import importlib.util
import pkgutil
import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any, Final

from radar_core import ConfigError
from radar_driver.sources import Context, Source


@dataclass(frozen=True)
class Found:
    """A device that is plugged in.

    Attributes
    ----------
    board, address : str
        What it is, as in `boards`; where it is, for people.
    options : mapping
        Knobs of the board's configuration that choose this device among several.
    problem : str
        Why it cannot be used, and what to do; empty: it can.
    """

    board: str
    address: str
    options: Mapping[str, Any]
    problem: str = ""


@dataclass(frozen=True)
class Board:
    """A kind of source: a board, the simulated radar, recordings.

    Attributes
    ----------
    name, title : str
        Value of the driver's parameter ``source``; for people.
    config : type
        Knobs, a class made with `radar_core.config.config`; the driver declares each as a parameter.
    open : callable
        Makes the source of a configuration (and a `Context`, see ``paced``); no device is touched before its `power_up`.
    find : callable or None
        Lists what is plugged in; quick, and changes nothing. None: there is nothing to plug in.
    clouds : bool
        Whether it gives point clouds instead of raw frames.
    targets : bool
        Whether it follows people itself and gives `radar_driver.targets.Targets` instead of either.
    prefix : str or None
        In front of the knobs' names in the driver's parameters; None: ``NAME.``.
    paced : bool
        Whether `open` takes a `Context` too, on whose clock frames are then due and stamped.
    """

    name: str
    title: str
    config: type
    open: Callable[..., Source]
    find: Callable[[], Sequence[Found]] | None = None
    clouds: bool = False
    prefix: str | None = None
    paced: bool = False
    targets: bool = False

    @property
    def variant(self) -> str:
        """The graph that works with what it gives, see `GIVES`."""
        return "targets" if self.targets else "clouds" if self.clouds else "live"

    def parameter(self, knob: str = "") -> str:
        """Name of a knob among the driver's parameters; of no knob: what they begin with."""
        return (f"{self.name}." if self.prefix is None else self.prefix) + knob

    def source(self, config: Any, context: Context | None = None) -> Source:
        """Make the source of a configuration; ``context`` is for those that are paced (None: real time)."""
        return self.open(config, context or Context()) if self.paced else self.open(config)


GIVES: Final = {"targets": "targets", "clouds": "point clouds", "live": "raw frames"}  # what boards give, by graph
GROUP: Final = "handwave.boards"  # entry points of this group are boards of other packages: each names a `Board`

_registered: dict[str, Board] = {}


def register(board: Board) -> Board:
    """Make a kind of source of a later room known; gives it back."""
    _registered[board.name] = board
    return board


def _ours() -> list[str]:
    """Names of the boards of this package, which are those of its modules."""
    return sorted(module.name for module in pkgutil.iter_modules(__path__))


@cache
def _known() -> tuple[Mapping[str, Board], Mapping[str, str]]:
    """Boards of other packages, and why some cannot be used."""
    found: dict[str, Board] = {}
    bad: dict[str, str] = {}
    for entry in sorted(importlib.metadata.entry_points(group=GROUP), key=lambda entry: (entry.name, entry.value)):
        try:
            other = _checked(entry.load())
        except Exception as error:  # somebody else's code: whatever it raises must not take the other boards away
            bad[entry.name] = f"{entry.value} cannot be used: {type(error).__name__}: {error}"
            continue
        if other.name in found or other.name in _ours():
            bad[entry.name] = f"{entry.value} calls its board {other.name!r}, as another one is called; it needs a name of its own"
        else:
            found[other.name] = other
    return found, bad


def _checked(value: Any) -> Board:
    if not isinstance(value, Board):
        raise ConfigError(f"it is a {type(value).__name__}, not a radar_driver.boards.Board")
    if not value.name.isidentifier() or value.name in ("sim", "bag"):
        raise ConfigError(f"{value.name!r} cannot be the name of a board: use letters, digits and _, and neither sim nor bag")
    return value


@cache
def _from_file(path: Path) -> Board:
    """Load the ``BOARD`` of a Python file, whose folder may hold what it imports."""
    spec = importlib.util.spec_from_file_location(f"handwave_board_{path.stem}", path)
    if spec is None or spec.loader is None or not path.is_file():
        raise ConfigError(f"there is no Python file {path}: name the .py file that has your BOARD (docs/how-to/adding-a-board.md)")
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module  # dataclasses look their types up there
    sys.path.append(str(path.parent))
    try:
        spec.loader.exec_module(module)
        found = _checked(getattr(module, "BOARD", None))
    except Exception as error:  # somebody else's code: what it raises is said, not thrown at who asked for it
        raise ConfigError(f"{path} cannot be used as a board: {type(error).__name__}: {error}") from error
    if found.name in _ours():
        raise ConfigError(f"{path} calls its board {found.name!r}, as one of ours is called; give it a name of its own")
    return found


def boards() -> Mapping[str, Board]:
    """All kinds of source by name: ours, then those of other packages."""
    return {**{name: board(name) for name in _ours()}, **_registered, **_known()[0]}


def broken() -> Mapping[str, str]:
    """Boards of other packages that cannot be used: the entry point's name, and why."""
    return _known()[1]


def board(name: str) -> Board:
    """Look up a kind of source, importing no other one of ours; ``name`` may be a Python file with a ``BOARD``.

    A `ConfigError` says that there is none of that name, or why the file cannot be used.
    """
    if name.endswith(".py"):
        return _from_file(Path(name).resolve())
    if name in _ours():
        return importlib.import_module(f"{__name__}.{name}").BOARD  # type: ignore[no-any-return]
    if name in _registered:
        return _registered[name]
    if name in broken():
        raise ConfigError(f"the board {name!r}: {broken()[name]}")
    if name not in boards():
        raise ConfigError(f"there is no source {name!r}; choose one of {', '.join(boards())}")
    return boards()[name]
