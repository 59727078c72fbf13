"""The hand: how far its track is from the hand, by number of radars and by filter, beside the time of a moment."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from benchmarks.hand_runs import LOST, SLOP
from benchmarks.report import Found, Panel, of_rms, timed
from benchmarks.tradeoff.people import short
from benchmarks.tradeoff.stages import StudyConfig
from radar_core import RadarFrame, RadarInfo, merge
from radar_core.config import load, nest
from radar_dsp import Baseband, BasebandConfig
from radar_sim import Simulator
from radar_tracking import HandConfig, HandTracker, PeopleTracker, TrackedCloud
from radar_tracking.fusion.clouds import fused_info

_TRIGGER_NS, _SETTLED = 800_000_000, 1.3  # ns, s: the hand is followed from there on; its errors count from there on
_SAME = 0.2  # s: residuals this near tell the same, because the hand goes some 0.1 m meanwhile
RADARS = Panel("number of radars", "hand residual (rms)", "m", "lower", "1 radar", "baseband and people tracking of one radar")
FILTER = Panel("hand filter", "hand residual (rms)", "m", "lower", "mm_vel_est", "baseband and people tracking of one radar")


class Stream:
    """A drawing hand up to the hand tracker, as one radar sees it or several; what came before took ``before_ms``."""

    def __init__(self, infos: Sequence[RadarInfo]) -> None:
        self.info = infos[0] if len(infos) == 1 else fused_info(infos)
        self.clouds: list[TrackedCloud] = []
        self.before_ms: list[float] = []
        self._mounts, self._people = [info.mount for info in infos], PeopleTracker(None, self.info)
        self._basebands = [Baseband(BasebandConfig(), info) for info in infos]

    def take(self, frames: Sequence[RadarFrame]) -> None:
        """Process one moment's frames; those of more radars than these are left out."""
        cloud, spent = timed(self._process, frames)
        self.clouds.append(cloud)
        self.before_ms.append(spent)

    def _process(self, frames: Sequence[RadarFrame]) -> TrackedCloud:
        parts = [baseband.process(frame) for baseband, frame in zip(self._basebands, frames, strict=False)]
        room = parts[0].to_room(self.info.mount) if len(parts) == 1 else merge(parts, self._mounts, SLOP)
        return TrackedCloud(room, self._people.process(room))


@lru_cache(maxsize=2)
def streams(study: StudyConfig) -> tuple[tuple[Stream, Stream], NDArray[np.float64], NDArray[np.float64]]:
    """Simulate the drawing hand, seen by one radar and by both; times (n,) [s], and true hand (n, 3) [m], NaN: it does not draw."""
    scene = short(study.scene or "two_radars", study.seed, study.scene is None, radars=2)
    simulators = [Simulator(scene, radar.frame_id) for radar in scene.radars[:2]]
    infos, time, hand = [simulator.info for simulator in simulators], [], []
    both = Stream(infos[:1]), Stream(infos)
    for k in range(min(*(simulator.n_frames for simulator in simulators), round(study.pick(4.5, 8.5) / simulators[0].interval))):
        made = [simulator.process(k) for simulator in simulators]
        for stream in both:
            stream.take([one.frame for one in made])
        truth = made[0].truth
        time.append(truth.stamp_ns * 1e-9)
        hand.append(truth.hand_position[0] if truth.drawing[0] else np.full(3, np.nan))
    return both, np.array(time), np.array(hand)


def follow(stream: Stream, config: HandConfig, hand: NDArray[np.float64], counts: NDArray[np.bool_]) -> tuple[float, list[float]]:
    """Follow the hand; rms of the residuals of the moments that count [m], and times of all moments [ms]."""
    tracker = HandTracker(config, stream.info)
    tracker.start(None, _TRIGGER_NS)
    found, times = zip(*(timed(tracker.process, cloud) for cloud in stream.clouds), strict=True)
    place = np.array([one.position if one is not None and one.active else np.full(3, np.nan) for one in found])
    residual = np.linalg.norm((place - hand)[counts], axis=1)
    return float(np.sqrt(np.mean(np.where(np.isnan(residual), LOST, residual) ** 2))), list(times)


def measure(study: StudyConfig) -> Found:
    """Compare one radar with two, and the filters with each other, on the same drawing hand."""
    found, default = Found(), HandConfig()
    both, time, hand = streams(study)
    counts = (time >= _SETTLED) & np.isfinite(hand[:, 0])
    if not counts.any():
        found.leave_out(RADARS.name, "all", f"nobody draws with a hand after {_SETTLED:g} s; choose a scene such as two_radars")
        return found
    n, reference = max(round((time[-1] - _SETTLED) / _SAME), 1), both[0].before_ms

    def add(panel: Panel, name: str, stream: Stream, config: HandConfig, before: Sequence[float] = (0.0,)) -> None:
        value, times = follow(stream, config, hand, counts)
        found.rows.append(panel.row(name, value, np.add(before, times).tolist(), reference, margin=of_rms(value, n)))

    for name, stream in zip(("1 radar", "2 radars"), both, strict=True):
        add(RADARS, name, stream, default, stream.before_ms)
    for name in ("linear", "extended", "imm", "mm_vel_est"):
        add(FILTER, name, both[1], load(HandConfig, nest({"estimator.name": name})))
    return found
