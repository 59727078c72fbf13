"""How well a people tracker did in rooms: sums for each room, which pool over rooms, and intervals by drawing rooms anew.

Who counts is said by `radar_lab.evaluation.matching` with a gate of 0.5 m and 1 s to be found: who is hidden, or new in the field of view,
is no miss, and a track on them is no ghost.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, fields
from typing import Any, Final, Protocol

import numpy as np
from numpy.typing import NDArray
from scipy.stats import chi2

from benchmarks.report import timed
from benchmarks.room_scenes import SIGNAL, Tags
from radar_core import PointCloud, RadarInfo
from radar_core.geometry import cartesian_to_spherical
from radar_lab.evaluation.matching import Matched, Matching, MatchingConfig
from radar_sim import Truth
from radar_tracking import Tracks, TrackStatus
from radar_tracking.metrics.objects import distances

MATCHING: Final = MatchingConfig(gate=0.5, settle=1.0)
NEAR: Final = 1.0  # m: a false track so near to somebody has drifted off a person, or doubles one
LOW: Final = (SIGNAL[0], -6.0)  # dB: what counts as a low signal
_REGION: Final = float(chi2.ppf(0.9, 2))
_DRAWS: Final = 1000  # of rooms, for an interval


@dataclass(frozen=True, eq=False)
class KeptRoom:
    """A room as a tracker meets it, and what is true."""

    seed: int
    info: RadarInfo
    tags: Tags
    clouds: Sequence[PointCloud]  # in ``room``
    truths: Sequence[Truth]  # without scatterers; of the same moments
    visible: Sequence[NDArray[np.bool_]]  # who counts at each moment, shape (n_people,)
    baseband_ms: NDArray[np.float32]  # what each cloud took [ms]


class Tracker(Protocol):
    """Anything that follows people through clouds in ``room``."""

    def process(self, cloud: PointCloud) -> Tracks:
        """Take in one cloud."""
        ...


@dataclass(frozen=True, eq=False)
class RoomScore:
    """Sums over the moments of rooms; two scores add up to that of both."""

    rooms: int = 0
    moments: int = 0
    right: int = 0  # moments in which as many people are tracked as there are
    minutes: float = 0.0
    person_hours: float = 0.0  # people who count, over time
    # truths, misses: people who count, and those of them without a track, summed over the moments
    truths: int = 0
    misses: int = 0
    # false, false_near: confirmed tracks on nobody, summed over the moments; those of them within `NEAR` of somebody
    false: int = 0
    false_near: int = 0
    switches: int = 0
    ghosts: int = 0  # confirmed tracks that were never on anybody
    # error, pairs: distance on the floor of tracks on people who count [m], summed over the moments, and their number
    error: float = 0.0
    pairs: int = 0
    # covered: pairs whose person is inside the 90 % region of the track's place
    covered: int = 0
    # nis, dof: of updates of confirmed tracks on people who count
    nis: float = 0.0
    dof: int = 0
    # found, never: how often somebody came into view and got a track; and counted, but got none until out of view again
    found: int = 0
    never: int = 0
    delays: tuple[float, ...] = ()  # from coming into view to the first track on that person [s]
    times: NDArray[np.float32] = field(default_factory=lambda: np.empty(0, np.float32))  # of every cloud, the baseband's included [ms]

    def __add__(self, other: RoomScore) -> RoomScore:
        sums = {f.name: getattr(self, f.name) + getattr(other, f.name) for f in fields(self) if f.name != "times"}
        return RoomScore(**sums, times=np.concatenate([self.times, other.times]))

    def figures(self) -> dict[str, float | None]:
        """Ratios; None without anything to divide by."""

        def over(part: float, whole: float) -> float | None:
            return part / whole if whole else None

        wrong = self.misses + self.false + self.switches
        return {
            "mota": over(self.truths - wrong, self.truths),
            "count_right": over(self.right, self.moments),
            "switches_per_person_hour": over(self.switches, self.person_hours),
            "ghosts_per_minute": over(self.ghosts, self.minutes),
            "ghost_track_frames_per_minute": over(self.false, self.minutes),
            "torso_error_m": over(self.error, self.pairs),
            "nis_per_dof": over(self.nis, self.dof),
            "coverage_90": over(self.covered, self.pairs),
            "missed": over(self.misses, self.truths),
            "false": over(self.false, self.truths),
            "false_near": over(self.false_near, self.truths),
            "delay_s": float(np.median(self.delays)) if self.delays else None,
            "never_found": over(self.never, self.never + self.found),
        }


def judge(make: Callable[[RadarInfo], Tracker], rooms: Iterable[KeptRoom]) -> list[RoomScore]:
    """Run a new tracker through each room, and sum up."""
    return [judge_room(make(room.info), room) for room in rooms]


def judge_room(tracker: Tracker, room: KeptRoom) -> RoomScore:
    """Run a tracker through a room."""
    score = Scorer(room.info)
    for cloud, truth, visible, spent in zip(room.clouds, room.truths, room.visible, room.baseband_ms.tolist(), strict=True):
        tracks, took = timed(tracker.process, cloud)
        score.process(tracks, truth, visible, spent + took)
    return score.score()


class Scorer:
    """Scores a tracker in one room, moment by moment; who is visible is said by `MATCHING`'s rule."""

    def __init__(self, info: RadarInfo) -> None:
        self._matching, self._view = Matching(MATCHING), View(info)
        self._sums: dict[str, float] = {}
        self._times: list[float] = []
        self._last_ns: int | None = None

    def process(self, tracks: Tracks, truth: Truth, visible: NDArray[np.bool_], time_ms: float = 0.0) -> None:
        """Take in what a tracker made of a cloud, and the milliseconds that it took."""
        matched = self._matching.process(tracks, truth, visible)
        self._times.append(time_ms)
        since = 0.0 if self._last_ns is None else (truth.stamp_ns - self._last_ns) * 1e-9
        self._last_ns = truth.stamp_ns
        held = set(matched.step.truth_id.tolist())
        excused = self._view.process(truth, visible, held) & ~visible
        n, least = len(matched.tracks), int(visible.sum())
        false = np.isin(matched.tracks.id, matched.step.false)
        away = distances(matched.truth, matched.tracks)[:, false].min(axis=0, initial=np.inf)
        self._add(right=least <= n <= least + int(excused.sum()), false_near=int((away < NEAR).sum()), person_hours=least * since / 3600)
        self._believe(tracks, truth, matched)

    def _add(self, **parts: float) -> None:
        for name, part in parts.items():
            self._sums[name] = self._sums.get(name, 0) + part

    def _believe(self, tracks: Tracks, truth: Truth, matched: Matched) -> None:
        """Compare what tracks believe of their errors with the errors."""
        row = {number: k for k, number in enumerate(truth.person_id.tolist())}
        step = matched.step
        for person, number in zip(step.truth_id[step.visible].tolist(), step.estimate_id[step.visible].tolist(), strict=True):
            track = tracks.find(number)
            assert track is not None
            error = track.position[:2] - truth.position[row[person], :2]
            inside = bool(error @ np.linalg.solve(track.covariance[:2, :2], error) <= _REGION)
            self._add(pairs=1, covered=inside, error=float(np.hypot(*error)))
            if track.status is TrackStatus.CONFIRMED and track.dof > 0 and math.isfinite(track.nis):
                self._add(nis=track.nis, dof=track.dof)

    def score(self) -> RoomScore:
        """Sum up."""
        mot, matching = self._matching.mot, self._matching
        self._view.end()
        return RoomScore(
            rooms=1, moments=mot.moments, minutes=matching.minutes, truths=mot.truths, misses=mot.misses, false=mot.false_positives,
            switches=mot.switches, ghosts=matching.ghost_tracks, never=self._view.never, found=len(self._view.delays),
            delays=tuple(self._view.delays), times=np.array(self._times, np.float32), **self._sums,  # type: ignore[arg-type]
        )  # fmt: skip


class View:
    """Who is, or was a second ago, in the field of view, or has a track beyond it; and how long people who come into it wait for a track.

    Attributes
    ----------
    delays : list of float
        From coming into view to the first track on that person [s].
    never : int
        How often somebody came into view, counted, and left without a track.
    """

    def __init__(self, info: RadarInfo) -> None:
        self._info = info
        self.delays: list[float] = []
        self.never = 0
        self._seen: dict[int, int] = {}  # person to the last moment in view [ns]
        self._waits: dict[
            int, tuple[int, bool]
        ] = {}  # who has had no track since they came into view: since when [ns], and whether they counted
        self._inside: set[int] = set()

    def process(self, truth: Truth, visible: NDArray[np.bool_], held: set[int]) -> NDArray[np.bool_]:
        """Take in a moment, who counts, and who has a track; returns who may have one, shape (n_people,)."""
        distance, azimuth, _ = cartesian_to_spherical(self._info.mount.from_room(truth.position))
        inside = np.abs(azimuth) <= self._info.array.fov_azimuth / 2
        inside &= distance < self._info.waveform.max_range - MATCHING.margin
        now, people = truth.stamp_ns, truth.person_id.tolist()
        for person, seen, counts in zip(people, inside.tolist(), visible.tolist(), strict=True):
            if seen and person not in self._inside:
                self._waits[person] = now, False
            if seen:
                self._seen[person] = now
                self._inside.add(person)
            else:
                self._inside.discard(person)
                self._give_up(person)
            if person in self._waits:
                since, counted = self._waits[person]
                self._waits[person] = since, counted or counts
                if person in held:
                    self.delays.append((now - since) * 1e-9)
                    del self._waits[person]
        late = [now - self._seen.get(person, -math.inf) <= MATCHING.settle * 1e9 for person in people]
        return np.array([soon or person in held for person, soon in zip(people, late, strict=True)], np.bool_)

    def _give_up(self, person: int) -> None:
        waited = self._waits.pop(person, None)
        self.never += waited is not None and waited[1]

    def end(self) -> None:
        """Give up on who still waits: the room is over."""
        for person in tuple(self._waits):
            self._give_up(person)


def total(scores: Iterable[RoomScore]) -> RoomScore:
    """Pool scores."""
    return sum(scores, RoomScore())


def intervals(scores: Sequence[RoomScore], names: Sequence[str], seed: int = 0) -> dict[str, list[float] | None]:
    """Intervals (95 %) of pooled figures, by drawing as many rooms anew."""
    rng = np.random.default_rng(seed)
    columns = [f.name for f in fields(RoomScore) if f.name not in ("times", "delays")]
    sums = {name: np.array([getattr(score, name) for score in scores], np.float64) for name in columns}
    drawn = [_pooled(sums, rng.integers(0, len(scores), len(scores))).figures() for _ in range(_DRAWS)]
    found: dict[str, list[float] | None] = {}
    for name in names:
        values = [value for one in drawn if (value := one[name]) is not None]
        found[name] = [float(v) for v in np.quantile(values, (0.025, 0.975))] if values else None
    return found


def _pooled(sums: Mapping[str, NDArray[np.float64]], rows: NDArray[np.int64]) -> RoomScore:
    """Pool the rooms of some rows of the columns of scores."""
    added: dict[str, Any] = {name: column[rows].sum() for name, column in sums.items()}
    return RoomScore(**added)


def kinds(tags: Tags) -> dict[str, str]:
    """Name the kind of a room by each of its tags, for breakdowns."""

    def band(value: float, edges: tuple[float, ...], unit: str) -> str:
        low = max((edge for edge in edges[:-1] if value >= edge), default=edges[0])
        return f"{low:g} to {edges[edges.index(low) + 1]:g} {unit}"

    found = {"people": str(tags.people), "radar": tags.radar, "signal": band(tags.signal, (-12.0, -6.0, 0.0, 6.0, 12.0), "dB")}
    found["mount"] = band(tags.mount, (1.0, 1.4, 1.8, 2.2), "m")
    found["losses"] = "some" if tags.lost_chirps or tags.lost_frames else "none"
    names = ("walls", "furniture", "floor", "clutter", "fan", "curtain", "pet", "vacuum")
    found |= {name: "yes" if getattr(tags, name) else "no" for name in names}
    return found | {name: "yes" if name in tags.events else "no" for name in ("enter", "leave", "sit", "gesture", "pass", "hug")}


def breakdown(scores: Sequence[RoomScore], tags: Sequence[Tags]) -> dict[str, dict[str, dict[str, Any]]]:
    """Figures by kind of room: tag, value of the tag, figure; ``mota_interval``: of MOTA, by drawing the rooms of the kind anew."""
    groups: dict[str, dict[str, list[RoomScore]]] = {}
    for score, own in zip(scores, tags, strict=True):
        for tag, value in kinds(own).items():
            groups.setdefault(tag, {}).setdefault(value, []).append(score)

    def figures(own: Sequence[RoomScore]) -> dict[str, Any]:
        return {"rooms": len(own), **total(own).figures(), "mota_interval": intervals(own, ("mota",))["mota"]}

    return {tag: {value: figures(own) for value, own in sorted(values.items())} for tag, values in groups.items()}
