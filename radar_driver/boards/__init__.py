"""Boards that Handwave knows: every module of this package is one and says what it is in ``BOARD``; a new board is one new module.

Boards of other people's packages are found by their entry points in the group ``handwave.boards`` (docs/adding-a-board.md).
"""

from __future__ import annotations

import importlib
import importlib.metadata
import pkgutil
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any, Final

from radar_core import ConfigError
from radar_driver.live import LiveSource


@dataclass(frozen=True)
class Found:
    """A device that is plugged in.

    Attributes
    ----------
    board : str
        What it is, as in `boards`.
    address : str
        Where it is, for people.
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
    """A kind of board.

    Attributes
    ----------
    name : str
        Value of the driver's parameter ``source``.
    title : str
        For people.
    config : type
        Knobs, a class made with `radar_core.config.config`; the driver declares each as parameter ``NAME.knob``.
    open : callable
        Makes the source of a configuration; nothing is touched before its `power_up`.
    find : callable
        Lists what is plugged in; quick, and changes nothing.
    clouds : bool
        Whether the board gives point clouds instead of raw frames.
    """

    name: str
    title: str
    config: type
    open: Callable[[Any], LiveSource]
    find: Callable[[], Sequence[Found]]
    clouds: bool = False


GROUP: Final = "handwave.boards"
"""Entry points of this group are boards of other packages: each names a `Board`."""


@cache
def _known() -> tuple[Mapping[str, Board], Mapping[str, str]]:
    names = sorted(module.name for module in pkgutil.iter_modules(__path__))
    ours = [importlib.import_module(f"{__name__}.{name}").BOARD for name in names]
    found = {board.name: board for board in ours}
    bad: dict[str, str] = {}
    for entry in sorted(importlib.metadata.entry_points(group=GROUP), key=lambda entry: (entry.name, entry.value)):
        try:
            other = _checked(entry.load())
        except Exception as error:  # somebody else's code: whatever it raises must not take the other boards away
            bad[entry.name] = f"{entry.value} cannot be used: {type(error).__name__}: {error}"
            continue
        if other.name in found:
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


def boards() -> Mapping[str, Board]:
    """All boards by name: ours, then those of other packages."""
    return _known()[0]


def broken() -> Mapping[str, str]:
    """Boards of other packages that cannot be used: the entry point's name, and why."""
    return _known()[1]


def board(name: str) -> Board:
    """Look up a board.

    Raises
    ------
    ConfigError
        When there is none of that name.
    """
    if name not in boards():
        if name in broken():
            raise ConfigError(f"the board {name!r}: {broken()[name]}")
        raise ConfigError(f"there is no board {name!r}; choose one of {', '.join(boards())}")
    return boards()[name]
