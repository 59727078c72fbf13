"""One thing a person does, from when to when."""

from __future__ import annotations

from dataclasses import dataclass, field

from radar_sim.motions.carriage import Whole
from radar_sim.motions.curves import Path


@dataclass(frozen=True)
class Segment:
    """One thing a person does.

    Attributes
    ----------
    kind : str
        walk, turn, stand (stay still, standing or sitting), sit (down), rise, fidget, move (the hand, slowly), gesture, draw, reach (hold
        the hand there) or play.
    start, end : float
        Scene time [s].
    hand : Path
        Of the acting hand as if it were a right hand, from its shoulder in units of the reach, for u = 0..1 over the segment.
    whole : Whole
        What the rest of the body does.
    gesture : int or None
        Index into `GESTURES`.
    index : int
        Counts the gestures of this person.
    variant : int
        Which way of performing the gesture.
    """

    kind: str
    start: float
    end: float
    hand: Path = field(repr=False)
    whole: Whole = field(repr=False)
    gesture: int | None = None
    index: int = 0
    variant: int = 0
