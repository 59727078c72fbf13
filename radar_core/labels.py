"""Names of gestures: the ten of the thesis with their numbers (section 4.3), and those of one's own, which follow them."""

from __future__ import annotations

import re
from collections.abc import Iterable
from typing import Final

from radar_core.errors import ConfigError

GESTURES: Final = ("random", "pull", "push", "swipe_up", "swipe_down", "swipe_right", "swipe_left", "rotate", "wave", "push_pull")
"""Names in the order of their numbers; "random" is any movement that is no gesture, walking included. Right and left are the user's own."""

NO_GESTURE: Final[int] = 255
"""What truth says while a person performs no gesture."""

OWN_GESTURE: Final[int] = len(GESTURES)
"""What stands for any gesture of one's own where a name beside it says which: in sample files."""

_NAME: Final = re.compile(r"[a-z][a-z0-9_]{0,31}")
_MOST: Final = 255  # numbers of gestures are bytes, and the last one is `NO_GESTURE`


def check_label(name: str) -> str:
    """Return the name of a gesture. Raises `ConfigError` unless it is a word of small letters, digits and underscores, at most 32."""
    if not _NAME.fullmatch(name):
        raise ConfigError(f"{name!r} cannot be the name of a gesture: use small letters, digits and underscores, e.g. thumb_up, at most 32")
    return name


def vocabulary(names: Iterable[str]) -> tuple[str, ...]:
    """Put names in the order of their numbers: the ten of `GESTURES`, which never change theirs, then those of one's own as they come.

    Raises `ConfigError` when there are more than 255, or one cannot be a name.
    """
    own = dict.fromkeys(check_label(str(name)) for name in names if name not in GESTURES)
    if len(GESTURES) + len(own) > _MOST:
        raise ConfigError(f"{len(own)} gestures of one's own are too many; there is room for {_MOST - len(GESTURES)} beside the ten")
    return (*GESTURES, *own)
