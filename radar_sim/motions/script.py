"""Timelines: what a person does at a time, and the posture of the body then."""

from __future__ import annotations

import bisect
import dataclasses
from collections.abc import Sequence

import numpy as np

from radar_core import DataError
from radar_sim.bodies.base import BONES, Posture
from radar_sim.motions.capture import Playing
from radar_sim.motions.composer import Alive, Composer, Row
from radar_sim.motions.planner import Planner, Segment
from radar_sim.own_strokes import Stroke
from radar_sim.people import Person
from radar_sim.scatterers import Float64Array


class Timeline:
    """A person's script laid out in time.

    Postures are continuous up to the acceleration, from step to step too, but for motion captures: these come in and go out softly, and
    inside are as smooth as their frames. Hands and feet are slower than 5 m/s, feet up to walks of 1.2 m/s: faster walking needs feet of
    about three times its speed.

    Parameters
    ----------
    person : Person
        Who.
    seed : int
        Of the scene; performances of gestures differ by `Person.variation`.
    radar : tuple of float
        (x, y) of what the person faces unless `Person.heading` says otherwise [m].
    strokes : sequence of Stroke
        Gestures of one's own that the script may name beside the ten.

    Attributes
    ----------
    segments : list of Segment
        One after the other, without gaps, from time 0.
    end : float
        When the script is over and the arm hangs again [s].

    Raises
    ------
    ConfigError
        When a step cannot start at its ``at``, or cannot follow the one before: nobody walks off a chair.
    DataError
        When a motion capture cannot be read.
    """

    def __init__(self, person: Person, seed: int, radar: tuple[float, float] = (0.0, 0.0), strokes: Sequence[Stroke] = ()) -> None:
        self.person = person
        self._composer = Composer(person)
        self._alive = Alive(seed, person)
        plan = Planner(person, seed, radar, self._composer, strokes)
        self.segments: list[Segment] = plan.segments
        self._starts = [s.start for s in self.segments]
        self._after = plan.body, plan.hand
        self.end = plan.time
        self._plays = any(s.kind == "play" for s in self.segments)

    def at(self, time: float) -> Segment | None:
        """Return what is being done; None: the script is over or empty."""
        row = bisect.bisect_right(self._starts, time) - 1
        return self.segments[row] if row >= 0 and time < self.segments[row].end else None

    def posture(self, times: Float64Array) -> Posture:
        """Posture of the body; before the script begins as at its start, after its end as at its end, but breathing and swaying.

        Parameters
        ----------
        times : ndarray of float64, shape (T,)
            Scene times in any order [s].

        Raises
        ------
        DataError
            When a time is not finite.
        """
        if not np.isfinite(times).all():
            raise DataError("times of a posture must be finite; NaN or infinity is among them")
        seconds = times.tolist()
        posture = self._composer.posture([self._row(time) for time in seconds])
        return self._with_captures(seconds, posture) if self._plays else posture

    def _row(self, time: float) -> Row:
        segment = self.at(max(time, 0.0))
        if segment is None:
            body, hand = self._after
        else:
            since = max(time, 0.0) - segment.start
            body, hand = segment.whole.at(since), segment.hand(since / (segment.end - segment.start))
        return self._composer.row(body, hand, self._alive.at(time))

    def _with_captures(self, times: list[float], posture: Posture) -> Posture:
        """Put motion captures' rotations in where one is played; where times are inside and outside of one, all get rotations."""
        played: list[tuple[Playing, Float64Array, list[int]]] = []  # captures, times since their start, and rows of those times
        segments = [self.at(time) for time in times]
        for segment in self.segments:
            rows = [row for row, doing in enumerate(segments) if doing is segment]
            if rows and isinstance(segment.whole, Playing):
                played.append((segment.whole, np.array([times[row] - segment.start for row in rows]), rows))
        if not played:
            return posture
        rotation = np.empty((len(times), len(BONES), 3, 3))
        standing: Float64Array | None = None
        pure = all(whole.weight(time) == 1.0 for whole, since, _ in played for time in since.tolist())
        if sum(len(rows) for _, _, rows in played) < len(times) or not pure:
            standing = self._composer.standing(posture)
            rotation[:] = standing
        for whole, since, rows in played:
            rotation[rows] = whole.rotation(since, None if standing is None else standing[rows])
        return dataclasses.replace(posture, rotation=rotation)
