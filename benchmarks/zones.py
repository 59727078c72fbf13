"""Zones: counts and presence against the truth, false presence in empty rooms, how soon silence is noticed, and what zones cost.

``rooms``: random rooms with people, a fan and a curtain (`benchmarks.zone_rooms`). ``nights``: the same kind of rooms empty, for `HOURS` in
all at 10 clouds a second, drawn from half an hour of raw simulation. ``stale``: a graph of real nodes whose driver is killed.
``latency``: what zones take.
The figures without prefix are those of the default tracker; ``group_clustering_``: of that one.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np

from benchmarks.report import Panel
from benchmarks.room_scenes import room
from benchmarks.rooms import PART, RoomStore
from benchmarks.stores import kept
from benchmarks.zone_rooms import EMPTY, MINUTE, MINUTES, SEEDS, EmptyStore, around, info_of, layout_of, night
from benchmarks.zone_score import Night, ZoneScore, intervals, judge_zones, tracker_config, watch_night
from radar_tracking import make_tracker
from radar_tracking.zones import LayoutConfig, ZoneMonitor

TRACKERS: Final = {"": "poisson_bernoulli", "group_clustering_": "group_clustering"}
HOURS: Final = 10.0  # of empty rooms, all together, with exclusion zones
BARE_HOURS: Final = 1.0  # without
PARTS: Final = ("rooms", "latency", "nights", "stale")
PANEL: Final = Panel("zones in random rooms", "moments with the right count", "", "higher", "poisson_bernoulli", "poisson_bernoulli")


def in_rooms(store: RoomStore, seeds: Sequence[int], seconds: float) -> dict[str, Any]:
    """Judge counts and presence, with both trackers, with and without exclusion zones in the tracker."""
    found: dict[str, Any] = {"rooms": len(seeds)}
    values, times = {}, {}
    for prefix, name in TRACKERS.items():
        scores, bare = [], []
        for kept_room in store.rooms(seeds, "default", seconds):
            layout = layout_of(kept_room.seed)
            scores.append(judge_zones(kept_room, layout, tracker_config(name, layout)))
            bare.append(judge_zones(kept_room, layout, tracker_config(name, LayoutConfig())))
        total, without = sum(scores, ZoneScore()), sum(bare, ZoneScore())
        found |= {f"{prefix}{key}": value for key, value in (total.figures() | intervals(scores)).items()}
        found[f"{prefix}zone_count_accuracy_without_exclusion"] = without.figures()["zone_count_accuracy"]
        found[f"{prefix}zone_count_accuracy_by_room"] = [score.figures()["zone_count_accuracy"] for score in scores]
        values[name], times[name] = total.figures()["zone_count_accuracy"] or 0.0, total.times.tolist()
    return {**found, "choices": PANEL.rows(values, times | {"": times["poisson_bernoulli"]})}


def added(store: RoomStore, seed: int, seconds: float) -> dict[str, float]:
    """How long zones take for the tracks of a cloud: processor time, median and 95th percentile [ms], with the room's five zones."""
    kept_room, layout = store.room(seed, "default", seconds), layout_of(seed)
    tracker, monitor, spent = make_tracker(tracker_config("poisson_bernoulli", layout), kept_room.info), ZoneMonitor(layout), []
    for tracks in [tracker.process(cloud) for cloud in kept_room.clouds]:
        started = time.thread_time_ns()  # not the clock: what other programs take meanwhile is not ours
        monitor.process(tracks)
        spent.append((time.thread_time_ns() - started) * 1e-6)
    return {"latency_added_ms": float(np.percentile(spent, 95)), "latency_added_median_ms": float(np.median(spent))}


def in_empty_rooms(store: EmptyStore, seeds: Sequence[int], minutes: int, hours: float, bare_hours: float) -> dict[str, Any]:
    """Count false presence, with both trackers, with and without exclusion zones."""
    found: dict[str, Any] = {}
    for prefix, name in TRACKERS.items():
        for suffix, long in (("", hours), ("_without_exclusion", bare_hours)):
            total = Night()
            for seed in seeds:
                scene = store.parts([seed], 1)[0][0]
                layout = LayoutConfig() if suffix else LayoutConfig(zones=around(scene))
                clouds = night(store.clouds(seed, minutes), long * 3600.0 / len(seeds), np.random.default_rng([seed, 0x419]))
                found_here = watch_night(clouds, info_of(seed), layout, tracker_config(name, layout))
                print(f"{name}{suffix}, room {seed}: {found_here}", file=sys.stderr, flush=True)
                total += found_here
            found |= {f"{prefix}{key}{suffix}": value for key, value in total.figures(HOURS).items()}
            found[f"{prefix}hours{suffix}"] = total.hours
    return found


def run(quick: bool, keep: Path | None = None, parts: str = ",".join(PARTS)) -> dict[str, Any]:
    """Measure; ``keep`` is a folder for what is simulated; ``parts``: which of `PARTS`, with commas."""
    chosen, found = parts.split(","), {}
    with kept(keep) as folder:
        seeds, seconds, part = (SEEDS[4:5], 2.0, 2.0) if quick else (SEEDS, 60.0, PART)
        rooms = RoomStore(folder, part)
        if "rooms" in chosen:
            rooms.fill(seeds, seconds)
            found |= in_rooms(rooms, seeds, seconds)
        if "latency" in chosen:
            crowded = max(seeds, key=lambda seed: room(seed).tags.people)
            rooms.fill([crowded], seconds)
            found |= added(rooms, crowded, seconds)
        if "nights" in chosen:
            empty, minutes, length = (EMPTY[:1], 2, 3.0) if quick else (EMPTY, MINUTES, MINUTE)
            store = EmptyStore(folder, length)
            store.make(store.parts(empty, minutes))
            hours = (0.005, 0.005) if quick else (HOURS, BARE_HOURS)
            found |= in_empty_rooms(store, empty, minutes, *hours)
    if "stale" in chosen:
        from benchmarks.zones_stale import stale_detected

        noticed = stale_detected()
        found |= {"stale_detected_s": max(noticed.values()), "stale_detected_by_stage_s": noticed}
    return found
