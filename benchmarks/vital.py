"""Breath and pulse of people who sit, from raw frames of the default radar, and whether the tracker keeps them.

Scenes from number `DEVELOPED` on were looked at while the processor was made; the figures are about those from 0 on.
"""

from __future__ import annotations

import functools
import math
from pathlib import Path
from typing import Any, Final

import numpy as np

from benchmarks.gesture_scenes import effects
from benchmarks.report import share, timed
from benchmarks.stores import once
from radar_core import ConfigError, Pose
from radar_dsp import Baseband, BasebandConfig
from radar_dsp.vital import VitalConfig, VitalMonitor
from radar_sim import Action, Person, Scene, Simulator, Variation, Vital, Walk
from radar_sim.scene import SceneRadar
from radar_sim.things import Furniture
from radar_tracking import TrackerConfig, make_tracker

DEVELOPED: Final = 100  # number of the first scene that was looked at
SECONDS: Final = 45.0  # of a scene
_BACK: Final = 0.46  # m: from where somebody stands to where the body sits
PLACES: Final = {1.0: 4, 1.5: 10, 2.0: 4, 3.0: 4, 4.0: 4}  # m: of the body from the radar, and how many sit there
_SITTING: Final = range(3, 9)  # numbers of who sits for ten minutes; those from 0 to 2 were looked at while the tracker was made
_NEAR: Final = 0.7  # m: a track within that of the body is the person's


def sitter(number: int, distance: float, seconds: float = SECONDS, *, comes: bool = False) -> Scene:
    """Draw somebody who leans back on a chair before the default radar, beside a table; ``comes``: from two metres aside, and sways."""
    rng = np.random.default_rng([30, number])
    vital = Vital(
        breath_rate=float(rng.uniform(0.15, 0.42)),
        breath=float(rng.uniform(0.003, 0.005)),
        heart_rate=float(rng.uniform(0.85, 1.8)),
        heart=float(rng.uniform(0.00025, 0.0004)),
    )
    side = float(rng.uniform(-0.15, 0.15)) * distance
    x = float(np.sqrt(distance**2 - side**2))
    person = Person(
        height=float(rng.uniform(1.55, 1.9)),
        sex=("male", "female")[int(rng.integers(2))],
        build=float(rng.uniform(0.2, 0.8)),
        position=(x - _BACK, side + 2.0 * comes),  # the body is that far behind who stood up from it
        heading=math.pi if comes else None,
        variation=Variation(sway=1.0 if comes else 0.1),
        vital=vital,
        script=(*([Action(walk=Walk(to=(x - _BACK, side), speed=1.0))] if comes else []), Action(sit=seconds)),
    )
    furniture = (
        Furniture(position=(x + 0.35, side), size=(0.1, 0.5, 0.95)),  # back of the chair
        Furniture(position=(x - 0.1 * distance, side - 0.9), size=(0.6, 0.8, 0.75)),  # a table beside
        Furniture(position=(5.2, 1.0), size=(0.4, 1.2, 1.9)),  # a shelf
    )
    radar = SceneRadar(mount=Pose(z=1.0))
    return Scene(duration=seconds, seed=number, radars=(radar,), people=(person,), furniture=furniture, effects=effects(rng))


def follow(number: int, distance: float, seconds: float = SECONDS, window: float = VitalConfig().window) -> dict[str, Any]:
    """Look at one sitter after a full window [s]: errors of all looks [1/min], and what a frame took [ms]."""
    scene = sitter(number, distance, seconds)
    simulator = Simulator(scene)
    monitor, vital = VitalMonitor(VitalConfig(window=window), simulator.info), scene.people[0].vital
    assert vital is not None
    found: dict[str, Any] = {"distance": distance, "breath": [], "heart": [], "times_ms": []}
    for k in range(simulator.n_frames):
        made = simulator.process(k)
        seen, spent = timed(monitor.process, made.frame, made.truth.position[0])
        found["times_ms"].append(spent)
        if seen is not None and k * scene.radars[0].waveform.frame_interval > window:
            found["breath"].append(60 * abs(seen.breath - vital.breath_rate))
            found["heart"].append(60 * abs(seen.heart - vital.heart_rate))
    return found


def errors(found: list[dict[str, Any]], name: str) -> dict[str, Any]:
    """Ninetieth percentile of an error over all looks that gave a rate, its interval by sitters, and how many looks gave one."""
    rows = [np.array(one[name]) for one in found]
    rng = np.random.default_rng(0)

    def p90(chosen: list[Any]) -> float:
        given = np.concatenate(chosen)
        given = given[np.isfinite(given)]
        return float(np.percentile(given, 90)) if len(given) else math.nan

    if not np.isfinite(np.concatenate(rows)).any():
        return {"p90": math.nan, "interval": None, "sitters": len(rows), "given": 0.0}
    drawn = [p90([rows[k] for k in rng.integers(len(rows), size=len(rows))]) for _ in range(500)]
    given = np.isfinite(np.concatenate(rows))
    return {
        "p90": p90(rows),
        "interval": [float(np.nanpercentile(drawn, q)) for q in (2.5, 97.5)],
        "sitters": len(rows),
        "given": float(given.mean()),
    }


def sits(number: int, seconds: float) -> dict[str, Any]:
    """Follow who comes and sits down with the default chain; whether one track stays to the end, and how long one was there."""
    scene = sitter(number, 1.5 + number % 3, seconds, comes=True)
    simulator = Simulator(scene)
    baseband, tracker = Baseband(BasebandConfig(), simulator.info), make_tracker(TrackerConfig(), simulator.info)
    there: list[int] = []  # the person's track, -1 without one, from 5 s on
    for k in range(simulator.n_frames):
        made = simulator.process(k)
        tracks = tracker.process(baseband.process(made.frame).to_room(simulator.info.mount))
        if made.truth.stamp_ns > 5e9:
            body = made.truth.position[0]
            near = min(((float(np.hypot(*(one.position - body)[:2])), one.id) for one in tracks.people), default=(math.inf, -1))
            there.append(near[1] if near[0] < _NEAR else -1)
    ids = np.array(there)
    return {"kept": bool((ids == ids[0]).all() and ids[0] >= 0), "covered": float((ids >= 0).mean()), "seconds": seconds}


def sitters(quick: bool, keep: Path | None) -> dict[str, Any]:
    """Errors of both rates of people who lean back; quick: of one, over a short window."""
    places = [1.5] if quick else [place for place, count in PLACES.items() for _ in range(count)]
    look = functools.partial(follow, seconds=14.0, window=12.0) if quick else follow
    found = [once(keep and keep / f"vital_sitter_{k}.json", functools.partial(look, k, place)) for k, place in enumerate(places)]
    by_place = {place: [one for one in found if one["distance"] == place] for place in dict.fromkeys(places)}
    table = {f"{place:g}": {name: errors(own, name) for name in ("breath", "heart")} for place, own in by_place.items()}
    every = [time for one in found for time in one["times_ms"]]
    breath = errors(found, "breath")
    return {
        "respiration_error_bpm_p90": breath["p90"],
        "respiration": breath,
        "heart_error_bpm_p90": table["1.5"]["heart"]["p90"],
        "heart": table["1.5"]["heart"],
        "by_distance": table,
        "frame_ms": {"median": float(np.median(every)), "p95": float(np.percentile(every, 95))},
    }


def sitting(quick: bool, keep: Path | None) -> dict[str, Any]:
    """How many keep their track while they sit for ten minutes; quick: one, for ten seconds."""
    seconds = 10.0 if quick else 600.0
    numbers = _SITTING[:1] if quick else _SITTING
    sat = [once(keep and keep / f"vital_sits_{k}.json", functools.partial(sits, k, seconds)) for k in numbers]
    return {**share("sitting_kept_10min", sum(one["kept"] for one in sat), len(sat)), "sitting": sat}


PARTS: Final = {"sitters": sitters, "sitting": sitting}


def run(quick: bool, keep: Path | None = None, parts: str = "") -> dict[str, Any]:
    """Twenty-six sitters of 45 s (``--parts sitters``), and six who sit for ten minutes (``--parts sitting``)."""
    chosen = parts.split(",") if parts else list(PARTS)
    if unknown := set(chosen) - PARTS.keys():
        raise ConfigError(f"vital has no part {', '.join(sorted(unknown))}; parts: {', '.join(PARTS)}")
    figures: dict[str, Any] = {}
    for name in chosen:
        figures |= PARTS[name](quick, keep)
    return figures | {"choices": []}
