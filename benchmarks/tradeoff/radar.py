"""Frame rate and number of transmitters: GOSPA of the people, beside the time that a second of radar takes."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from benchmarks.report import Found, Panel, timed
from benchmarks.tradeoff.config import StudyConfig
from benchmarks.tradeoff.people import Judge, frames, rows, scenes, track, visible
from radar_core import RadarFrame, RadarInfo
from radar_core.transmitters import one_transmitter, one_transmitter_frame
from radar_dsp import Baseband, BasebandConfig
from radar_tracking import PeopleTracker, TrackerConfig, Tracks

RATE = Panel("frame rate", "mean GOSPA", "m", "lower", "50 Hz", "the same at 50 Hz")
TRANSMITTERS = Panel("number of transmitters", "mean GOSPA", "m", "lower", "2 transmitters", "baseband and tracking with 2 transmitters")


def _rates(study: StudyConfig) -> Found:
    """Take every n-th cloud; times are of baseband and tracking for one second of radar."""
    found, reference, default = Found(), [0.0], Judge()
    for every in (1, 2, 3, 5):
        judges, interval, baseband = track({"": TrackerConfig()}, study, every)
        judge, rate = judges[""], 1.0 / interval
        times = (rate * np.add(baseband, judge.times_ms)).tolist()
        reference, default = (times, judge) if every == 1 else (reference, default)
        name = "50 Hz" if every == 1 and round(rate) == 50 else f"{rate:.3g} Hz"
        found.rows.append(RATE.row(name, judge.mean, times, reference, margin=judge.margin(default)))
    return found


def _track(baseband: Baseband, tracker: PeopleTracker, frame: RadarFrame, info: RadarInfo) -> Tracks:
    return tracker.process(baseband.process(frame).to_room(info.mount))


def _transmitters(study: StudyConfig) -> Found:
    """Keep the chirps of the first transmitter of the same frames."""
    judges: dict[str, Judge] = {}
    found = Found()
    for scene in scenes(study):
        info, simulated = frames(scene, study)
        if info.waveform.n_tx == 1:
            found.leave_out(TRANSMITTERS.name, "2 transmitters", f"the radar of {scene} has one transmitter")
            return found
        infos = {f"{info.waveform.n_tx} transmitters": info, "1 transmitter": one_transmitter(info)}
        chains = {name: (Baseband(BasebandConfig(), one), PeopleTracker(None, one)) for name, one in infos.items()}
        for made in simulated:
            seen = visible(made.truth, info)
            for name, (baseband, tracker) in chains.items():
                frame = made.frame if name != "1 transmitter" else one_transmitter_frame(made.frame, info)
                tracks, spent = timed(_track, baseband, tracker, frame, info)
                judge = judges.setdefault(name, Judge())
                judge.times_ms.append(spent)
                judge.compare(scene, made.truth, seen, tracks)
    panel = replace(TRANSMITTERS, default=next(iter(judges)))  # a user's scene may have more
    return Found(rows(panel, judges), found.left_out)


def measure(study: StudyConfig) -> Found:
    """Compare frame rates and numbers of transmitters on the same scenes."""
    return _rates(study) + _transmitters(study)
