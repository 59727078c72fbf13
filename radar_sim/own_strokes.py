"""Strokes of one's own: gestures beside the ten, as paths of the hand that a file describes."""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from pathlib import Path
from typing import Any

import numpy as np

from radar_core import GESTURES, ConfigError, check_label
from radar_core.config import config, knob, load_file
from radar_core.paths import find_config
from radar_sim.motions.curves import ARM, Vector, cruise
from radar_sim.motions.curves import Path as HandPath

_LEAST = 0.02  # of the reach: places nearer than that to the one before make a path of no direction
_BESIDE: ContextVar[Path | None] = ContextVar("folder of the scene file that is being read", default=None)


@config
class Stroke:
    """A gesture of one's own: places that a right hand goes through, from rest to rest.

    Places are (forward, left, up) from the shoulder in units of the arm's reach (to the middle of the hand, about 0.62 m).
    The way between them is a smooth curve. A left arm mirrors it.
    """

    name: str = knob(doc="what the gesture is called: small letters, digits and underscores")
    places: tuple[tuple[float, float, float], ...] = knob(low=-1.0, high=1.0, doc="(forward, left, up) of the hand, in turn")
    duration: float = knob(0.9, unit="s", low=0.2, high=10.0, doc="how long the stroke usually takes")
    both: bool = knob(False, doc="the other hand does the same, mirrored, as in a clap")
    edge: float = knob(0.25, low=0.05, high=0.5, doc="share of the time in which the hand speeds up, and again slows down")

    def validate(self) -> None:
        """Raise `ConfigError` when the name is taken or none, or the places are no path that an arm can follow."""
        if check_label(self.name) in GESTURES:
            raise ConfigError(f"Stroke.name: {self.name} is one of the ten; choose another name")
        if len(self.places) < 2:
            raise ConfigError(f"Stroke.places of {self.name}: {len(self.places)} is too few; give at least two places")
        for number, (place, after) in enumerate(zip(self.places, (*self.places[1:], None), strict=True), 1):
            if math.hypot(*place) > ARM:
                raise ConfigError(
                    f"Stroke.places of {self.name}: place {number} is {math.hypot(*place):.2f} of the reach away; {ARM} is most"
                )
            if after is not None and math.dist(place, after) < _LEAST:
                raise ConfigError(f"Stroke.places of {self.name}: places {number} and {number + 1} are the same; leave one out")

    def path(self) -> HandPath:
        """Return the hand's way, from the share of the time, 0..1, to a place; a cubic spline through the places, at rest at both ends."""
        from scipy.interpolate import CubicSpline  # only strokes of one's own need it

        places = np.array(self.places, np.float64)
        way = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(places, axis=0), axis=1))])
        spline = CubicSpline(way, places)

        def place(u: float) -> Vector:
            x, y, z = spline(float(way[-1]) * cruise(u, self.edge)[0]).tolist()
            return (x, y, z)

        return place


def load_stroke(name: str | Path) -> Stroke:
    """Load a stroke file, or one of ours by its bare name (``circle``, ``clap``); a relative path in a scene file is beside that file.

    Raises
    ------
    ConfigError
        Naming file, line and key.
    """
    folder = _BESIDE.get()
    beside = None if folder is None else folder / name
    return load_file(Stroke, beside if beside is not None and beside.is_file() else find_config(name, "strokes", ".yaml"))


@contextmanager
def beside(folder: Path) -> Iterator[None]:
    """Look for stroke files in a folder first, while a scene file that lies there is read."""
    token = _BESIDE.set(folder)
    try:
        yield
    finally:
        _BESIDE.reset(token)


def named(value: Any) -> Any:
    """Read the files of strokes that a scene names; what describes a stroke itself stays."""
    return [load_stroke(entry) if isinstance(entry, str) else entry for entry in value] if isinstance(value, (list, tuple)) else value
