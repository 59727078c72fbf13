"""When gestures count: always, for a while after a gesture that wakes, or only after a rest."""

from __future__ import annotations

import dataclasses
from collections import deque
from collections.abc import Collection, Sequence
from typing import Final, Literal

from radar_core import ConfigError
from radar_core.config import config, knob, nearest
from radar_gestures.gesture import RANDOM, Gesture

_RUNS: Final = 64  # motions that are remembered of a person: more than an event can hold


@config
class ActivationConfig:
    """When a gesture counts; one that does not is random."""

    mode: Literal["always", "wake", "dwell"] = knob(
        "always", doc="when gestures count: always; wake: for a while after the gesture that wakes; dwell: after a rest"
    )
    wake: str = knob("wave", doc="with wake: the gesture that wakes; one of the model's")
    window: float = knob(6.0, unit="s", low=0.1, high=3600.0, doc="with wake: how long after it, and after every further gesture")
    rest: float = knob(
        1.0, unit="s", low=0.0, high=60.0, doc="with dwell: for how long nothing may have been fast enough to begin a gesture"
    )


class Rests:
    """How long somebody rested before each of their motions.

    Parameters
    ----------
    bridge_ns : int
        Longest pause within one motion [ns].
    """

    def __init__(self, bridge_ns: int) -> None:
        self._bridge_ns = bridge_ns
        self._runs: deque[tuple[int, int, int]] = deque(maxlen=_RUNS)  # begin, end, rest before
        self._rest_since: int | None = None

    def process(self, stamp_ns: int, moving: bool) -> None:
        """Take whether somebody moves at ``stamp_ns`` [ns]; stamps grow, see `clear`."""
        if self._rest_since is None:
            self._rest_since = stamp_ns
        if not moving:
            return
        rested = stamp_ns - self._rest_since
        if self._runs and rested <= self._bridge_ns:
            begin, _, before = self._runs.pop()
            self._runs.append((begin, stamp_ns, before))
        else:
            self._runs.append((stamp_ns, stamp_ns, rested))
        self._rest_since = stamp_ns

    def before(self, stamp_ns: int) -> int:
        """Give the rest [ns] before the motion that goes on at ``stamp_ns`` [ns], or that is the first one after it; 0 without one."""
        return next((rested for _, end, rested in self._runs if end >= stamp_ns), 0)

    def clear(self) -> None:
        """Forget everything: time jumped."""
        self._runs.clear()
        self._rest_since = None


class Activation:
    """Lets gestures count, or makes them random.

    Parameters
    ----------
    config : ActivationConfig
        Knobs.
    labels : sequence of str
        What gestures are called; ``config.wake`` is one of them, unless nothing has to wake.

    Raises
    ------
    ConfigError
        When nobody can make the gesture that wakes.
    """

    def __init__(self, config: ActivationConfig, labels: Sequence[str]) -> None:
        known = [label for k, label in enumerate(labels) if k != RANDOM]
        if config.mode == "wake" and config.wake not in known:
            raise ConfigError(
                f"activation.wake: the model knows no gesture {config.wake!r}{nearest(config.wake, known)}; it knows {', '.join(known)}"
            )
        self._config, self._random = config, labels[RANDOM]
        self._window_ns, self._rest_ns = round(config.window * 1e9), round(config.rest * 1e9)
        self._until: dict[int, int] = {}

    def awake(self, stamp_ns: int) -> tuple[int, ...]:
        """Tracks whose gestures count at ``stamp_ns`` [ns] because they woke it; of no use but with ``wake``."""
        return tuple(track for track, until in self._until.items() if until >= stamp_ns)

    def process(self, gesture: Gesture, rested_ns: int) -> Gesture:
        """Return a gesture as it is where it counts, else as a random one with the same probabilities.

        Parameters
        ----------
        gesture : Gesture
            The next one of its track.
        rested_ns : int
            How long the person rested before it [ns].
        """
        if gesture.label == RANDOM or self._counts(gesture, rested_ns):
            return gesture
        return dataclasses.replace(gesture, label=RANDOM, name=self._random, confidence=float(gesture.probabilities[RANDOM]))

    def keep(self, track_ids: Collection[int]) -> None:
        """Forget who is not among these any more."""
        self._until = {track: until for track, until in self._until.items() if track in track_ids}

    def _counts(self, gesture: Gesture, rested_ns: int) -> bool:
        if self._config.mode == "dwell":
            return rested_ns >= self._rest_ns
        if self._config.mode == "wake":
            if gesture.name != self._config.wake and gesture.start_ns > self._until.get(gesture.track_id, gesture.start_ns - 1):
                return False
            self._until[gesture.track_id] = gesture.end_ns + self._window_ns
        return True
