"""Timelines: what a person does at a time, and the posture of the body then."""

from __future__ import annotations

import bisect
import dataclasses

import numpy as np

from radar_core import DataError
from radar_sim.bodies.base import BONES, Posture
from radar_sim.motions.alive import Alive
from radar_sim.motions.capture import Playing
from radar_sim.motions.composer import Composer, Row
from radar_sim.motions.planner import Planner
from radar_sim.motions.segment import Segment
from radar_sim.people import Person
from radar_sim.scatterers import Float64Array

__all__ = ["Segment", "Timeline"]


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

    Attributes
    ----------
    segments : list of Segment
        One after the other, without gaps, from time 0.

    Raises
    ------
    ConfigError
        When a step cannot start at its ``at``, or cannot follow the one before: nobody walks off a chair.
    DataError
        When a motion capture cannot be read.
    """

    def __init__(self, person: Person, seed: int, radar: tuple[float, float] = (0.0, 0.0)) -> None:
        self.person = person
        self._composer = Composer(person)
        self._alive = Alive(seed, person.id, person.variation.sway)
        plan = Planner(person, seed, radar, self._composer)
        self.segments: list[Segment] = plan.segments
        self._starts = [s.start for s in self.segments]
        self._after = plan.body, plan.hand
        self._end = plan.time
        self._plays = any(s.kind == "play" for s in self.segments)

    @property
    def end(self) -> float:
        """When the script is over and the arm hangs again [s]."""
        return self._end

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
        playing: dict[int, list[int]] = {}
        for row, time in enumerate(times):
            number = bisect.bisect_right(self._starts, time) - 1
            if number >= 0 and time < self.segments[number].end and isinstance(self.segments[number].whole, Playing):
                playing.setdefault(number, []).append(row)
        if not playing:
            return posture
        rotation = np.empty((len(times), len(BONES), 3, 3))
        standing: Float64Array | None = None
        if sum(map(len, playing.values())) < len(times) or not all(self._pure(number, times, rows) for number, rows in playing.items()):
            standing = self._composer.standing(posture)
            rotation[:] = standing
        for number, rows in playing.items():
            start, whole = self.segments[number].start, self.segments[number].whole
            assert isinstance(whole, Playing)
            rotation[rows] = whole.rotation(np.array([times[row] - start for row in rows]), None if standing is None else standing[rows])
        return dataclasses.replace(posture, rotation=rotation)

    def _pure(self, number: int, times: list[float], rows: list[int]) -> bool:
        """Whether a capture alone says what the body does at some times."""
        start, whole = self.segments[number].start, self.segments[number].whole
        return isinstance(whole, Playing) and all(whole.weight(times[row] - start) == 1.0 for row in rows)
