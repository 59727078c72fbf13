"""Do several radars stamp by one clock? Judged by when their clouds arrive; clouds that are a whole frame apart pair without a sound."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from radar_core.config import config, knob
from radar_core.types import IndexArray

_SAMPLE = 64  # arrivals of each part that are kept, to see how finely the clock of arrival counts
_SECOND = 1e-9  # per ns


@config
class ClockConfig:
    """How the offset between the clocks of radars is looked for."""

    window: float = knob(
        10.0, unit="s", low=0.1, high=3600.0, doc="time over which the smallest delay of each radar is looked for; known after that long"
    )
    parts: int = knob(5, low=2, high=100, doc="parts of the window, whose own smallest delays say how sure that of the whole is")
    least: int = knob(3, low=1, high=1000, doc="clouds of each radar that every part must hold; fewer say nothing")


@dataclass(frozen=True)
class ClockOffset:
    """How far the clock of one radar is off that of another.

    Attributes
    ----------
    name, reference : str
        The radar, and the one it is compared with; the same for the reference itself.
    offset : float
        By how much the stamps of `name` are ahead of those of `reference` [s], up to the difference of their smallest delays.
    spread : float
        How well the smallest delays are repeated, and how finely arrivals are told [s]: `offset` is no surer than that.
    """

    name: str
    reference: str
    offset: float
    spread: float


@dataclass
class _Part:
    """Clouds of a part of the window: per radar how many and the smallest delay [ns]; arrivals of the first of all [ns]."""

    count: dict[str, int] = field(default_factory=dict)
    delay: dict[str, int] = field(default_factory=dict)
    arrivals: list[int] = field(default_factory=list)


class ClockMonitor:
    """Compares the clocks of radars by the smallest delay between stamp and arrival of their clouds.

    A cloud arrives at stamp + delay - (what its radar's clock is ahead). Transport and waiting only add to the delay, so its smallest
    value over a window is nearly constant (Cristian 1989; Paxson 1998), and what differs between two radars is the offset of their clocks,
    and the difference of their smallest delays, which cannot be told apart from it. Steps of the clock of arrival concern all radars
    alike and cancel.

    Parameters
    ----------
    names : sequence of str
        The radars; the first one that is known is what the others are compared with.
    config : ClockConfig or None
        Knobs; None: all defaults.
    """

    def __init__(self, names: Sequence[str], config: ClockConfig | None = None) -> None:
        self.config = config if config is not None else ClockConfig()
        self._names = tuple(names)
        self._part_ns = max(round(self.config.window / self.config.parts / _SECOND), 1)
        self.forget()

    def forget(self) -> None:
        """Begin anew."""
        self._parts: dict[int, _Part] = {}
        self._newest = 0

    def hear(self, name: str, stamp_ns: int, arrival_ns: int) -> None:
        """Note when a cloud arrived.

        Parameters
        ----------
        name : str
            Its radar.
        stamp_ns : int
            Its stamp, by the radar's clock [ns].
        arrival_ns : int
            When it came, by one clock for all radars [ns]; one that goes back by more than a part of the window begins anew.
        """
        number = arrival_ns // self._part_ns
        if number < self._newest - 1:
            self.forget()
        if number not in self._parts:
            self._newest = max(self._newest, number)
            self._parts = {k: part for k, part in self._parts.items() if k >= self._newest - self.config.parts}
        part, delay = self._parts.setdefault(number, _Part()), arrival_ns - stamp_ns
        part.count[name] = part.count.get(name, 0) + 1
        part.delay[name] = min(delay, part.delay.get(name, delay))
        if len(part.arrivals) < _SAMPLE:
            part.arrivals.append(arrival_ns)

    def offsets(self) -> tuple[ClockOffset, ...]:
        """Compare the clocks of the radars that all parts of the window know; empty while there are not two of them."""
        parts = [self._parts.get(self._newest - back, _Part()) for back in range(self.config.parts, 0, -1)]  # the newest is not over yet
        known = [name for name in self._names if all(part.count.get(name, 0) >= self.config.least for part in parts)]
        tick = _resolution([np.array(part.arrivals, np.int64) for part in parts])
        if len(known) < 2 or not np.isfinite(tick):
            return ()
        delays = {name: [part.delay[name] for part in parts] for name in known}
        reference, least = known[0], {name: min(delays[name]) for name in known}
        # of integers before floats: stamps count from 1970, and a double has no nanoseconds there
        spread = {name: float(np.median([delay - least[name] for delay in delays[name]])) for name in known}
        return tuple(
            ClockOffset(
                name,
                reference,
                (least[reference] - least[name]) * _SECOND,
                (tick + spread[reference] + (spread[name] if name != reference else 0.0)) * _SECOND,
            )
            for name in known
        )


def _resolution(arrivals: Sequence[IndexArray]) -> float:
    """How finely the clock of arrival counts [ns]: by how much the times between arrivals differ at least.

    Infinite where they are all alike. Clouds are never so regular by themselves; a clock that ticks with them (simulated time) looks so.
    """
    gaps = np.unique(np.concatenate([np.diff(np.sort(part)) for part in arrivals]))
    return float(np.diff(gaps).min()) if len(gaps) > 1 else np.inf
