"""Fusion of several radars: presence, late clouds, common description, clock offsets. `merge` combines the clouds."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Final

import numpy as np

from radar_core import ConfigError, Pose, RadarInfo
from radar_core.config import config, knob
from radar_core.types import IndexArray

_SAMPLE = 64  # arrivals of each part that are kept, to see how finely the clock of arrival counts
_SECOND = 1e-9  # per ns
_NAME = re.compile(r"[A-Za-z_]\w*(/[A-Za-z_]\w*)*", re.ASCII)
_RESTART_NS = 1_000_000_000  # a radar whose stamps go back further than this plays a recording again; nothing is delayed that long
_OPPOSED = 0.1  # resultant of unit vectors below which the radars look in no common direction


@config
class ClockConfig:
    """How clock offsets between radars are estimated."""

    window: float = knob(10.0, unit="s", low=0.1, high=3600.0, doc="time over which each radar's smallest delay is looked for")
    parts: int = knob(5, low=2, high=100, doc="parts of the window, whose own smallest delays say how sure that of the whole is")
    least: int = knob(3, low=1, high=1000, doc="clouds of each radar that every part must hold; fewer say nothing")


@dataclass(frozen=True)
class ClockOffset:
    """Offset of one radar's clock from that of another.

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

    A cloud arrives at stamp + delay - (what its radar's clock is ahead). Transport and waiting only add to the delay, so its smallest value
    over a window is nearly constant (Cristian 1989; Paxson 1998), and what differs between two radars is the offset of their clocks, and
    the difference of their smallest delays, which cannot be told apart from it. Steps of the clock of arrival concern all radars alike and
    cancel. The first of ``names`` that is known is what the others are compared with.
    """

    def __init__(self, names: Sequence[str], config: ClockConfig | None = None) -> None:
        self.config = config or ClockConfig()
        self._names = tuple(names)
        self._part_ns = max(round(self.config.window / self.config.parts / _SECOND), 1)
        self.forget()

    def forget(self) -> None:
        """Start anew."""
        self._parts: dict[int, _Part] = {}
        self._newest = 0

    def hear(self, name: str, stamp_ns: int, arrival_ns: int) -> None:
        """Note when a cloud of a radar arrived, by one clock for all radars, and its stamp, by the radar's clock [ns].

        An arrival that goes back by more than a part of the window begins anew.
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
        own = {name: spread[name] if name != reference else 0.0 for name in known}
        return tuple(
            ClockOffset(name, reference, (least[reference] - least[name]) * _SECOND, (tick + spread[reference] + own[name]) * _SECOND)
            for name in known
        )


def _resolution(arrivals: Sequence[IndexArray]) -> float:
    """How finely the clock of arrival counts [ns]: by how much the times between arrivals differ at least.

    Infinite where they are all alike. Clouds are never so regular by themselves; a clock that ticks with them (simulated time) looks so.
    """
    gaps = np.unique(np.concatenate([np.diff(np.sort(part)) for part in arrivals]))
    return float(np.diff(gaps).min()) if len(gaps) > 1 else np.inf


@config
class FusionConfig:
    """Which radars are fused, and how long clouds wait for partners."""

    radars: tuple[str, ...] = knob(("left", "right"), doc="namespaces of the radars whose clouds are fused")
    slop: float = knob(0.02, unit="s", low=1e-4, high=10.0, doc="clouds whose stamps differ by less than this belong together")
    solo_after: float = knob(0.5, unit="s", low=0.0, high=600.0, doc="a radar this (and two of its frames) behind others is not waited for")
    max_clock_offset: float = knob(0.005, unit="s", low=1e-4, high=10.0, doc="clocks farther apart are warned of: wrong clouds are paired")
    clocks: ClockConfig = ClockConfig()

    def validate(self) -> None:
        """Raise `ConfigError` when there is no radar, a namespace is none or stands twice, or nobody would be waited for at all."""
        if not self.radars:
            raise ConfigError("FusionConfig.radars is empty; name the namespaces of the radars to fuse, e.g. [left, right]")
        for name in self.radars:
            if not _NAME.fullmatch(name):
                raise ConfigError(f"FusionConfig.radars has {name!r}; a namespace is made of letters, digits and _, e.g. left")
            if self.radars.count(name) > 1:
                raise ConfigError(f"FusionConfig.radars has {name!r} twice; every radar needs a namespace of its own")
        if self.solo_after < self.slop:
            times = f"solo_after = {self.solo_after:g} s is shorter than slop = {self.slop:g} s"
            raise ConfigError(f"FusionConfig.{times}; a partner may come that late")


class RadarPresence:
    """Which of several radars are heard, judged by stamps alone: the same clouds in the same order give the same answers.

    Attributes
    ----------
    last_ns : int or None
        Stamp of the last cloud that went out [ns].
    """

    def __init__(self, config: FusionConfig) -> None:
        self._names = config.radars
        self._slop_ns = round(config.slop * 1e9)
        self._solo_ns = dict.fromkeys(config.radars, round(config.solo_after * 1e9))
        self.forget()

    def forget(self) -> None:
        """Start anew, as for another recording."""
        self._newest: dict[str, int] = {}
        self._used: dict[str, int] = {}
        self._since_ns: int | None = None
        self.last_ns: int | None = None

    def knows(self, name: str, frame_interval: float) -> None:
        """Learn how often a radar sends [s]: one is not silent before two of its frames are missing."""
        self._solo_ns[name] = max(self._solo_ns[name], round(2 * frame_interval * 1e9))

    def went_back(self, name: str, stamp_ns: int) -> bool:
        """Whether a radar's stamps went back so far that its recording must have started again."""
        return stamp_ns < self._newest.get(name, stamp_ns) - _RESTART_NS

    def late(self, name: str, stamp_ns: int) -> bool:
        """Whether a cloud is older than one that was sent already, so that a result with it would go back in time."""
        if self.last_ns is None:
            return False
        return stamp_ns + self._slop_ns <= self.last_ns or stamp_ns <= self._used.get(name, stamp_ns - 1)

    def hear(self, name: str, stamp_ns: int) -> None:
        """Note that a radar has sent a cloud with that stamp [ns]."""
        self._newest[name] = max(stamp_ns, self._newest.get(name, stamp_ns))
        if self._since_ns is None:
            self._since_ns = stamp_ns

    def present(self) -> tuple[str, ...]:
        """Radars that are not silent, in the order of the configuration; one that was never heard counts from the first cloud of any."""
        if self._since_ns is None:
            return self._names
        now = max(self._newest.values())
        return tuple(name for name in self._names if now - self._newest.get(name, self._since_ns) <= self._solo_ns[name])

    def hopeless(self, name: str, stamp_ns: int, waiting: Mapping[str, Sequence[int]]) -> bool:
        """Whether no partner can come any more for a cloud of a radar that waits; ``waiting``: stamps [ns] of all that wait, by radar."""
        now = max(self._newest.values(), default=stamp_ns)
        if self.late(name, stamp_ns) or now - stamp_ns > max(self._solo_ns.values()):
            return True
        return any(
            self._newest.get(other, stamp_ns) >= stamp_ns + self._slop_ns and not any(abs(s - stamp_ns) < self._slop_ns for s in stamps)
            for other, stamps in waiting.items()
            if other != name
        )

    def sent(self, stamps: Mapping[str, int], stamp_ns: int) -> None:
        """Note that a cloud went out: the stamps of its parts by radar, and its own [ns]."""
        self._used.update(stamps)
        self.last_ns = stamp_ns


FUSED: Final = "fused"
"""Name of what several radars seem to be together, within the namespace of their graph."""


def sensors(infos: Iterable[RadarInfo]) -> list[RadarInfo]:
    """Leave out what several radars seem to be together, where they themselves are there; in the order of their names."""
    known = sorted(infos, key=lambda info: info.frame_id)
    return [info for info in known if info.frame_id.rpartition("/")[2] != FUSED] or known


def fused_info(infos: Sequence[RadarInfo], frame_id: str = FUSED) -> RadarInfo:
    """Describe several radars, at least one, as the one that a fused cloud seems to come from.

    Fused clouds are in ``room`` already and say themselves which sensor measured what. This is for whoever asks from where people are seen
    and how often: a point amid the radars, named ``frame_id``, in their mean direction, with a field of view that holds all of theirs.
    Waveform and array are those of the radar that sees farthest, with the longest of the frame intervals: pairs come no faster.

    Raises
    ------
    ConfigError
        When there is no radar.
    """
    if not infos:
        raise ConfigError("fused_info needs the description of at least one radar")
    mounts = [info.mount for info in infos]
    x, y, z = np.mean([mount.origin for mount in mounts], axis=0)
    yaw = _mean_direction([mount.yaw for mount in mounts])
    tilt = float(np.mean([mount.tilt for mount in mounts]))
    far = max(infos, key=lambda info: info.waveform.max_range)
    azimuth = max(abs(_turn(i.mount.yaw - yaw)) + i.array.fov_azimuth / 2 for i in infos)
    elevation = max(abs(i.mount.tilt - tilt) + i.array.fov_elevation / 2 for i in infos)
    return RadarInfo(
        frame_id=frame_id,
        waveform=replace(far.waveform, frame_interval=max(info.waveform.frame_interval for info in infos)),
        array=replace(far.array, fov_azimuth=min(2 * azimuth, 2 * math.pi), fov_elevation=min(2 * elevation, math.pi)),
        mount=Pose(x=float(x), y=float(y), z=float(z), yaw=yaw, tilt=tilt),
        full_scale=far.full_scale,
    )


def _mean_direction(angles: Sequence[float]) -> float:
    """Circular mean [rad]; the first angle where they point in opposite directions."""
    c, s = float(np.mean(np.cos(angles))), float(np.mean(np.sin(angles)))
    return math.atan2(s, c) if math.hypot(c, s) > _OPPOSED else _turn(angles[0])


def _turn(angle: float) -> float:
    """Return the same direction in [-pi, pi]."""
    return math.remainder(angle, 2 * math.pi)
