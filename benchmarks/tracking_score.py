"""How well a tracker did on one scene with truth: sums that pool over scenes, and why what went wrong did."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from benchmarks.scenarios import MATCHING, Moment
from radar_core import RadarInfo
from radar_core.geometry import cartesian_to_spherical
from radar_lab.evaluation.matching import Matching
from radar_tracking import Tracks
from radar_tracking.metrics import ClearMotStep
from radar_tracking.metrics.objects import distances

Float64Array = NDArray[np.float64]

NEAR = 1.0  # m: a false track this near to somebody has drifted off a person, or doubles one; farther ones come from nothing
_WINDOW = 0.5  # s: a switch is looked at this long before and after, and an identity is remembered this long
_FRESH = 1.0  # s: who has been visible for less may be missed because tracks are confirmed late
_TOGETHER, _APART = 0.9, 1.2  # m: approach-and-return: two have met; they have not yet
_SETTLED = 5.0  # s: sitting: the chair is reached
_LIFETIME = {"approach": (0, 1), "sitting": (0,)}  # rows of the people whose identity must live through the scene


@dataclass(frozen=True, eq=False)
class Score:
    """Sums over clouds; two scores add up to the score of both."""

    # scenes, clouds, truths, matches, misses, switches: counts; people and matches: of visible ones, summed over the clouds
    scenes: float = 0.0
    clouds: float = 0.0
    seconds: float = 0.0  # of the scenes [s]
    truths: float = 0.0
    matches: float = 0.0
    misses: float = 0.0
    false: float = 0.0  # ghosts: confirmed track-frames without a person within the gate, see `Matching`
    switches: float = 0.0
    # gospa, error: sums of GOSPA over the clouds and of the plane distances of the matches [m]
    gospa: float = 0.0
    error: float = 0.0
    ghosts: float = 0.0  # confirmed tracks that were never on anybody; a ghost that hits a person later is not among them
    # wrong, owned: points of somebody that carry another person's track; that carry any track
    wrong: float = 0.0
    owned: float = 0.0
    # misses_start, misses_return: misses in the first second that the person was ever visible; in the first second after being hidden
    misses_start: float = 0.0
    misses_return: float = 0.0
    false_near: float = 0.0  # false tracks within `NEAR` of somebody
    resolvable: float = 0.0  # switches around which the radar could tell the two apart all the time; see `apart`
    lost: float = 0.0  # scenes in which somebody's identity did not live through the approach, or through sitting
    times: NDArray[np.float32] = field(default_factory=lambda: np.empty(0, np.float32))  # milliseconds of every cloud

    def __add__(self, other: Score) -> Score:
        names = [f.name for f in dataclasses.fields(self) if f.name != "times"]
        sums = {name: getattr(self, name) + getattr(other, name) for name in names}
        return Score(**sums, times=np.concatenate([self.times, other.times]))

    @property
    def mota(self) -> float:
        """CLEAR-MOT accuracy; 1 is perfect, NaN without people."""
        return 1 - (self.misses + self.false + self.switches) / self.truths if self.truths else float("nan")

    @property
    def mean_gospa(self) -> float:
        """Mean of GOSPA over the clouds [m]."""
        return self.gospa / max(self.clouds, 1)

    @property
    def torso_error(self) -> float:
        """Mean distance of tracks from the bodies' centres on the floor plane [m]; NaN without matches."""
        return self.error / self.matches if self.matches else float("nan")

    @property
    def wrong_fraction(self) -> float:
        """Share of people's tracked points that carry another person's track; NaN where owners are not known."""
        return self.wrong / self.owned if self.owned else float("nan")

    @property
    def ghosts_per_minute(self) -> float:
        """Tracks that were never on anybody, per minute of scene."""
        return 60 * self.ghosts / self.seconds if self.seconds else float("nan")

    @property
    def ghost_track_frames_per_minute(self) -> float:
        """Confirmed track-frames without a person within the gate, per minute of scene."""
        return 60 * self.false / self.seconds if self.seconds else float("nan")


def total(scores: Sequence[Score]) -> Score:
    """Pool scores."""
    return sum(scores, Score())


class Scorer:
    """Scores one tracker on one scene of `scenarios.SCENARIOS`, some of which have questions of their own, cloud by cloud."""

    def __init__(self, name: str, info: RadarInfo) -> None:
        self._name, self._info = name, info
        self._matching = Matching(MATCHING)
        self._steps: list[ClearMotStep] = []
        self._times: list[float] = []
        self._person: dict[int, int] = {}  # of each track, who it was last on
        self._wrong = self._owned = self._near = 0

    def process(self, moment: Moment, tracks: Tracks, time_ms: float) -> ClearMotStep:
        """Take in what a tracker made of a cloud."""
        matched = self._matching.process(tracks, moment.truth, moment.visible)
        step = matched.step
        self._steps.append(step)
        self._times.append(time_ms)
        false = np.isin(matched.tracks.id, step.false)
        self._near += int(np.count_nonzero(distances(matched.truth, matched.tracks)[:, false].min(axis=0, initial=np.inf) < NEAR))
        self._person |= dict(zip(step.estimate_id.tolist(), step.truth_id.tolist(), strict=True))
        self._count_points(moment, tracks)
        return step

    def _count_points(self, moment: Moment, tracks: Tracks) -> None:
        """Count people's points that carry a track, and those whose track is on somebody else."""
        own = (moment.owner >= 0) & (tracks.point_track_id >= 0)
        holder = np.array([self._person.get(int(track), -1) for track in tracks.point_track_id[own]], np.int64)
        self._owned += int(own.sum())
        self._wrong += int(np.count_nonzero((holder >= 0) & (holder != moment.truth.person_id[moment.owner[own]])))

    def score(self, moments: Sequence[Moment]) -> Score:
        """Sum up; ``moments`` are those that were processed, in their order."""
        matching, mot = self._matching, self._matching.mot
        stamps = np.array([m.truth.stamp_ns for m in moments], np.float64) * 1e-9
        start, back = fresh_misses(self._steps, moments, stamps)
        return Score(
            scenes=1,
            clouds=mot.moments,
            seconds=60 * matching.minutes,
            truths=mot.truths,
            matches=mot.matches,
            misses=mot.misses,
            false=matching.ghost_track_frames,
            switches=mot.switches,
            gospa=matching.gospa.mean * mot.moments,
            error=mot.motp * mot.matches if mot.matches else 0.0,
            ghosts=matching.ghost_tracks,
            wrong=self._wrong,
            owned=self._owned,
            misses_start=start,
            misses_return=back,
            false_near=self._near,
            resolvable=resolvable(self._steps, moments, stamps, self._info),
            lost=float(lost(self._name, self._steps, moments, stamps)),
            times=np.array(self._times, np.float32),
        )


def fresh_misses(steps: Sequence[ClearMotStep], moments: Sequence[Moment], stamps: Float64Array) -> tuple[int, int]:
    """Misses within a second of the first moment that somebody was visible, and of a later end of being hidden."""
    first: dict[int, float] = {}
    since: dict[int, float] = {}
    start = back = 0
    for step, moment, now in zip(steps, moments, stamps.tolist(), strict=True):
        seen = set(moment.truth.person_id[moment.visible].tolist())
        since = {person: since.get(person, now) for person in seen}
        for person in seen:
            first.setdefault(person, now)
        for person in step.missed.tolist():
            fresh = now - first[person] < _FRESH
            start += fresh
            back += not fresh and now - since[person] < _FRESH
    return start, back


def seen_by(moments: Sequence[Moment], info: RadarInfo) -> tuple[Float64Array, Float64Array, Float64Array]:
    """Range [m], azimuth [rad] and range rate [m/s] of everybody's body centre at all moments, shapes (n_moments, n_people)."""
    place = np.stack([m.truth.position for m in moments])
    motion = np.stack([m.truth.velocity for m in moments])
    away = place - info.mount.origin
    distance, azimuth, _ = cartesian_to_spherical(info.mount.from_room(place))
    rate = (away * motion).sum(axis=-1) / np.maximum(np.linalg.norm(away, axis=-1), 1e-9)
    return np.asarray(distance, np.float64), np.asarray(azimuth, np.float64), rate


def apart(moments: Sequence[Moment], info: RadarInfo, one: int, other: int) -> NDArray[np.bool_]:
    """Whether two people (rows) differ by more than a range bin, a beamwidth (0.886 wavelengths over the array) or a Doppler bin."""
    distance, azimuth, rate = seen_by(moments, info)
    width = float(np.ptp(info.array.virtual[:, 0]))
    beam = 0.886 * info.waveform.wavelength / width if width else np.inf
    bins = ((distance, info.waveform.range_resolution), (azimuth, beam), (rate, info.waveform.speed_resolution))
    return np.asarray(np.any([np.abs(value[:, one] - value[:, other]) > bound for value, bound in bins], axis=0))


def resolvable(steps: Sequence[ClearMotStep], moments: Sequence[Moment], stamps: Float64Array, info: RadarInfo) -> int:
    """Count switches within half a second of which the person and the nearest other one were `apart` all the time."""
    count = 0
    for k, step in enumerate(steps):
        for person in step.switched.tolist():
            truth = moments[k].truth
            row = int(np.flatnonzero(truth.person_id == person)[0])
            away = np.hypot(*(truth.position[:, :2] - truth.position[row, :2]).T)
            away[row] = np.inf
            other = int(away.argmin())
            around = [m for m, stamp in zip(moments, stamps, strict=True) if abs(stamp - stamps[k]) <= _WINDOW]
            alone = other == row
            count += alone or bool(apart(around, info, row, other).all())
    return count


def identity(steps: Sequence[ClearMotStep], stamps: Float64Array, person: int, at: int) -> int | None:
    """Track that a person last had, at most half a second before a moment; None: none."""
    for k in range(at, -1, -1):
        if stamps[at] - stamps[k] > _WINDOW:
            break
        found = steps[k].estimate_id[steps[k].truth_id == person]
        if len(found):
            return int(found[0])
    return None


def lost(name: str, steps: Sequence[ClearMotStep], moments: Sequence[Moment], stamps: Float64Array) -> bool:
    """Whether somebody has another identity at the end than before two met, or than when they sat down; or none."""
    if name not in _LIFETIME:
        return False
    if name == "approach":
        place = np.stack([m.truth.position[:, :2] for m in moments])
        between = np.hypot(*np.moveaxis(place[:, 0] - place[:, 1], -1, 0))
        met = np.flatnonzero(between < _TOGETHER)
        before = np.flatnonzero(between[: met[0]] >= _APART) if len(met) else met
    else:
        before = np.flatnonzero(stamps - stamps[0] <= _SETTLED)
    if not len(before):
        return False
    for row in _LIFETIME[name]:
        person = int(moments[0].truth.person_id[row])
        then, now = (identity(steps, stamps, person, at) for at in (int(before[-1]), len(steps) - 1))
        if then is None or then != now:
            return True
    return False
