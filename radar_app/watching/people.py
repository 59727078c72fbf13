"""Who comes, who goes, and what of it is said in words."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import handwave.msg

from radar_ros.messages.convert import from_time


def is_person(track: Any) -> bool:
    """Whether a track counts as a person: tentative ones do not yet."""
    return bool(track.status != handwave.msg.Track.TENTATIVE)


def is_gesture(msg: Any) -> bool:
    """Whether it is a gesture rather than some other movement."""
    return bool(msg.label != handwave.msg.Gesture.RANDOM)


@dataclass(frozen=True)
class Coming:
    """That a person came or went.

    Attributes
    ----------
    stamp_ns : int
        Of the tracks that told it [ns].
    person : int
        Number of the track.
    came : bool
        False: it went.
    position : sequence of float
        Last place in the room, x forward, y left, z up [m].
    """

    stamp_ns: int
    person: int
    came: bool
    position: Sequence[float]

    @property
    def words(self) -> str:
        """What a person reads."""
        return f"person {self.person} {'came' if self.came else 'went'}, {place(self.position)}"


class Comings:
    """Find out from one message of tracks after the other who came and who went."""

    def __init__(self) -> None:
        self._there: dict[int, tuple[float, ...]] = {}

    def process(self, msg: Any) -> list[Coming]:
        """Take a ``TrackArray``."""
        stamp = from_time(msg.header.stamp)
        now = {int(track.id): tuple(float(x) for x in track.position) for track in msg.tracks if is_person(track)}
        before, self._there = self._there, now
        return [
            *(Coming(stamp, person, False, place) for person, place in before.items() if person not in now),
            *(Coming(stamp, person, True, place) for person, place in now.items() if person not in before),
        ]


def place(position: Sequence[float]) -> str:
    """Say where in the room: ``2.3 m ahead, 0.4 m left``, as the radar looks."""
    x, y = position[0], position[1]
    if not (math.isfinite(x) and math.isfinite(y)):
        return "place unknown"
    ahead = f"{x:.1f} m ahead" if x >= 0 else f"{-x:.1f} m behind"
    side = "" if abs(y) < 0.05 else f", {abs(y):.1f} m {'left' if y > 0 else 'right'}"
    return ahead + side


def gesture_words(msg: Any) -> str:
    """Say who did which gesture: ``person 3: swipe left (97 %)``."""
    where = f", in {' and '.join(msg.zones)}" if msg.zones else ""
    return f"person {msg.track_id}: {msg.name.replace('_', ' ')} ({msg.confidence:.0%}){where}"


def finite(value: Any) -> Any:
    """Make a value what JSON has: numbers rounded to six places, no number as None, arrays as lists."""
    if isinstance(value, bool | str) or value is None:
        return value
    if isinstance(value, int):
        return int(value)
    if isinstance(value, float):
        return round(value, 6) if math.isfinite(value) else None
    if isinstance(value, Mapping):
        return {key: finite(entry) for key, entry in value.items()}
    return [finite(entry) for entry in (value.tolist() if hasattr(value, "tolist") else value)]
