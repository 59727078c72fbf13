"""How far a radar is tilted, from half a minute of one person: errors over many people, mounts and two activities.

Raw frames through the real baseband. Heights and tilts of the radars, people and what they do are drawn; the description says no tilt. What
is known of heights of echoes (`radar_lab.alignment.tilt.HEIGHTS`) came from other simulated people, and from recordings.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from benchmarks.gesture_scenes import fitted
from benchmarks.report import against_first, share, timed
from benchmarks.scenarios import person, walk
from benchmarks.stores import Store, clouds_of, kept, pack, room_effects, unpack
from radar_core import GESTURES, PointCloud, Pose, RadarInfo
from radar_core.config import load
from radar_lab.alignment.tilt import TiltCalibration, TiltConfig, TiltFinder
from radar_sim import Scene, Simulator
from radar_sim.people import Action
from radar_sim.scene import Fidelity, SceneRadar

SECONDS: Final = 30.0
FRAME: Final = 0.1  # s
SEEDS: Final = 16  # people of each activity
ACTIVITIES: Final = ("walk", "arms")
HEIGHTS: Final = (0.6, 2.4)  # m: of radars
UP_AND_DOWN: Final = (-0.7, 0.3)  # rad: tilts of radars at the greatest height and the least, and all between


def scene(seed: int, activity: str, seconds: float = SECONDS) -> Scene:
    """Draw a radar on a wall and somebody who walks between random places, or stands and gestures with pauses."""
    rng = np.random.default_rng([seed, 74, ACTIVITIES.index(activity)])
    height, spot = float(rng.uniform(*HEIGHTS)), float(rng.uniform(1.8, 4.0))
    level = math.atan2(1.0 - height, 3.0)  # tilted so, it looks at somebody 3 m away
    tilt = float(np.clip(level + rng.uniform(-0.25, 0.25), *UP_AND_DOWN))

    def step() -> Sequence[Action]:
        if activity == "walk":
            x = float(rng.uniform(1.5, 4.6))
            return (walk(x, float(rng.uniform(-0.5, 0.5) * x), rng.uniform(0.6, 1.3)),)
        return Action(gesture=str(rng.choice(GESTURES[1:]))), Action(stand=float(rng.uniform(0.3, 1.5)))

    radar = SceneRadar(mount=Pose(z=height, tilt=tilt))
    return Scene(
        duration=seconds,
        seed=seed,
        radars=(replace(radar, waveform=replace(radar.waveform, frame_interval=FRAME)),),
        people=(fitted(person(rng, 1, (spot, float(rng.uniform(-0.5, 0.5))), ()), seconds, seed, step, (0.0, 0.0)),),
        effects=room_effects(),
        fidelity=Fidelity(model="separable"),
    )


@dataclass(frozen=True, eq=False)
class Case:
    """What a radar saw, what it says of itself, its true tilt [rad], and what the person did."""

    activity: str
    info: RadarInfo
    clouds: tuple[PointCloud, ...]
    tilt: float


def _simulate(drawn: Scene, radar: int) -> dict[str, NDArray[Any]]:
    return pack(clouds_of(Simulator(drawn, drawn.radars[radar].frame_id))[0])


def cases(store: Store, seeds: Sequence[int], seconds: float) -> list[Case]:
    """Simulate what is not there yet, and read what each radar saw."""
    drawn = [(activity, scene(seed, activity, seconds)) for activity in ACTIVITIES for seed in seeds]
    store.make([(one, 0) for _, one in drawn], progress=sys.stdout.isatty())
    found = []
    for activity, one in drawn:
        radar = one.radars[0]
        info = RadarInfo(frame_id=radar.frame_id, waveform=radar.waveform, mount=replace(radar.mount, tilt=0.0))
        found.append(Case(activity, info, tuple(unpack(store.columns(one, 0), radar.frame_id)), radar.mount.tilt))
    return found


def calibrate(case: Case, config: TiltConfig, seconds: float) -> TiltCalibration:
    """Find the tilt from the first seconds."""
    finder = TiltFinder(config, case.info)
    for cloud in case.clouds:
        if cloud.stamp_ns - case.clouds[0].stamp_ns < seconds * 1e9:
            finder.process(cloud)
    return finder.result()


def variants(seconds: float) -> dict[str, tuple[dict[str, Any], float]]:
    """Name settings to compare, and how long to listen [s]: as shipped, and one thing changed in each; activity: of the other kind."""
    return {
        "as shipped": ({}, seconds),
        "10 s": ({}, seconds / 3),
        "5 s": ({}, seconds / 6),
        "moving=0.05": ({"moving": 0.05}, seconds),
        "moving=0.5": ({"moving": 0.5}, seconds),
        "nearest=1.5": ({"nearest": 1.5}, seconds),
        "the other activity told": ({"activity": None}, seconds),
    }


def judged(every: Sequence[Case], changes: dict[str, Any], seconds: float) -> tuple[NDArray[np.float64], NDArray[np.float64], list[float]]:
    """Errors and standard deviations [degrees] over the cases, and milliseconds that each took."""
    rows = []
    for case in every:
        told = case.activity if "activity" not in changes else next(name for name in ACTIVITIES if name != case.activity)
        config = load(TiltConfig, {**changes, "activity": told, "least_seconds": 2}, "options")
        found, spent = timed(calibrate, case, config, seconds)
        rows.append((math.degrees(found.tilt - case.tilt), math.degrees(found.std), spent))
    error, std, times = np.array(rows).T
    return error, std, times.tolist()


def figures(quick: bool = False, keep: Path | None = None) -> dict[str, Any]:
    """Measure; with ``keep``, clouds stay there and are not simulated again.

    Returns for each activity ``ACTIVITY_deg_rms``, ``ACTIVITY_deg_max`` and ``ACTIVITY_deg_mean``; ``within_2_sigma`` with its interval,
    over all; and ``choices``.
    """
    seeds, seconds = (range(1), 15.0) if quick else (range(SEEDS), SECONDS)
    with kept(keep) as folder:
        every = cases(Store(folder, "tilts", _simulate), seeds, seconds)
        tried = {name: judged(every, *settings) for name, settings in variants(seconds).items()}
    error, std, _ = tried["as shipped"]
    result: dict[str, Any] = {"people": len(every), "seconds": seconds} | share(
        "within_2_sigma", int((abs(error) < 2 * std).sum()), len(error)
    )
    for activity in ACTIVITIES:
        own = error[[case.activity == activity for case in every]]
        result |= {f"{activity}_deg_rms": float(np.sqrt((own**2).mean())), f"{activity}_deg_max": float(np.abs(own).max())}
        result[f"{activity}_deg_mean"] = float(own.mean())
    rows = {name: (float(np.sqrt((error**2).mean())), times) for name, (error, _, times) in tried.items()}
    return result | {"choices": against_first("calibrate_tilt", "tilt_error", rows, "degrees")}


run = figures
