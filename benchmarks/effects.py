"""Only the effects a scene calls for: what `effects: auto` leaves out of our scenes, what that saves, and that nothing else changes.

Every scene is simulated as it is written, with ``auto`` beside what it names, with all that real rooms and radars have, and with every
effect there is (`radar_sim.audit`). Times are those of one thread, frame by frame in turn; ``auto`` has to choose first, and that counts.

Agreement is between ``auto`` and all that is real, noise included and drawn alike, after the whole chain, in the quantity that the scene is
for. The tolerance is a relative rms error; so is each deviation here:

* detections: distance between the strongest detections of a frame, rms, over their rms range;
* tracks: distance between the two tracks of one person (and of a drawing hand), rms, over the rms range; and the share of frames in which
  the number of people differs;
* gestures: share of the recognised gestures that the other run does not have, by name and within 0.2 s.

Who is lost behind somebody else and found again is so by chance: where a run leaves the tolerance, all that is real is
simulated twice more with the noise drawn anew, and the rms deviation of these is the ``spread`` of the quantity. A choice of effects agrees
when it deviates by no more than the tolerance, or than another draw of the noise does.

What brings in something of its own (clutter, interference, channel errors, ...) is in both runs where a scene names it, else in neither: a
scene that does not name another radar has none.
"""

from __future__ import annotations

import math
import time
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from rich.console import Console
from rich.progress import track

from benchmarks.report import choices
from benchmarks.stores import once
from radar_lab.pipeline import Pipeline, PipelineResult
from radar_sim import Scene, Simulator, Truth
from radar_sim.audit import called_for, everything, ours, real
from radar_sim.auto import choose_effects
from radar_sim.effects.chain import NAMES
from radar_sim.probe import Probe

STAGE = "effects of scenes"
_GATE = 0.8  # distance beyond which a track is not that of a person [m], as gestures are matched
_SAME = 0.2
"""Time within which two gestures of one name are the same [s]: two clouds' worth of smoothing, and less than any pause between strokes."""


@dataclass
class Seen:
    """What the chain made of a scene, frame by frame."""

    strongest: list[NDArray[np.float64]] = field(default_factory=list)  # shape (3,): strongest detection in the sensor frame [m]; NaN: none
    # points, people: detections, and tracks of people
    points: list[int] = field(default_factory=list)
    people: list[int] = field(default_factory=list)
    # person, hand: shape (n_people, 2), (1, 3): track nearest to each person, and the hand, in ``room`` [m]; NaN: none
    person: list[NDArray[np.float64]] = field(default_factory=list)
    hand: list[NDArray[np.float64]] = field(default_factory=list)
    error: list[NDArray[np.float64]] = field(default_factory=list)  # shape (n_people,): from person to track [m]
    # name and middle [s] of every gesture recognised, movements that are none left out
    gestures: list[tuple[str, float]] = field(default_factory=list)

    def take(self, result: PipelineResult, truth: Truth) -> None:
        """Add a frame."""
        cloud = result.cloud
        best = int(np.argmax(cloud.snr)) if len(cloud) else -1
        nothing = np.full(3, np.nan)
        self.strongest.append(nothing if best < 0 else np.array([cloud.x[best], cloud.y[best], cloud.z[best]], np.float64))
        self.points.append(len(cloud))
        found = [track.position[:2] for track in result.tracks.people]
        self.people.append(len(found))
        apart = np.linalg.norm(truth.position[:, None, :2] - np.reshape(found, (1, -1, 2)), axis=-1)
        place, error = np.full((len(truth.person_id), 2), np.nan), np.full(len(truth.person_id), np.nan)
        for person, row in enumerate(apart):
            if len(found) and row.min() < _GATE:
                place[person], error[person] = found[int(row.argmin())], row.min()
        self.person.append(place)
        self.error.append(error)
        self.hand.append((nothing if result.hand is None or not result.hand.active else result.hand.position)[None])
        self.gestures += [(g.name, (g.start_ns + g.end_ns) * 0.5e-9) for g in result.gestures if g.name != "random"]


def chain(scene: Scene, radar: str, seconds: float = math.inf) -> Seen:
    """Simulate a scene and put it through the whole chain; where somebody draws, the hand of the nearest is followed."""
    simulator = Simulator(scene, radar)
    pipeline, seen = Pipeline(simulator.info), Seen()
    waiting = draws(scene)
    for k in range(min(simulator.n_frames, math.ceil(min(seconds / simulator.interval, 1e9)))):
        made = simulator.process(k)
        result = pipeline.process(made.frame)
        if waiting and result.tracks.people_count:
            pipeline.hand.start(None, result.tracks.stamp_ns)
            waiting = False
        seen.take(result, made.truth)
    return seen


def draws(scene: Scene) -> bool:
    """Whether somebody draws with a hand."""
    return any(action.draw is not None for person in scene.people for action in person.script)


def redrawn(scene: Scene, radar: str, times: int) -> tuple[Scene, str]:
    """Draw the noise of a radar anew and nothing else: it becomes a later one in the scene, by others that stand where the first does."""
    name = radar or scene.radars[0].frame_id
    others = tuple(replace(scene.radars[0], frame_id=f"other{k}/radar") for k in range(times))
    return replace(scene, radars=others + scene.radars), name


def deviation(scene: Scene, radar: str, one: Seen, other: Seen) -> dict[str, float]:
    """Compare two runs in the quantity that the scene is for; every figure is relative, see above."""
    mount = next(r for r in scene.radars if radar in ("", r.namespace)).mount
    if scene.purpose == "gestures":
        return {"gestures": unshared(one.gestures, other.gestures)}
    if scene.purpose == "tracks":
        parts = {
            "people": apart(np.array(one.person), np.array(other.person), mount.origin[:2]),
            "count": float(np.mean(np.array(one.people) != np.array(other.people))),
        }
        hands = np.array(one.hand), np.array(other.hand)
        return parts | ({"hand": apart(*hands, mount.origin)} if draws(scene) else {})
    return {"strongest": apart(np.array(one.strongest), np.array(other.strongest), np.zeros(3))}


def apart(one: NDArray[np.float64], other: NDArray[np.float64], origin: NDArray[np.float64]) -> float:
    """Rms distance of places [m] over the rms range from ``origin``; NaN: none; where only one has a place it counts as the range."""
    mine, yours = np.isfinite(one).all(-1), np.isfinite(other).all(-1)
    both = mine & yours
    if not (mine | yours).any():
        return 0.0
    if not both.any():
        return 1.0
    range_squared = float(((other[both] - origin) ** 2).sum(-1).mean())
    distance = float(((one[both] - other[both]) ** 2).sum()) / range_squared
    return math.sqrt((distance + float((mine ^ yours).sum())) / float((mine | yours).sum()))


def unshared(one: Sequence[tuple[str, float]], other: Sequence[tuple[str, float]]) -> float:
    """Share of the gestures of two runs that only one of them has."""
    left = list(other)
    for name, middle in one:
        partner = next((g for g in left if g[0] == name and abs(g[1] - middle) < _SAME), None)
        if partner:
            left.remove(partner)
    shared = len(other) - len(left)
    total = len(one) + len(other) - shared
    return 1.0 - shared / total if total else 0.0


def spent(simulator: Simulator, sequence: int) -> float:
    """Time of this thread for one frame [ms]: what else runs on the machine does not count."""
    start = time.thread_time_ns()
    simulator.process(sequence)
    return (time.thread_time_ns() - start) * 1e-6


def times(variants: dict[str, Simulator], frames: int) -> dict[str, list[float]]:
    """Time frames from all over a scene, all variants in turn [ms]."""
    n = next(iter(variants.values())).n_frames
    chosen = sorted({int((k + 0.5) * n / frames) for k in range(frames)})
    for simulator in variants.values():
        for k in chosen[:2]:
            simulator.process(k)  # compiled, and caches warm
    found: dict[str, list[float]] = {name: [] for name in variants}
    for turn, k in enumerate(chosen):
        names = list(variants)
        for name in names[turn % len(names) :] + names[: turn % len(names)]:
            found[name].append(spent(variants[name], k))
    return found


def measure(scene: Scene, radar: str, label: str, quick: bool) -> dict[str, Any]:
    """Measure one scene: times, agreement and what each effect costs."""
    wanted = called_for(scene)
    choose_effects(wanted, Simulator, radar)  # compiled
    start = time.thread_time_ns()
    auto = choose_effects(wanted, Simulator, radar).scene
    choosing = (time.thread_time_ns() - start) * 1e-9
    scenes = {"written": scene, "auto": auto, "real": real(scene), "everything": everything(scene)}
    simulators = {name: Simulator(made, radar) for name, made in scenes.items()}
    taken = times(simulators, 8 if quick else 100)
    n = simulators["auto"].n_frames
    seconds = 2.0 if quick else math.inf
    runs = {name: chain(scenes[name], radar, seconds) for name in ("auto", "real")}
    agreed = deviation(scene, radar, runs["auto"], runs["real"])
    spread = None
    if max(agreed.values()) > scene.tolerance:
        drawn = [deviation(scene, radar, chain(*redrawn(scenes["real"], radar, k), seconds), runs["real"]) for k in range(1, 3)]
        spread = {name: float(np.sqrt(np.mean([d[name] ** 2 for d in drawn]))) for name in agreed}
    error = {name: [*np.concatenate(run.error)] if run.error else [] for name, run in runs.items()}
    probe = Probe(scene, Simulator, radar)
    return {
        "label": label,
        "purpose": scene.purpose,
        "tolerance": scene.tolerance,
        "frames": n,
        "frame_ms": {name: float(np.mean(found)) for name, found in taken.items()},
        "times_ms": taken,
        "choosing_s": choosing,
        "deviation": agreed,
        "spread": spread,
        "agrees": all(value <= max(scene.tolerance, spread[name] if spread else 0.0) for name, value in agreed.items()),
        "points": {name: float(np.mean(run.points)) for name, run in runs.items()},
        "track_rmse_m": {name: float(np.sqrt(np.nanmean(np.square(e)))) for name, e in error.items() if np.isfinite(e).any()},
        "gestures": {name: len(run.gestures) for name, run in runs.items()},
        "cost_ms": {} if quick else {name: probe.cost(name, 5) for name in NAMES},
    }


def rows(found: dict[str, Any]) -> list[dict[str, Any]]:
    """Put agreement beside time; the reference is everything on."""
    own, label = found["times_ms"], found["label"]
    values = {f"{label}: real": 0.0, f"{label}: auto": max(found["deviation"].values())}
    times = {f"{label}: {name}": taken for name, taken in own.items()}
    return choices(STAGE, ("deviation from all that is real on", ""), values, times, f"{label}: everything")


def kept(label: str, scene: Scene, radar: str, quick: bool, keep: Path | None) -> dict[str, Any]:
    """Measure one scene, or read what an earlier run of the same kind left in a folder."""
    path = None if keep is None else keep / f"{label.replace(' ', '_')}{'_quick' if quick else ''}.json"
    return dict(once(path, lambda: measure(scene, radar, label, quick)))


def run(quick: bool, keep: Path | None = None) -> dict[str, Any]:
    """Measure every scene; quick: three of them."""
    some = ("single_target", "short", "two_crossing")
    chosen = [one for one in ours() if not quick or one[0] in some]
    shown = track(chosen, "simulating scenes", console=Console(stderr=True), transient=True)
    found = [kept(label, scene, radar, quick, keep) for label, scene, radar in shown]
    total = {name: sum(f["frames"] * f["frame_ms"][name] for f in found) * 1e-3 for name in found[0]["frame_ms"]}
    choosing = sum(f["choosing_s"] for f in found)
    figures = {
        "auto_over_all": (total["auto"] + choosing) / total["everything"],
        "auto_over_all_without_choosing": total["auto"] / total["everything"],
        "auto_over_real": (total["auto"] + choosing) / total["real"],
        "auto_choosing_s": choosing,
        **{f"total_s_{name}": value for name, value in total.items()},
        "scenes_that_agree": sum(f["agrees"] for f in found),
        "scenes_within_tolerance": sum(max(f["deviation"].values()) <= f["tolerance"] for f in found),
        "scenes_audited": len(found),
    }
    scenes = [{key: value for key, value in f.items() if key != "times_ms"} for f in found]
    return {**figures, "scenes": scenes, "choices": [row for f in found for row in rows(f)]}
