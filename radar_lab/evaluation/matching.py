"""Which track is of which person: the visibility rule and the matching that every evaluation uses, and ghosts."""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass
from typing import Final

import numpy as np

from radar_core import RadarInfo
from radar_core.config import config, knob
from radar_core.geometry import cartesian_to_spherical
from radar_core.types import BoolArray, IndexArray
from radar_sim.truth import Truth
from radar_tracking import Tracks, TrackStatus
from radar_tracking.metrics import (
    ClearMot,
    ClearMotConfig,
    ClearMotStep,
    ClearMotSummary,
    Gospa,
    GospaConfig,
    GospaMetric,
    GospaSummary,
    ObjectSet,
    people,
)

_LASTED_NS: Final = 500_000_000  # ns: tentative tracks that end sooner have no gestures


@config
class MatchingConfig:
    """Who counts, and when a track is of a person."""

    # Wider than that of the tracking benchmark (0.5 m): a gesturing hand drags a track by half a metre, and its gestures stay its person's.
    gate: float = knob(
        0.8, unit="m", low=1e-6, high=1e6, doc="a track this near to a person on the ground, or nearer, can be of that person"
    )
    settle: float = knob(1.0, unit="s", low=0.0, high=60.0, doc="a person counts when in view for this long: time to be found")
    least_rcs: float = knob(
        0.02, unit="m^2", low=0.0, high=1e6, doc="who shows the radar less is hidden; a tenth of what a person shows from the front"
    )
    margin: float = knob(0.2, unit="m", low=0.0, high=1e6, doc="width of the last range bins, which see a person only in part")
    gospa: GospaConfig = GospaConfig()


class Visibility:
    """The visibility rule: who can be seen, and so counts.

    A person is visible who is in the radar's azimuth field of view and nearer than its unambiguous range less ``margin``, has been so for
    ``settle``, and shows the radar at least ``least_rcs``. The last is not asked where the truth does not say what the radar sees.
    """

    def __init__(self, info: RadarInfo, config: MatchingConfig | None = None) -> None:
        self._info, self.config = info, config or MatchingConfig()
        self._settle_ns = round(self.config.settle * 1e9)
        self._since_ns: dict[int, int] = {}

    def process(self, truth: Truth) -> BoolArray:
        """Say who is visible at a moment, shape (n_people,); moments come in the order of time."""
        distance, azimuth, _ = cartesian_to_spherical(self._info.mount.from_room(truth.position))
        inside = np.abs(azimuth) <= self._info.array.fov_azimuth / 2
        inside &= distance < self._info.waveform.max_range - self.config.margin
        numbers = np.asarray(truth.person_id).tolist()
        self._since_ns = {n: self._since_ns.get(n, truth.stamp_ns) for n, seen in zip(numbers, inside, strict=True) if seen}
        settled = [truth.stamp_ns - self._since_ns.get(n, math.inf) >= self._settle_ns for n in numbers]
        return np.array(settled, np.bool_) & self._shown(truth)

    def _shown(self, truth: Truth) -> BoolArray:
        if not len(truth.scatterer_rcs):
            return np.ones(len(truth.person_id), np.bool_)
        own = truth.scatterer_owner >= 0
        shown = np.bincount(truth.scatterer_owner[own], truth.scatterer_rcs[own].astype(np.float64), len(truth.person_id))
        return np.asarray(shown >= self.config.least_rcs)


def without_scatterers(truth: Truth) -> Truth:
    """Leave out what the radar sees, which is large; `Visibility` has to be asked before."""
    nothing = np.empty(0, np.float32)
    return dataclasses.replace(
        truth, scatterer_position=np.empty((0, 3), np.float32), scatterer_owner=np.empty(0, np.int32), scatterer_rcs=nothing
    )


@dataclass(frozen=True, eq=False)
class Matched:
    """One moment: people (``visible``: who counts) and confirmed tracks on the ground, their pairs (``false``: the ghosts), and GOSPA."""

    truth: ObjectSet
    tracks: ObjectSet
    step: ClearMotStep
    gospa: Gospa


class Matching:
    """Pair tracks with people moment by moment, by CLEAR-MOT on the ground, and count ghosts.

    A **ghost** is a confirmed (or coasting) track in a moment in which it is paired with nobody: every such track-frame counts, whatever
    the track does before or after. People who are not visible neither hit nor make ghosts: a track on one of them is excused.

    Parameters
    ----------
    config : MatchingConfig or None
        None: all defaults; ``gate`` is the radius of the matching.

    Attributes
    ----------
    moments, track_frames, ghost_track_frames : int
        Moments so far; confirmed tracks summed over them; those of them that were ghosts.
    """

    def __init__(self, config: MatchingConfig | None = None) -> None:
        self.config = config or MatchingConfig()
        self._mot, self._gospa = ClearMot(ClearMotConfig(radius=self.config.gate)), GospaMetric(self.config.gospa)
        self._runs: dict[int, list[tuple[int, int, int]]] = {}  # of each track: person, first and last moment [ns]
        self._early: dict[int, list[tuple[int, int, int]]] = {}  # the same of tentative tracks, who are the only one of their person
        self._alone: set[int] = set()
        self.moments = self.track_frames = self.ghost_track_frames = 0
        self._span_ns: tuple[int, int] | None = None

    def process(self, tracks: Tracks, truth: Truth, visible: BoolArray) -> Matched:
        """Take in one moment; moments come in the order of time.

        Who counts is said by `Visibility`, shape (n_people,). Raises `DataError` when a place is not finite or an identity occurs twice;
        the moment is left out.
        """
        found = people(tracks)
        real = ObjectSet.of(truth.position[:, :2], truth.person_id, visible)
        step = self._mot.process(real, found)
        first, before = self._span_ns or (truth.stamp_ns, truth.stamp_ns)
        for person, track in zip(step.truth_id.tolist(), step.estimate_id.tolist(), strict=True):
            _prolong(self._runs.setdefault(track, []), person, before, truth.stamp_ns)
        self._begin(tracks, real, step.truth_id, before, truth.stamp_ns)
        self._alone.update(step.false.tolist())
        self.moments += 1
        self.track_frames += len(found)
        self.ghost_track_frames += len(step.false)
        self._span_ns = (first, truth.stamp_ns)
        return Matched(real, found, step, self._gospa.process(real, found))

    def _begin(self, tracks: Tracks, real: ObjectSet, paired: IndexArray, before_ns: int, stamp_ns: int) -> None:
        """Remember on whom tentative tracks are: the nearest one, if that person has no track. What soon ends again is forgotten."""
        free = ~np.isin(real.id, paired)
        for track in tracks.tracks:
            if track.status != TrackStatus.TENTATIVE or not free.any():
                continue
            away = np.hypot(*(real.position[free] - track.position[:2]).T)
            if away.min() <= self.config.gate:
                person = int(real.id[free][away.argmin()])
                _prolong(self._early.setdefault(track.id, []), person, before_ns, stamp_ns)
        alive = {track.id for track in tracks.tracks}
        self._early = {n: runs for n, runs in self._early.items() if n in alive or runs[-1][2] - runs[0][1] >= _LASTED_NS}

    def owner(self, track: int, start_ns: int, end_ns: int) -> int | None:
        """Say whose a track was during some time: the person with whom it was paired the longest; None: it was a ghost all the time.

        While it was tentative: the person that it was nearest to, of those who had no track.
        """
        for runs in (self._runs, self._early):
            time: dict[int, int] = {}
            for person, first, last in runs.get(track, []):
                if last >= start_ns and first <= end_ns:
                    time[person] = time.get(person, 0) + min(last, end_ns) - max(first, start_ns)
            if time:
                return max(time, key=lambda person: time[person])
        return None

    def last_owner(self, track: int) -> int | None:
        """Say who a track was on last; None: on nobody ever."""
        runs = self._runs.get(track) or self._early.get(track)
        return runs[-1][0] if runs else None

    @property
    def mot(self) -> ClearMotSummary:
        """CLEAR-MOT of all moments so far; its false positives are the ghosts."""
        return self._mot.summary()

    @property
    def gospa(self) -> GospaSummary:
        """GOSPA of all moments so far."""
        return self._gospa.summary()

    @property
    def ghost_tracks(self) -> int:
        """Identities that were on nobody ever; prefer track-frames: a ghost that hits a person later is not among these."""
        return len(self._alone - self._runs.keys())

    @property
    def minutes(self) -> float:
        """Length of the run, the last moment included [min]."""
        first, last = self._span_ns or (0, 0)
        return (last - first) * self.moments / max(self.moments - 1, 1) / 60e9


def _prolong(runs: list[tuple[int, int, int]], person: int, before_ns: int, stamp_ns: int) -> None:
    """Remember who a track is on, as runs of equal pairs without a gap, so that long sessions stay small."""
    if runs and runs[-1][0] == person and runs[-1][2] == before_ns:
        runs[-1] = (person, runs[-1][1], stamp_ns)
    else:
        runs.append((person, stamp_ns, stamp_ns))
