"""The hand: how far its track is from the hand, by number of radars and by filter, beside the time of a moment."""

from __future__ import annotations

import dataclasses
import functools
import time
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from benchmarks.tradeoff.people import short, timed
from benchmarks.tradeoff.rows import Found, Panel, of_rms
from benchmarks.tradeoff.settings import Settings
from radar_core import RadarInfo, merge
from radar_dsp import Baseband, BasebandConfig
from radar_sim import Simulator
from radar_tracking import HandConfig, HandTracker, PeopleTracker, TrackedCloud
from radar_tracking.fusion.clouds import fused_info

_TRIGGER_NS, _SETTLED = 800_000_000, 1.3  # ns, s: the hand is followed from there on; its errors count from there on
_LOST = 1.0  # m: error where there is no hand track although there is a hand
_SLOP = 0.02  # s: clouds whose stamps are farther apart than this are not put together, as by the fusion node
RADARS = Panel("number of radars", "hand residual (rms)", "m", "lower", "1 radar", "baseband and people tracking of one radar")
FILTER = Panel("hand filter", "hand residual (rms)", "m", "lower", "mm_vel_est", "baseband and people tracking of one radar")

Float64Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Stream:
    """A drawing hand up to the hand tracker.

    Attributes
    ----------
    clouds : tuple of TrackedCloud
        Of one radar, or of two put together.
    info : RadarInfo
        The radar that they seem to come from.
    time : ndarray of float64, shape (n,)
        Of each cloud [s].
    hand : ndarray of float64, shape (n, 3)
        The true hand [m]; NaN: it does not draw.
    before_ms : tuple of float
        What everything before the hand tracker took [ms].
    """

    clouds: tuple[TrackedCloud, ...]
    info: RadarInfo
    time: Float64Array
    hand: Float64Array
    before_ms: tuple[float, ...]


@functools.lru_cache(maxsize=2)
def streams(settings: Settings) -> dict[int, Stream]:
    """Simulate the hand of ``two_radars`` (or of the user's scene with two radars), seen by the first radar and by both."""
    scene = short(settings.scene or "two_radars", settings.seed, settings.scene is None, radars=2)
    simulators = [Simulator(scene, radar.frame_id) for radar in scene.radars[:2]]
    infos = [simulator.info for simulator in simulators]
    basebands = [Baseband(BasebandConfig(), info) for info in infos]
    seen = {1: infos[0], 2: fused_info(infos)}
    people = {n: PeopleTracker(None, info) for n, info in seen.items()}
    made: dict[int, list[TrackedCloud]] = {1: [], 2: []}
    before: dict[int, list[float]] = {1: [], 2: []}
    times, hands = [], []
    for k in range(min(simulators[0].n_frames, simulators[1].n_frames, round(settings.pick(4.5, 8.5) / simulators[0].interval))):
        both = [simulator.process(k) for simulator in simulators]
        found = [timed(baseband, one.frame) for baseband, one in zip(basebands, both, strict=True)]
        for n in (1, 2):
            start = time.perf_counter_ns()
            parts = [cloud for cloud, _ in found[:n]]
            room = parts[0].to_room(infos[0].mount) if n == 1 else merge(parts, [info.mount for info in infos], _SLOP)
            made[n].append(TrackedCloud(room, people[n].process(room)))
            before[n].append(sum(spent for _, spent in found[:n]) + (time.perf_counter_ns() - start) * 1e-6)
        truth = both[0].truth
        times.append(truth.stamp_ns * 1e-9)
        hands.append(truth.hand_position[0] if truth.drawing[0] else np.full(3, np.nan))
    return {n: Stream(tuple(made[n]), seen[n], np.array(times), np.array(hands), tuple(before[n])) for n in (1, 2)}


def follow(stream: Stream, config: HandConfig) -> tuple[Float64Array, list[float]]:
    """Follow the hand; residuals [m] of the moments that count, and times of all moments [ms]."""
    tracker, residual, times = HandTracker(config, stream.info), [], []
    tracker.start(None, _TRIGGER_NS)
    for cloud, at, true in zip(stream.clouds, stream.time, stream.hand, strict=True):
        start = time.perf_counter_ns()
        found = tracker.process(cloud)
        times.append((time.perf_counter_ns() - start) * 1e-6)
        if at >= _SETTLED and np.isfinite(true[0]):
            residual.append(float(np.linalg.norm(found.position - true)) if found is not None and found.active else _LOST)
    return np.array(residual), times


def measure(settings: Settings) -> Found:
    """Compare one radar with two, and the filters with each other, on the same drawing hand."""
    found, both, default = Found(), streams(settings), HandConfig()
    reference = list(both[1].before_ms)
    # Residuals within a fifth of a second tell the same: the hand goes some 0.1 m in it.
    if not (np.isfinite(both[1].hand[:, 0]) & (both[1].time >= _SETTLED)).any():
        found.leave_out(RADARS.name, "all", f"nobody draws with a hand after {_SETTLED:g} s; choose a scene such as two_radars")
        return found
    n = max(round((both[1].time[-1] - _SETTLED) / 0.2), 1)
    for radars, stream in both.items():
        residual, times = follow(stream, default)
        value = float(np.sqrt(np.mean(residual**2)))
        label = "1 radar" if radars == 1 else f"{radars} radars"
        found.rows.append(RADARS.row(label, value, np.add(stream.before_ms, times).tolist(), reference, margin=of_rms(value, n)))
    for name in ("linear", "extended", "imm", "mm_vel_est"):
        config = dataclasses.replace(default, estimator=dataclasses.replace(default.estimator, name=name))
        residual, times = follow(both[2], config)
        value = float(np.sqrt(np.mean(residual**2)))
        found.rows.append(FILTER.row(name, value, times, reference, margin=of_rms(value, n)))
    return found
