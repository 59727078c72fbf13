"""How fast people move who do not gesture: real ones of the daily recordings of mHomeGes, and simulated ones before the same radar.

Counted are bouts: times in which the second fastest point of the clouds is faster than 0.5 m/s along its beam, and that are parted by 0.3 s
without. No detector has a say in this. Simulated people fidget, reach and stand; their radar is the one of `gesture_drills`, which removes
what stands still.
"""

from __future__ import annotations

import functools
from collections.abc import Iterable, Sequence
from typing import Any, Final

import numpy as np

from benchmarks.gesture_drills import baseband, radar
from benchmarks.gesture_motion import MOVES
from benchmarks.gesture_scenes import body
from benchmarks.gestures_daily import recordings
from benchmarks.report import rate
from radar_core import PointCloud
from radar_core.types import Float64Array
from radar_dsp import Baseband
from radar_sim import Action, Effects, LossesConfig, NoiseConfig, OcclusionConfig, Reach, Scene, SceneRadar, Simulator
from radar_sim.people import Moves
from radar_sim.scene import Fidelity

SEEDS: Final = range(720, 740)
SECONDS: Final = 120.0  # of a simulated stream
LEAST: Final = 0.5  # m/s
FASTER: Final = (0.8, 1.5)  # m/s
_APART: Final = 3  # clouds
_AS: Final = ("told", "usual", "half_speed", "twice_speed")


def fastest(clouds: Iterable[PointCloud]) -> Float64Array:
    """Speed of the second fastest point of each cloud along its beam [m/s], shape (n_clouds,); 0 where there are fewer than two."""
    found = []
    for cloud in clouds:
        speed = np.sort(np.abs(cloud.radial_speed[np.isfinite(cloud.radial_speed)].astype(np.float64)))
        found.append(float(speed[-2]) if len(speed) > 1 else 0.0)
    return np.array(found)


def bouts(speed: Float64Array) -> list[float]:
    """Highest speed of each bout [m/s], of speeds of successive clouds, shape (n_clouds,)."""
    peaks: list[float] = []
    rest, top = 0, 0.0
    for value in [*speed.tolist(), *[0.0] * _APART]:
        rest = 0 if value > LEAST else rest + 1
        top = max(top, value) if value > LEAST else top
        if rest == _APART and top:
            peaks.append(top)
            top = 0.0
    return peaks


def counted(peaks: Sequence[float], hours: float) -> dict[str, Any]:
    """Bouts an hour, and those faster than some speeds."""
    found = {"hours": hours, **rate("bouts_per_hour", len(peaks), hours)}
    for limit in FASTER:
        found |= rate(f"above_{limit:g}_per_hour", sum(peak > limit for peak in peaks), hours)
    return found


def busy(rng: np.random.Generator, seconds: float) -> list[Action]:
    """Fidget, reach for something before the radar, and stand."""
    script, time = [], 0.0
    while time < seconds:
        kind = rng.random()
        if kind < 0.5:
            script.append(Action(fidget=float(rng.uniform(3.0, 8.0))))
        elif kind < 0.8:
            place = (float(rng.uniform(0.0, 3.0)), float(rng.uniform(-0.6, 0.6)), float(rng.uniform(0.5, 1.9)))
            script.append(Action(reach=Reach(to=place, hold=float(rng.uniform(0.1, 1.5)))))
        else:
            script.append(Action(stand=float(rng.uniform(1.0, 6.0))))
        time += 2.0
    return script


def simulated(moves: Moves | None, seed: int, seconds: float) -> list[float]:
    """Peaks of somebody who is simulated."""
    rng = np.random.default_rng([seed, 0x5EED])
    place = (float(rng.uniform(1.3, 2.8)), float(rng.uniform(-0.3, 0.3)))
    scene = Scene(
        duration=seconds,
        seed=seed,
        radars=(SceneRadar.of(radar()),),
        people=(body(rng, 1, place, busy(rng, seconds), moves),),
        effects=Effects(occlusion=OcclusionConfig(), doppler_in_chirp=True, noise=NoiseConfig(), losses=LossesConfig(level=12.0)),
        fidelity=Fidelity(model="separable"),
    )
    simulator, seen = Simulator(scene), Baseband(baseband("remove"), radar())
    return bouts(fastest(seen.process(simulator.process(number).frame) for number in range(simulator.n_frames)))


def real(quick: bool) -> dict[str, Any]:
    """Count what people of the recordings did; quick: one of them."""
    peaks: list[float] = []
    seconds = 0.0
    for _, recording in list(recordings())[: 1 if quick else None]:
        clouds = [item for item in recording.items if isinstance(item, PointCloud)]
        seconds += (clouds[-1].stamp_ns - clouds[0].stamp_ns) * 1e-9
        peaks += bouts(fastest(clouds))
    return counted(peaks, seconds / 3600)


def run(quick: bool = False) -> dict[str, Any]:
    """Count both; simulated people once for each way to move of `gesture_motion`; quick: a few seconds."""
    seeds, seconds = (SEEDS[:1], 10.0) if quick else (SEEDS, SECONDS)
    made = {name: functools.partial(simulated, MOVES[name]) for name in _AS}
    by = {name: [peak for seed in seeds for peak in make(seed, seconds)] for name, make in made.items()}
    return {"real": real(quick), **{name: counted(own, len(seeds) * seconds / 3600) for name, own in by.items()}, "choices": []}
