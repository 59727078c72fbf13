"""How many people are there? Trackers on every real recording of which that is known: RadHAR, MARS, the crossings, daily life."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final

import numpy as np

from benchmarks.people_sources import (
    DELIVERIES,
    Delivery,
    Float64Array,
    IndexArray,
    Kind,
    Loaded,
    MakeTracker,
    MaskArray,
    Source,
    Wanted,
    delivered,
    sources,
)
from benchmarks.report import choice, share_interval, timed
from benchmarks.stores import digest, once
from benchmarks.stores import sources as code
from radar_core import ConfigError
from radar_core.config import load_file, plain
from radar_core.paths import find_config
from radar_lab.evaluation.bootstrap import ratio_interval
from radar_tracking import TrackerConfig, Tracks, make_tracker

PRESETS: Final = ("default", "group_clustering", "dense", "sparse", "furnished", "thesis")
RECOMMENDED: Final = {
    "mars": "sparse",
    "crossing_one": "dense",
    "crossing_two": "dense",
    "crossing_two_any_cloud": "dense",
    "daily": "sparse",
}
"""Preset that docs and benchmarks name for a source; none for the others."""
TARGETS: Final = {
    "radhar_walk": 0.97, "radhar_boxing": 0.95, "radhar_squats": 0.97, "radhar_jack": 0.90, "radhar_jump": 0.80,
    "mars": 0.97, "crossing_one": 0.95, "crossing_two": 0.85, "daily": 0.95,
}  # fmt: skip
"""Share of clouds with the right count that one configuration is to reach."""
_CODE: Final = (
    "radar_core",
    "radar_tracking",
    "radar_lab/importers",
    *(f"benchmarks/{name}.py" for name in ("people_real", "people_sources")),
)


@dataclass(frozen=True, eq=False)
class Outcome:
    """What a tracker made of one recording; ``found``, ``people``, ``seconds`` and ``apart`` are of the clouds that count."""

    # found, people: shape (n_counted,): confirmed tracks, and people
    found: IndexArray
    people: IndexArray
    seconds: Float64Array  # shape (n_counted,): since the first cloud [s]
    apart: Float64Array  # shape (n_counted, 2): nearest confirmed track less the true body on the floor plane [m]; NaN: not known
    duration: float  # of the recording [s]
    counted: float  # time that the counted clouds stand for [s]
    identities: int  # ever confirmed, in all clouds
    # nis, dof: sums over the updates of confirmed tracks
    nis: float
    dof: int
    times_ms: tuple[float, ...]  # of every cloud

    @property
    def right(self) -> MaskArray:
        """Whether the count is right, shape (n_counted,)."""
        return np.asarray(self.found == self.people)

    def pieces(self, length: float) -> list[tuple[int, int]]:
        """Right counts and clouds of pieces of nearly equal length, no longer than so many seconds."""
        n = max(int(np.ceil(self.duration / length)), 1)
        number = np.minimum(self.seconds / max(self.duration, 1e-9) * n, n - 1).astype(np.int64)
        return [(int(self.right[number == k].sum()), int((number == k).sum())) for k in range(n) if (number == k).any()]


def follow(tracker: Any, loaded: Loaded) -> Outcome:
    """Run a new tracker over a recording."""
    results: list[Tracks] = []
    times: list[float] = []
    for cloud in loaded.clouds:
        tracks, spent = timed(tracker.process, cloud)
        results.append(tracks)
        times.append(spent)
    people = [list(tracks.people) for tracks in results]
    updates = [track for live in people for track in live if track.dof and np.isfinite(track.nis)]
    stamps = np.array([cloud.stamp_ns for cloud in loaded.clouds], np.int64)
    seconds, own = (stamps - stamps[0]) * 1e-9, loaded.counts
    apart = np.full((len(people), 2), np.nan)
    if loaded.body is not None:
        for row, (live, body) in enumerate(zip(people, loaded.body, strict=True)):
            away = [track.position[:2] - body for track in live]
            apart[row] = min(away, key=lambda one: float(np.hypot(*one)), default=apart[row])
    return Outcome(
        found=np.array([len(live) for live in people], np.int64)[own],
        people=loaded.people[own],
        seconds=seconds[own],
        apart=apart[own],
        duration=float(seconds[-1]),
        counted=float(seconds[-1]) * int(own.sum()) / max(len(own) - 1, 1),
        identities=len({track.id for live in people for track in live}),
        nis=float(sum(track.nis for track in updates)),
        dof=sum(track.dof for track in updates),
        times_ms=tuple(times),
    )


def interval(pieces: Sequence[tuple[int, int]]) -> tuple[float, float]:
    """Give the 95 % interval of a share, by drawing pieces (right, clouds) anew; Wilson's of so many pieces where all or none is right.

    Clouds of one recording are alike, so that they are drawn together. It says how much these recordings tell of others of the same
    people and rooms, nothing of other people.
    """
    table = np.array(pieces, np.float64).reshape(-1, 2)
    right, whole = table.sum(axis=0)
    if right in (0, whole):
        return share_interval(len(table) if right else 0, len(table))
    return ratio_interval(*table.T) or (0.0, 1.0)


def judge(make: MakeTracker, source: Source) -> dict[str, Any]:
    """Run a new tracker over each recording of a source and sum up, see `figures`."""
    return figures(outcomes_of(make, source), source.piece)


def outcomes_of(make: MakeTracker, source: Source) -> list[Outcome]:
    """Run a new tracker over each recording of a source."""
    return [follow(make(one.info), one) for one in (recording.load() for recording in source.recordings)]


def figures(outcomes: Sequence[Outcome], piece: float = 20.0) -> dict[str, Any]:
    """Sum up what a tracker made of recordings; all but ``identities`` is of the clouds that count.

    ``right_count``: share of the clouds with as many confirmed tracks (coasting ones too) as people, and ``_low``, ``_high`` of its
    `interval`; ``coverage``: with one at least; ``too_few``, ``too_many``. ``identities``: ever confirmed, per recording and person;
    ``most_identities``. Per minute: ``ghost_track_frames``: confirmed tracks beyond the people, summed over clouds; ``ghost_identities``:
    identities beyond the people. ``nis_per_dof``: of the updates of confirmed tracks, 1 where the filter knows itself. ``torso_error_m``:
    mean distance of the nearest track from the true body; ``torso_error_centred_m``: the same without each recording's mean difference;
    None: not known.
    """
    found, people = (np.concatenate([getattr(one, name) for one in outcomes]) for name in ("found", "people"))
    times = np.concatenate([one.times_ms for one in outcomes])
    each = [one.identities / max(int(one.people.max(initial=1)), 1) for one in outcomes]
    beyond = sum(max(one.identities - int(one.people.max(initial=1)), 0) for one in outcomes)
    minutes = sum(one.counted for one in outcomes) / 60
    right, whole = int((found == people).sum()), len(found)
    low, high = interval([pair for one in outcomes for pair in one.pieces(piece)])
    dof = sum(one.dof for one in outcomes)
    apart = [one.apart[np.isfinite(one.apart[:, 0])] for one in outcomes]
    centred = [one - one.mean(axis=0) for one in apart if len(one)]
    return {
        "recordings": len(outcomes),
        "clouds": whole,
        "right_count": right / whole if whole else None,
        "right_count_low": low if whole else None,
        "right_count_high": high if whole else None,
        "coverage": float((found > 0).mean()) if whole else None,
        "too_few": float((found < people).mean()) if whole else None,
        "too_many": float((found > people).mean()) if whole else None,
        "worst_recording": min((float(one.right.mean()) for one in outcomes if len(one.found)), default=None),
        "identities": float(np.mean(each)),
        "most_identities": max(one.identities for one in outcomes),
        "ghost_track_frames_per_minute": float(np.maximum(found - people, 0).sum()) / minutes if minutes else None,
        "ghost_identities_per_minute": beyond / (sum(one.duration for one in outcomes) / 60),
        "nis_per_dof": sum(one.nis for one in outcomes) / dof if dof else None,
        "torso_error_m": _mean_length(apart),
        "torso_error_centred_m": _mean_length(centred),
        "frame_ms": float(np.median(times)),
        "frame_ms_p95": float(np.percentile(times, 95)),
    }


def _mean_length(vectors: Sequence[Float64Array]) -> float | None:
    lengths = np.concatenate([np.hypot(*one.T) for one in vectors]) if vectors else np.zeros(0)
    return float(lengths.mean()) if len(lengths) else None


def preset(name: str) -> TrackerConfig:
    """Give the product's default, the thesis's tracker without presets, or a preset of config/tracking."""
    if name in ("default", "group_clustering"):
        return TrackerConfig() if name == "default" else TrackerConfig(tracker="group_clustering")
    return load_file(TrackerConfig, find_config(name, "tracking", ".yaml"))


def ours(config: TrackerConfig) -> MakeTracker:
    """Make the product's tracker with a configuration."""
    return lambda info: make_tracker(config, info)


def tuning(kind: Kind = "develop") -> list[Source]:
    """Give less of a kind, to try many trackers on: every fourth recording of an activity, and the first 1000 clouds of each recording."""
    found = [source for source in sources(kind) if source.name in TARGETS]
    return [
        replace(one, recordings=tuple(replace(r, limit=1000) for r in (one.recordings[::4] if one.name != "daily" else one.recordings)))
        for one in found
    ]


def search(
    candidates: Mapping[str, tuple[MakeTracker, Any]], keep: Path | None = None, finalists: int = 5
) -> dict[str, tuple[float, float | None]]:
    """Try trackers on `tuning`, and the best of them on all recordings to choose on; `score` of both by name, the chosen one first."""

    def tried(name: str, among: Sequence[Source], part: str) -> float:
        make, knobs = candidates[name]
        told = digest([code(_CODE), knobs])
        return score({one.name: judged(make, one, None if keep is None else keep / f"{part}_{one.name}_{told}.json") for one in among})

    few = tuning()
    first = {name: tried(name, few, "tuning") for name in candidates}
    best = sorted(first, key=lambda name: -first[name])
    whole = sources("choose")
    second = {name: tried(name, whole, "choose") for name in best[:finalists]}
    order = sorted(second, key=lambda name: -second[name]) + best[finalists:]
    return {name: (first[name], second.get(name)) for name in order}


def contenders(quick: bool) -> dict[str, tuple[MakeTracker, Any]]:
    """Makers of trackers and their knobs; the first is the reference of times. Stone Soup is among them where it is installed."""
    found: dict[str, tuple[MakeTracker, Any]] = {
        name: (ours(config), plain(config)) for name, config in ((name, preset(name)) for name in PRESETS[: 2 if quick else None])
    }
    try:
        from benchmarks.people_peer import TUNED, peer
    except ImportError:
        return found
    return {**found, "stone_soup": (peer(TUNED), plain(TUNED))}


def judged(make: MakeTracker, source: Source, path: Path | None) -> dict[str, Any]:
    """Judge, or take what an earlier run left in a file; ``times_ms``: hundred and one quantiles of the time of a cloud."""

    def measure() -> dict[str, Any]:
        found = outcomes_of(make, source)
        times = np.percentile(np.concatenate([one.times_ms for one in found]), np.arange(101))
        return {**figures(found, source.piece), "times_ms": times.tolist()}

    return dict(once(path, measure))


def summary(by_source: Mapping[str, Mapping[str, Any]]) -> dict[str, Any]:
    """Sum up the sources of `TARGETS`: mean right count, how many reach their target, identities, and `score`."""
    own = [by_source[name] for name in TARGETS if name in by_source]
    return {
        "mean_right_count": float(np.mean([one["right_count"] for one in own])),
        "targets_reached": sum(by_source[name]["right_count"] >= least for name, least in TARGETS.items() if name in by_source),
        "targets": len(own),
        "identities": float(np.mean([one["identities"] for one in own])),
        "score": score(by_source),
    }


def score(by_source: Mapping[str, Mapping[str, Any]]) -> float:
    """One number to choose by: mean over the sources of the right count, less 0.02 for every identity too many, 0.2 at most."""
    own = [by_source[name] for name in TARGETS if name in by_source]
    return float(np.mean([one["right_count"] - min(0.02 * max(one["identities"] - 1, 0.0), 0.2) for one in own]))


def rows(stage: str, by_name: Mapping[str, Mapping[str, Any]]) -> list[dict[str, Any]]:
    """One row per tracker: right count beside the time per cloud; the first is the reference."""
    found: list[dict[str, Any]] = []
    reference: list[float] = []
    for name, one in by_name.items():
        reference = reference or one["times_ms"]
        title = f"{name}, {one['identities']:.2f} identities"
        accuracy = ("right count", one["right_count"], "")
        found.append(choice(stage, title, accuracy=accuracy, times_ms=one["times_ms"], reference_ms=reference))
    return found


def shown(found: Mapping[str, Any]) -> dict[str, Any]:
    """Leave out the quantiles."""
    return {key: value for key, value in found.items() if key != "times_ms"}


def _tasks(quick: bool, kind: Wanted, delivery: Delivery | None = None) -> list[Source]:
    found = sources(kind) if delivery is None else delivered(delivery, kind)
    if not quick:
        return found
    few = [source for source in found if source.name in ("radhar_walk", "mars") or source.name.startswith("radhar_walk_")]
    return [replace(source, recordings=(replace(source.recordings[0], limit=150),)) for source in few]


def run(quick: bool, keep: Path | None = None, kind: Wanted = "figure", parts: str = "") -> dict[str, Any]:
    """Judge the presets and Stone Soup on every source, and the default with clouds as transports deliver them.

    ``quick``: the first clouds of two recordings; ``keep``: a folder for finished parts; ``kind``: which recordings, see `sources`;
    ``parts``: only these trackers, with commas between, on clouds as recorded.
    Returns ``trackers``: figures by name and source, ``recommended`` among them, which takes the preset of `RECOMMENDED` for each source;
    ``summary`` by name; ``deliveries``: figures of the default by source; ``kind``, ``choices``. Raises AbsentError without recordings,
    ConfigError for a name that is no tracker's.
    """

    def one(name: str, source: Source) -> dict[str, Any]:
        make, knobs = known[name]
        if keep is None:
            return judged(make, source, None)
        told = digest([code(_CODE), knobs, kind, [(r.name, r.limit) for r in source.recordings]])
        return judged(make, source, keep / f"{source.name}_{name}_{told}.json")

    every, wanted_names = contenders(quick), parts.split(",") if parts else []
    if unknown := set(wanted_names) - every.keys():
        raise ConfigError(f"people_real has no tracker {', '.join(sorted(unknown))}; trackers: {', '.join(every)}")
    known = {name: own for name, own in every.items() if not parts or name in wanted_names}
    found = {source.name: {name: one(name, source) for name in known} for source in _tasks(quick, kind)}
    ways = () if parts else tuple(DELIVERIES)
    sent = {d: {s.name.removesuffix(f"_{d}"): one("default", s) for s in _tasks(quick, kind, d) if "radhar" in s.name} for d in ways}
    choices = [row for name, by_tracker in found.items() for row in rows(name, by_tracker)]
    for name in sent.get("recorded", ()):
        choices += rows(f"{name} as delivered", {delivery: by_source[name] for delivery, by_source in sent.items()})
    trackers = {name: {source: shown(by_tracker[name]) for source, by_tracker in found.items()} for name in known}
    wanted = {source: RECOMMENDED.get(source, "default") for source in found}
    trackers["recommended"] = {source: trackers[name][source] for source, name in wanted.items() if name in trackers}
    return {
        "kind": kind,
        "summary": {name: summary(by_source) for name, by_source in trackers.items()},
        "trackers": trackers,
        "deliveries": {delivery: {name: shown(value) for name, value in by_source.items()} for delivery, by_source in sent.items()},
        "choices": choices,
    }
