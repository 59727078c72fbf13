"""Two people approach each other, stay, and part again (thesis, figure 6.2): which tracker merges them, and why identities are lost.

Every approach is simulated once. Its frames go through several basebands, and the clouds of each through the thesis's trackers and the
default one. While two people are near, a cloud is *merged* when one track carries points of both and no other track has any. Whose a
point is follows from the power that each person alone would have in its cell of the range-Doppler map. A person without a point in a cloud
is *absent*: no tracker can see who has no point. So identities that are lost because two people are merged are told apart from those that
are lost for want of points.
"""

from __future__ import annotations

import functools
import math
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from benchmarks.report import share
from benchmarks.scenarios import MATCHING, MOUNT, Moment, Place, Random, person, scenario, stand, walk
from benchmarks.stores import once, sources
from benchmarks.tracking_score import identity
from benchmarks.tracking_suite import THESIS, TRACKERS, Tracker, make, over
from radar_core import ConfigError, PointCloud, RadarInfo
from radar_core.config import load, load_file, nest, plain
from radar_core.geometry import cartesian_to_spherical
from radar_core.paths import find_config
from radar_dsp import Baseband, BasebandConfig
from radar_dsp.config import SpectrumConfig
from radar_dsp.spectrum import make_spectrum
from radar_lab.evaluation.matching import Matching, Visibility, without_scatterers
from radar_sim import Simulator, Truth
from radar_sim.people import Person
from radar_sim.scene import Scene
from radar_tracking import TrackerConfig, Tracks
from radar_tracking.metrics import ClearMotStep

BoolArray = NDArray[np.bool_]
Float64Array = NDArray[np.float64]

NEAR, APART = 0.9, 1.2  # m: two are near each other; they have not met yet
MERGED: Final = 0.5  # share of the clouds in which two are near: an approach in which so many are merged is a merged one
HALF: Final = 0.5  # share of the clouds without points of a lost track that were merged, or absent: why it was lost
FIRST: Final[Mapping[str, int]] = {"develop": 1000, "figure": 2000, "choose": 3000}  # seed of the first approach
APPROACHES, OTHERS = 20, 8  # side by side; of each other way to meet
_QUICK: Final = 3.0  # s
_CODE: Final = ("radar_core", "radar_dsp", "radar_sim", "radar_tracking", "radar_lab/evaluation", "benchmarks/approaches.py",
                "benchmarks/scenarios.py", "benchmarks/tracking_score.py", "benchmarks/tracking_suite.py")  # fmt: skip
KINDS: Final = ("kept", "swapped", "lost_merged", "lost_absent", "lost_other", "not_found")
"""What becomes of the two identities: both kept; exchanged; one ended while both people were in the other's track; while its person had no
point; for another reason; or somebody had none before they met."""

_PEOPLE: Final = load_file(BasebandConfig, find_config("people", "baseband", ".yaml"))
BASEBANDS: Final[Mapping[str, BasebandConfig]] = {
    "maxima": BasebandConfig(),
    "every_cell": replace(BasebandConfig(), grouping="none"),
    "two_directions": _PEOPLE,
    "every_cell_two_directions": replace(_PEOPLE, grouping="none"),
    "every_cell_moving": replace(BasebandConfig(), grouping="none", spectrum=SpectrumConfig(static="remove")),
}
"""One direction in a cell and only maxima along range, which is the default; every cell above the threshold, as in the thesis (2.4); maxima
with two directions in a cell, the preset for people; every cell with two directions; every cell, where what stands still is taken out."""


@dataclass(frozen=True)
class Pair:
    """How two people meet: the angle [deg] of the line between them against the line across the radar's view, and their distance [m]."""

    angle: float = 0.0
    gap: float = 0.5
    stay: float = 2.5  # s


PAIRS: Final[Mapping[str, Pair | None]] = {
    "side_by_side": None,  # the scenes of `scenarios.approach`
    "diagonal": Pair(angle=45.0),
    "behind": Pair(angle=90.0),
    "side_by_side_0.8_m": Pair(gap=0.8),
}
WAYS: Final = tuple(name for name, pair in PAIRS.items() if pair is not None)


def meet(rng: Random, pair: Pair) -> tuple[Person, ...]:
    """Draw two who come within a distance of each other, stay, and go back to where they came from."""
    x, y = rng.uniform(2.4, 3.2), rng.uniform(-0.2, 0.2)
    along = np.array([math.sin(math.radians(pair.angle)), math.cos(math.radians(pair.angle))])
    across = np.array([along[1], -along[0]])
    people = []
    for number, side in ((1, -1.0), (2, 1.0)):
        start = (x, y) + side * rng.uniform(1.3, 1.6) * along + rng.uniform(-0.2, 0.2) * across
        there, speed = (x, y) + side * 0.5 * pair.gap * along, rng.uniform(0.7, 1.1)
        place: Place = (float(start[0]), float(start[1]))
        script = (walk(there[0], there[1], speed), stand(pair.stay), walk(*place, speed), stand(1.0))
        people.append(person(rng, number, place, script))
    return tuple(people)


def scene(pair: Pair | None, seed: int) -> Scene:
    """Draw one approach."""
    drawn = scenario("approach", seed)
    if pair is None:
        return drawn
    people = meet(np.random.default_rng([62, seed]), pair)
    return replace(drawn, people=people, duration=drawn.duration + pair.stay - Pair.stay)


class Powers:
    """Power of each person alone, without noise, in the cells of the range-Doppler map."""

    def __init__(self, simulator: Simulator) -> None:
        self._simulator, self._spectrum = simulator, make_spectrum(BasebandConfig().spectrum, simulator.info)

    def process(self, sequence: int, n_people: int) -> Float64Array:
        """Make the maps of a frame, shape (n_people, n_speeds, n_ranges)."""
        echoes = self._simulator.echoes(sequence)
        maps = []
        for row in range(n_people):
            own = echoes.select(np.flatnonzero(echoes.owner == row))
            spectrum = self._spectrum.process(self._simulator.propagator.process(own, None))
            maps.append((np.abs(spectrum).astype(np.float64) ** 2).sum(axis=(0, 2)))
        return np.stack(maps)


def owners(cloud: PointCloud, maps: Float64Array, truth: Truth, info: RadarInfo) -> NDArray[np.int32]:
    """Row of the person that each point of a cloud, in the sensor's frame, is an echo of, shape (n_points,).

    It is who has most power in the point's cell. Two directions in a cell: who is nearer to the direction.
    """
    if not len(cloud):
        return np.empty(0, np.int32)
    row = np.round(cloud.radial_speed / info.waveform.speed_resolution).astype(np.int64)
    column = np.round(cloud.range / info.waveform.range_resolution).astype(np.int64)
    power = maps[:, row % maps.shape[1], np.clip(column, 0, maps.shape[2] - 1)]
    _, cell, count = np.unique(np.stack([cloud.radial_speed, cloud.range]), axis=1, return_inverse=True, return_counts=True)
    azimuth = cartesian_to_spherical(info.mount.from_room(truth.position))[1]
    aside = np.abs(np.asarray(azimuth)[:, None] - cloud.azimuth)
    return np.asarray(np.where(count[cell] > 1, aside.argmin(axis=0), power.argmax(axis=0)), np.int32)


def simulate(drawn: Scene, basebands: Mapping[str, BasebandConfig]) -> dict[str, list[Moment]]:
    """Simulate an approach once; gives its moments by the name of the baseband."""
    simulator = Simulator(drawn)
    info = simulator.info
    chains = {name: Baseband(config, info) for name, config in basebands.items()}
    powers, rule = Powers(simulator), Visibility(info, MATCHING)
    made: dict[str, list[Moment]] = {name: [] for name in basebands}
    for k in range(simulator.n_frames):
        one = simulator.process(k)
        maps = powers.process(k, len(drawn.people))
        seen, truth = rule.process(one.truth), without_scatterers(one.truth)
        for name, chain in chains.items():
            cloud = chain.process(one.frame)
            made[name].append(Moment(cloud.to_room(info.mount), truth, seen, owners(cloud, maps, truth, info)))
    return made


@dataclass(frozen=True)
class Outcome:
    """What a tracker made of one approach; shares are of the clouds in which the two are near each other."""

    kind: str  # of `KINDS`
    merged: float  # share of clouds in which one track carries both people, see `one_track`
    absent: float  # share of clouds in which somebody has no point
    longest_merged: float  # s: longest time in which one track carries both people, cloud after cloud
    points: float  # mean number of points of a cloud


def distance(made: Sequence[Moment]) -> Float64Array:
    """Distance of the two people at all moments, shape (n_moments,) [m]."""
    place = np.stack([m.truth.position[:, :2] for m in made])
    return np.asarray(np.hypot(*np.moveaxis(place[:, 0] - place[:, 1], -1, 0)))


def one_track(moment: Moment, tracks: Tracks) -> tuple[bool, bool]:
    """Tell whether one track carries points of both people and no other track has a point, and whether somebody has no point."""
    carried = [set(tracks.point_track_id[moment.owner == row].tolist()) - {-1} for row in (0, 1)]
    merged = len(carried[0] | carried[1]) == 1 and carried[0] == carried[1]
    return merged, any(not (moment.owner == row).any() for row in (0, 1))


def judge(made: Sequence[Moment], tracker: Tracker) -> Outcome:
    """Run a tracker over an approach and say what became of the two identities."""
    matching = Matching(MATCHING)
    results, steps = [], []
    for moment in made:
        results.append(tracker.process(moment.cloud))
        steps.append(matching.process(results[-1], moment.truth, moment.visible).step)
    between = distance(made)
    near = between < NEAR
    merged, absent = np.array([one_track(*pair) for pair in zip(made, results, strict=True)]).T
    stamps = np.array([m.cloud.stamp_ns for m in made]) * 1e-9
    return Outcome(
        kind=fate(made, results, steps, stamps, merged, absent) if near.any() else "not_found",
        merged=float(merged[near].mean()) if near.any() else 0.0,
        absent=float(absent[near].mean()) if near.any() else 0.0,
        longest_merged=longest(merged & near) * float(np.median(np.diff(stamps))),
        points=float(np.mean([len(m.cloud) for m, here in zip(made, near, strict=True) if here])) if near.any() else 0.0,
    )


def longest(which: BoolArray) -> int:
    """Length of the longest row of moments that are true."""
    edge = np.flatnonzero(np.diff(np.concatenate([[False], which, [False]]).astype(np.int8)))
    return int((edge[1::2] - edge[::2]).max(initial=0))


def fate(
    made: Sequence[Moment],
    results: Sequence[Tracks],
    steps: Sequence[ClearMotStep],
    stamps: Float64Array,
    merged: BoolArray,
    absent: BoolArray,
) -> str:
    """Name of `KINDS` for the identities of an approach."""
    between = distance(made)
    before = np.flatnonzero(between[: np.flatnonzero(between < NEAR)[0]] >= APART)
    if not len(before):
        return "not_found"
    people = made[0].truth.person_id.tolist()
    then, now = ([identity(steps, stamps, number, at) for number in people] for at in (int(before[-1]), len(steps) - 1))
    if None in then:
        return "not_found"
    if now == then:
        return "kept"
    if now == then[::-1]:
        return "swapped"
    gone = next((k for k, tracks in enumerate(results) for one in tracks.deleted if one.id in then), None)
    if gone is None:
        return "lost_other"
    ended = next(one.id for one in results[gone].deleted if one.id in then)
    since = next((k for k in range(gone, -1, -1) if any(t.id == ended and t.unseen == 0 for t in results[k].tracks)), -1)
    span = slice(since + 1, gone + 1)
    if merged[span].mean() >= HALF:
        return "lost_merged"
    return "lost_absent" if absent[span].mean() >= HALF else "lost_other"


def knobs(config: TrackerConfig, **changed: Any) -> TrackerConfig:
    """Change some knobs of a configuration; two underscores stand for a dot."""
    return load(TrackerConfig, over(nest({name.replace("__", "."): value for name, value in changed.items()}), plain(config)))


FRAMES_50: Final = 1.0  # s: after so many frames without points the thesis ends every track (6.2.3); ours waits longer for who stands
DEFAULT: Final = {"default": TRACKERS["poisson_bernoulli"]}
OWN: Final = {name.removeprefix("thesis_"): config for name, config in THESIS.items()}


def wide(eps: float) -> dict[str, TrackerConfig]:
    """Give the thesis's trackers with another distance of neighbours [m], who end every track that has had no point for 50 frames."""
    return {name: knobs(config, association__clustering__eps=eps, life__delete_static_after=FRAMES_50) for name, config in OWN.items()}


@dataclass(frozen=True)
class Case:
    """A baseband and who tracks its clouds."""

    baseband: str  # of `BASEBANDS`
    trackers: Mapping[str, TrackerConfig]


CASES: Final[Mapping[str, Case]] = {
    "maxima": Case("maxima", OWN | DEFAULT),
    "maxima, eps 0.6 m": Case("maxima", wide(0.6)),
    "every cell": Case("every_cell", OWN | DEFAULT),
    "every cell, eps 0.25 m": Case("every_cell", wide(0.25)),
    "every cell, eps 0.6 m": Case("every_cell", wide(0.6)),
    "every cell, eps 0.6 m, two directions": Case("every_cell_two_directions", wide(0.6)),
    "every cell, eps 0.6 m, still echoes out": Case("every_cell_moving", wide(0.6)),
    "two directions": Case("two_directions", DEFAULT),
}
"""What is varied: which points there are, and how near neighbours of a cluster are (0.4 m where no case says else). ``maxima`` is what the
tracking benchmark has."""
FOUND: Final = "every cell, eps 0.6 m"  # the case in which other ways to meet are looked at


def work(name: str, seed: int, cases: Sequence[str], seconds: float) -> dict[str, dict[str, dict[str, Any]]]:
    """Simulate one approach of `PAIRS` and judge everybody on it; plain data by case and tracker."""
    drawn = scene(PAIRS[name], seed)
    drawn = replace(drawn, duration=min(drawn.duration, seconds))
    chosen = {case: CASES[case] for case in cases}
    made = simulate(drawn, {case.baseband: BASEBANDS[case.baseband] for case in chosen.values()})
    info = RadarInfo(mount=MOUNT)
    return {
        label: {who: asdict(judge(made[case.baseband], make("approach", config, info))) for who, config in case.trackers.items()}
        for label, case in chosen.items()
    }


def summary(outcomes: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """Sum up a tracker's approaches: counts of `KINDS`, and shares with Wilson's intervals; approaches with `not_found` count nowhere."""
    judged = [one for one in outcomes if one["kind"] != "not_found"]
    kinds, n = Counter(one["kind"] for one in outcomes), len(judged)
    lost = sum(kinds[kind] for kind in KINDS if kind.startswith("lost"))
    return {
        **{kind: kinds[kind] for kind in KINDS},
        "approaches": n,
        "changed": kinds["swapped"] + lost,
        "lost": lost,
        "merged_approaches": sum(one["merged"] >= MERGED for one in judged),
        **share("merged", sum(one["merged"] >= MERGED for one in judged), n),
        **share("kept_share", kinds["kept"], n),
        **share("lost_share", lost, n),
        **share("swapped_share", kinds["swapped"], n),
        **share("lost_merged_share", kinds["lost_merged"], n),
        "merged_clouds": float(np.mean([one["merged"] for one in judged])) if judged else None,
        "absent_clouds": float(np.mean([one["absent"] for one in judged])) if judged else None,
        "longest_merged_s": float(np.median([one["longest_merged"] for one in judged])) if judged else None,
        "points": float(np.mean([one["points"] for one in judged])) if judged else None,
    }


def table(found: Sequence[Mapping[str, Mapping[str, Mapping[str, Any]]]]) -> dict[str, dict[str, dict[str, Any]]]:
    """Sum up approaches by case and tracker."""
    return {case: {who: summary([one[case][who] for one in found]) for who in found[0][case]} for case in found[0]}


def run(quick: bool = False, keep: Path | None = None, seeds: str = "figure", parts: str = "cases") -> dict[str, Any]:
    """Judge every case side by side; ``--parts ways``: one case in other ways to meet. Quick: half of one approach."""
    if parts not in ("cases", "ways"):
        raise ConfigError(f"approaches has no part {parts}; parts: cases, ways")
    n = 1 if quick else APPROACHES if parts == "cases" else OTHERS
    seconds, first = (_QUICK if quick else math.inf), FIRST["develop" if quick else seeds]
    cases = ("maxima", FOUND) if quick else tuple(CASES)
    folder = None if keep is None else keep / f"approaches_{sources(_CODE)}"

    def every(name: str, count: int, chosen: Sequence[str]) -> list[Any]:
        numbers = range(first, first + count)
        paths = [None if folder is None else folder / f"{name}_{number}.json" for number in numbers]
        tasks = [functools.partial(work, name, number, tuple(chosen), seconds) for number in numbers]
        return [once(path, task) for path, task in zip(paths, tasks, strict=True)]

    if parts == "ways":
        return {"approaches": n, "ways": {name: table(every(name, n, (FOUND,)))[FOUND] for name in WAYS}, "choices": []}
    return {"approaches": n, "cases": table(every("side_by_side", n, cases)), "choices": []}
