"""The hand on the demo scene: how far its track is from the drawing hand, and how long it is active."""

from __future__ import annotations

import numpy as np

from benchmarks.report import timed
from radar_dsp import Baseband, BasebandConfig
from radar_sim import Simulator, load_scene
from radar_tracking import HandTracker, PeopleTracker, TrackedCloud, Tracks, TrackStatus


def hand(quick: bool) -> dict[str, float]:
    """Follow the first hand that draws, started by the truth; quick: only five seconds around the start of the drawing.

    Returns ``hand_rms_m``: from the true hand [m]; ``hand_active``: share of the drawing with a hand track; ``hand_ms``: median per cloud
    while there is one.
    """
    simulator = Simulator(load_scene("demo"))
    baseband = Baseband(BasebandConfig(), simulator.info)
    people, tracker, person = PeopleTracker(info=simulator.info), HandTracker(), None
    errors: list[float] = []
    times: list[float] = []
    drawing = 0
    for k in range(simulator.n_frames)[1000:1250] if quick else range(simulator.n_frames):
        made = simulator.process(k)
        truth, cloud = made.truth, baseband.process(made.frame).to_room(simulator.info.mount)
        tracks = people.process(cloud)
        draws = np.flatnonzero(truth.drawing)
        if person is None and len(draws) and tracks.people_count:
            person = int(draws[0])
            tracker.start(_nearest(tracks, truth.position[person]), cloud.stamp_ns)
        found, spent = timed(tracker.process, TrackedCloud(cloud, tracks))
        if person is not None and truth.drawing[person]:
            drawing += 1
            if found is not None and found.active:
                times.append(spent)
                errors.append(float(((found.position - truth.hand_position[person]) ** 2).sum()))
    if not errors:
        return {}
    return {"hand_rms_m": float(np.sqrt(np.mean(errors))), "hand_active": len(errors) / drawing, "hand_ms": float(np.median(times))}


def _nearest(tracks: Tracks, position: np.ndarray[tuple[int, ...], np.dtype[np.float64]]) -> int:
    """Id of the person nearest to a place."""
    live = [t for t in tracks.tracks if t.status is not TrackStatus.TENTATIVE]
    return min(live, key=lambda t: float(np.hypot(*(t.position - position)[:2]))).id
