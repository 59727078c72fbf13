"""Gestures before two radars: the fused pair against each radar alone, by distance, on the same scripts (config/scenes/two_radars.yaml).

People stand 1.5 to 4 m from the middle between the radars and do the nine gestures once. Nothing was tuned on these scenes.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np

from benchmarks.gesture_clouds import Moment, packed, unpacked
from benchmarks.gesture_scenes import NAMED, body, effects, stroke
from benchmarks.report import choice, timed
from benchmarks.stores import Columns, Store, clouds_of, kept
from radar_core import PointCloud, RadarInfo, merge
from radar_core.cloud import ARRAY_FIELDS
from radar_core.config import load_file, plain
from radar_core.paths import find_config
from radar_dsp import BasebandConfig
from radar_gestures import Classifier, GestureConfig, GestureRecognizer, load_model
from radar_lab.datasets.scenes import nearest_person
from radar_lab.evaluation.scoring import RecognisedGesture, TruthSegment, score_gestures, truth_segments
from radar_sim import Action, Scene, Simulator, Truth
from radar_sim.motions.script import Timeline
from radar_tracking import TrackedCloud, TrackerConfig, make_tracker
from radar_tracking.fusion.clouds import FusionConfig, fused_info

DISTANCES: Final = (1.5, 2.0, 2.5, 3.0, 3.5, 4.0)  # from the middle between the radars [m]
PEOPLE: Final = 4  # at every distance
WAYS: Final = ("left", "right", "fused", "before")
"""Who sees: one radar, the other, both; both by the rule of before, which takes every angle from the middle between the radars."""
_DRAWS: Final = 2000  # of the bootstrap over scenes


def scene(distance: float, seed: int, names: Sequence[str] = NAMED) -> Scene:
    """Draw somebody who does every gesture once, at a distance [m] from the middle between two radars, at most 10 degrees aside."""
    rng = np.random.default_rng([seed, round(1000 * distance), 0xF5])
    pair = load_file(Scene, find_config("two_radars", "scenes", ".yaml"))
    side = math.radians(rng.uniform(-10.0, 10.0))
    place = (distance * math.cos(side), distance * math.sin(side))
    steps = [Action(stand=1.5)]
    for name in rng.permutation(names):
        steps += [stroke(rng, str(name)), Action(stand=float(rng.uniform(1.0, 2.0)))]
    person = dataclasses.replace(body(rng, 1, place, steps), heading=math.remainder(math.pi + side, 2 * math.pi))
    number = int(rng.integers(1 << 31))
    duration = math.ceil(Timeline(person, number, (0.0, 0.0)).end)
    return dataclasses.replace(pair, people=(person,), seed=number, duration=float(duration), effects=effects(rng))


def _simulate(drawn: Scene, radar: int) -> Columns:
    simulator = Simulator(drawn, drawn.radars[radar].frame_id)
    return packed(*clouds_of(simulator), simulator.info.mount)


def pairs(streams: Sequence[Sequence[Moment]], infos: Sequence[RadarInfo]) -> Iterator[Moment]:
    """Merge the clouds of two radars whose stamps are within the fusion node's slop; the truth is that of the first one's stamp."""
    slop = FusionConfig().slop
    stamps = np.array([moment.cloud.stamp_ns for moment in streams[1]])
    for cloud, truth in ((moment.cloud, moment.truth) for moment in streams[0]):
        other = streams[1][int(np.argmin(np.abs(stamps - cloud.stamp_ns)))].cloud
        if abs(other.stamp_ns - cloud.stamp_ns) <= slop * 1e9:
            yield Moment(merge([cloud, other], [info.mount for info in infos], slop), truth)


def _flattened(cloud: PointCloud) -> PointCloud:
    """Forget which sensor saw which point."""
    return PointCloud(cloud.stamp_ns, cloud.sequence, cloud.frame_id, **{name: getattr(cloud, name) for name in ARRAY_FIELDS})


@dataclass(frozen=True)
class Counts:
    """Of one scene seen one way: gestures named right, gestures performed, gestures named that nobody performed; times of each cloud."""

    right: int
    performed: int
    false: int
    times_ms: list[float]


def judge(store: Store, drawn: Scene, model: Classifier) -> dict[str, Counts]:
    """Track, recognise and count one scene, seen in each of `WAYS`."""
    infos = [radar.info for radar in drawn.radars]
    streams = [list(unpacked(store.columns(drawn, number))) for number in range(len(infos))]
    truth = truth_segments(moment.truth for moment in streams[0])
    counts = {}
    for seen, info, moments in zip(WAYS, [*infos, fused_info(infos)], [*streams, list(pairs(streams, infos))], strict=False):
        people = make_tracker(TrackerConfig(), info)
        tracked = [TrackedCloud(moment.cloud, people.process(moment.cloud)) for moment in moments]
        for way in ("fused", "before") if seen == "fused" else (seen,):
            clouds = [TrackedCloud(_flattened(own.cloud), own.tracks) for own in tracked] if way == "before" else tracked
            recogniser = GestureRecognizer(GestureConfig(), model, info.mount)
            counts[way] = _recognise(clouds, [moment.truth for moment in moments], truth, recogniser)
    return counts


def _recognise(
    clouds: Sequence[TrackedCloud], truths: Sequence[Truth], performed: Sequence[TruthSegment], recogniser: GestureRecognizer
) -> Counts:
    found, times = [], []
    for tracked, truth in zip(clouds, truths, strict=True):
        gestures, spent = timed(recogniser.process, tracked)
        times.append(spent)
        for gesture in gestures:
            track = tracked.tracks.find(gesture.track_id)
            person = None if track is None else nearest_person(truth, track.position)
            found.append(RecognisedGesture(-1 if person is None else person, gesture.label, gesture.start_ns, gesture.end_ns))
    score = score_gestures(performed, found)
    return Counts(score.hits, score.total, score.false_alarms, times)


def interval(right: Sequence[Mapping[str, int]], performed: Sequence[int], seed: int = 1) -> list[float]:
    """95 % interval of fused minus the better single radar, by scenes drawn again with replacement."""
    rng = np.random.default_rng(seed)
    table, whole = np.array([[own[way] for way in WAYS[:3]] for own in right]), np.array(performed)
    rows = rng.integers(len(whole), size=(_DRAWS, len(whole)))
    share = table[rows].sum(axis=1) / whole[rows].sum(axis=1)[:, None]
    return [float(value) for value in np.percentile(share[:, 2] - share[:, :2].max(axis=1), [2.5, 97.5])]


def _row(counts: Sequence[Mapping[str, Counts]]) -> dict[str, Any]:
    """Shares of gestures right, and false ones, by way."""
    performed = sum(own["fused"].performed for own in counts)
    right = {way: sum(own[way].right for own in counts) / performed for way in WAYS}
    return {"gestures": performed, **right, "false": {way: sum(own[way].false for own in counts) for way in WAYS}}


def measure(scenes: Sequence[Scene], keep: Path, n_jobs: int = 1) -> dict[str, Any]:
    """Simulate what is missing in ``keep``, recognise every way, and count."""
    store, model = Store(keep, "gesture_pairs", _simulate, [plain(BasebandConfig())]), load_model()
    store.make([(drawn, radar) for drawn in scenes for radar in range(len(drawn.radars))], n_jobs=n_jobs)
    counts = [judge(store, drawn, model) for drawn in scenes]
    by_distance: dict[float, list[dict[str, Counts]]] = {}
    for drawn, own in zip(scenes, counts, strict=True):
        by_distance.setdefault(round(math.hypot(*drawn.people[0].position), 3), []).append(own)
    whole = _row(counts)
    right = [{way: own[way].right for way in WAYS} for own in counts]
    times = {way: [spent for own in counts for spent in own[way].times_ms] for way in WAYS}
    stage = "gestures of two radars"
    choices = [choice(stage, way, accuracy=("gestures right", whole[way], ""), times_ms=times[way]) for way in WAYS]
    return {
        **{name: whole[name] for name in ("gestures", *WAYS, "false")},
        "fused_minus_single": whole["fused"] - max(whole["left"], whole["right"]),
        "fused_minus_single_95": interval(right, [own["fused"].performed for own in counts]),
        "by_distance": {f"{far:g} m": _row(own) for far, own in sorted(by_distance.items())},
        "choices": choices,
    }


def run(quick: bool = False, keep: Path | None = None, n_jobs: int = 1) -> dict[str, Any]:
    """Measure gestures of the fused pair beside those of each radar, ten minutes; quick: one person and one gesture."""
    scenes = [scene(2.5, 0, NAMED[:1])] if quick else [scene(far, seed) for far in DISTANCES for seed in range(PEOPLE)]
    with kept(keep) as folder:
        return measure(scenes, folder, n_jobs)
