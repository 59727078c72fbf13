"""Boards that Handwave knows: every module of this package is one and says what it is in ``BOARD``; a new board is one new module."""

from __future__ import annotations

import importlib
import pkgutil
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any

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


@cache
def boards() -> Mapping[str, Board]:
    """All boards by name."""
    names = sorted(module.name for module in pkgutil.iter_modules(__path__))
    found = [importlib.import_module(f"{__name__}.{name}").BOARD for name in names]
    return {board.name: board for board in found}


def board(name: str) -> Board:
    """Look up a board.

    Raises
    ------
    ConfigError
        When there is none of that name.
    """
    if name not in boards():
        raise ConfigError(f"there is no board {name!r}; choose one of {', '.join(boards())}")
    return boards()[name]
