"""What bandwidth gives and costs (thesis, 8.2): a tone without range, and 0.25 to 4 GHz, by the same array in the same time.

A person who gestures: direction and range rate of what moves, as gestures are made of them. A hand that draws in front of a person: its
track, which needs ranges. Two people who come side by side, one of them 0.4 m behind the other: whether each has a track. Chirps, pauses
and frames are those of table 3.1. A sweep has 64 samples for each GHz, so that all see 9.6 m far; the tone has 64, which are added. All
else is default: the CFAR's window has as many cells whatever a cell is wide. One radar; people are of ellipsoids.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from benchmarks.hand_runs import DISTANCES, HEIGHT, SCRIPTS, TRIGGER, Tracked, follow, residual, rms, visible
from benchmarks.hand_runs import scene as hand_scene
from benchmarks.report import against_first, share_interval, timed
from benchmarks.stores import room_effects
from radar_core import NO_GESTURE, PointCloud, Pose, Waveform
from radar_core.geometry import cartesian_to_spherical
from radar_dsp import Baseband, BasebandConfig
from radar_gestures.features import FeatureConfig, summarise
from radar_sim import Scene, Simulator, Truth
from radar_sim.people import Action, Person, Walk
from radar_sim.scene import SceneRadar
from radar_tracking import TrackedCloud, Tracks, make_tracker

Float64Array = NDArray[np.float64]

WAVEFORMS: Final[Mapping[str, Waveform]] = {
    "CW": Waveform(modulation="cw"),
    "CW, 200 Hz": Waveform(modulation="cw", frame_interval=5e-3, n_chirp=20),  # frames of 4.6 ms
    **{f"{bandwidth:g} GHz": Waveform(bandwidth=bandwidth * 1e9, n_sample=round(64 * bandwidth)) for bandwidth in (0.25, 1, 2, 4)},
}
_FIRST: Final = 21  # seed of the figure's first scene; it was developed on scenes from 101 on, and on 1 to 12
_DRAWN: Final = ("fast line", "circle")
_GESTURES: Final = ("swipe_left", "swipe_up", "push")
_SCENES: Final = (4, 6, 8)  # with gestures, with a hand that draws, with two people
_APART: Final = (0.4, 0.45)  # m: two people in range, and side by side, which is less than a beam at the distances where they stand
_START, _STAND, _SPEED = 5.0, 2.4, 1.0  # m, m, m/s: where they come from, where the first one stands, how fast they come
_ALIKE: Final = 100.0  # m: points beside the body count as others, because a tone cannot tell them
_SETTLE: Final = 0.3  # s: after the hand is asked for, errors count
_GATE: Final = 0.3  # m: a track that near on the floor is a person's


@dataclass
class Seen:
    """What one waveform gave in all scenes."""

    rate: list[Float64Array] = field(default_factory=list)  # errors of the hand's range rate [m/s]
    azimuth: list[Float64Array] = field(default_factory=list)  # and of its azimuth [rad]
    found: list[NDArray[np.bool_]] = field(default_factory=list)  # frames with a moving hand: whether anything moves in the cloud
    hand: list[Float64Array] = field(default_factory=list)  # errors of its track [m]
    person_s: list[float] = field(default_factory=list)  # when its person had a confirmed track [s]
    both: list[float] = field(default_factory=list)  # share of each scene's frames in which each of two people has a track
    points: list[int] = field(default_factory=list)
    times_ms: list[float] = field(default_factory=list)  # of the baseband


def clouds_of(scene: Scene, seen: Seen) -> tuple[list[PointCloud], list[Truth], SceneRadar]:
    """Simulate a scene and put its frames through the baseband; clouds are in the sensor's frame."""
    simulator = Simulator(scene)
    baseband, clouds, truths = Baseband(BasebandConfig(), simulator.info), [], []
    for number in range(simulator.n_frames):
        one = simulator.process(number)
        cloud, spent = timed(baseband.process, one.frame)
        clouds.append(cloud)
        truths.append(one.truth)
        seen.times_ms.append(spent)
        seen.points.append(len(cloud))
    return clouds, truths, scene.radars[0]


def drawn(number: int, waveform: Waveform) -> Scene:
    """Put one person with a drawing hand before one radar."""
    script = next(one for one in SCRIPTS if one.name == _DRAWN[number % len(_DRAWN)])
    scene = hand_scene(script, number, DISTANCES[number // len(_DRAWN) % len(DISTANCES)], "ellipsoids")
    return replace(scene, radars=(SceneRadar(mount=Pose(z=HEIGHT), waveform=waveform),))


def gestures(number: int, waveform: Waveform) -> Scene:
    """Put one person who gestures before one radar, at a distance that the number says; two of the three gestures go across."""
    rng = np.random.default_rng([number, 81])
    script = (Action(stand=0.5), *(Action(gesture=name) for name in _GESTURES))
    person = Person(
        height=float(rng.uniform(1.6, 1.9)),
        arm=("right", "left")[int(rng.integers(2))],
        position=(1.5 + 0.3 * (number % 6), float(rng.uniform(-0.5, 0.5))),
        script=script,
    )
    radar = SceneRadar(mount=Pose(z=HEIGHT), waveform=waveform)
    return Scene(duration=12.0, seed=number, radars=(radar,), people=(person,), effects=room_effects())


def motion(clouds: Sequence[PointCloud], truths: Sequence[Truth], radar: SceneRadar, seen: Seen) -> None:
    """Compare what moves in each cloud, by `summarise` as for gestures, with the hand, where that comes or goes fast enough to count."""
    config, rate, azimuth, found = FeatureConfig(lateral=_ALIKE), [], [], []
    origin = np.asarray(radar.mount.origin)
    for cloud, truth in zip(clouds, truths, strict=True):
        away = truth.hand_position[0] - origin
        speed = float(truth.hand_velocity[0] @ away / np.linalg.norm(away))
        if truth.gesture[0] == NO_GESTURE or abs(speed) < config.body_speed:
            continue
        body = cartesian_to_spherical(radar.mount.from_room(truth.position[0]))
        hand = cartesian_to_spherical(radar.mount.from_room(truth.hand_position[0]))
        sample = summarise(cloud, (float(body[0]), float(body[1]), float(body[2])), config)
        found.append(sample.weight > 0)
        if sample.weight > 0 and math.isfinite(sample.azimuth):
            rate.append(sample.speed - speed)
            azimuth.append(sample.azimuth - float(hand[1]))
    seen.rate.append(np.array(rate))
    seen.azimuth.append(np.array(azimuth))
    seen.found.append(np.array(found, np.bool_))


def tracked(clouds: Sequence[PointCloud], radar: SceneRadar) -> list[tuple[PointCloud, Tracks]]:
    """Level clouds and track people through them."""
    tracker = make_tracker(None, radar.info)
    levelled = [cloud.to_room(radar.mount) for cloud in clouds]
    return [(cloud, tracker.process(cloud)) for cloud in levelled]


def hand_error(clouds: Sequence[PointCloud], truths: Sequence[Truth], radar: SceneRadar, seen: Seen) -> None:
    """Follow the hand once the person has a track; errors against what is seen of it, a metre where it is lost."""
    places = np.array([visible(truth)[0] for truth in truths])
    joint = np.array([truth.hand_position[0] for truth in truths])
    both = [TrackedCloud(cloud, tracks) for cloud, tracks in tracked(clouds, radar)]
    time = np.array([cloud.stamp_ns for cloud in clouds]) * 1e-9
    velocity = np.array([truth.hand_velocity[0] for truth in truths])
    made = Tracked(both, radar.info, time, np.where(np.isnan(places), joint, places), joint, velocity)
    first = next((at for at, one in zip(time, both, strict=True) if list(one.tracks.people)), float(time[-1]))
    start = max(first, TRIGGER)
    seen.person_s.append(float(first))
    seen.hand.append(residual(made, follow(made, trigger=start))[time >= start + _SETTLE])


def two(number: int, waveform: Waveform) -> Scene:
    """Let two people come towards the radar, one 0.4 m behind the other and a step beside, and stand."""
    rng = np.random.default_rng([number, 82])
    side, angle = (1.0, -1.0)[int(rng.integers(2))], float(rng.uniform(-0.25, 0.25))
    people = []
    for index, (behind, beside) in enumerate(((0.0, -0.5), (_APART[0], 0.5))):

        def place(distance: float, beside: float = beside, behind: float = behind) -> tuple[float, float]:
            x, y = distance + behind, side * beside * _APART[1]
            return (x * math.cos(angle) - y * math.sin(angle), x * math.sin(angle) + y * math.cos(angle))

        people.append(
            Person(
                id=index + 1,
                height=float(rng.uniform(1.6, 1.9)),
                sex=("male", "female")[int(rng.integers(2))],
                position=place(_START),
                script=(Action(walk=Walk(to=place(_STAND), speed=_SPEED)), Action(stand=2.0)),
            )
        )
    radar = SceneRadar(mount=Pose(z=HEIGHT), waveform=waveform)
    return Scene(duration=5.0, seed=number, radars=(radar,), people=tuple(people), effects=room_effects())


def both_tracked(clouds: Sequence[PointCloud], truths: Sequence[Truth], radar: SceneRadar, settle: float = 1.0) -> float:
    """Share of the frames after a while [s] in which each of two people has a confirmed track of their own."""
    good = []
    for (cloud, tracks), truth in zip(tracked(clouds, radar), truths, strict=True):
        if cloud.stamp_ns * 1e-9 < settle:
            continue
        places = np.array([track.position[:2] for track in tracks.people]).reshape(-1, 2)
        near = np.linalg.norm(places[None] - truth.position[:, None, :2], axis=2) < _GATE
        good.append(bool(near.any(axis=1).all() and np.count_nonzero(near.any(axis=0)) >= 2))
    return float(np.mean(good))


def seen_by(waveform: Waveform, first: int, n: Sequence[int]) -> Seen:
    """Play to one waveform so many scenes with gestures, with a hand and with two people; a tone only the first."""
    seen, (n_gestures, n_hand, n_two) = Seen(), n if waveform.modulation != "cw" else (n[0], 0, 0)
    for number in range(first, first + n_gestures):
        motion(*clouds_of(gestures(number, waveform), seen), seen)
    for number in range(first, first + n_hand):
        hand_error(*clouds_of(drawn(number, waveform), Seen()), seen)
    seen.both = [both_tracked(*clouds_of(two(number, waveform), Seen())) for number in range(first, first + n_two)]
    return seen


def figures(waveform: Waveform, seen: Seen) -> dict[str, Any]:
    """Tell what a waveform is, what it gave, and what it cost; None: it has no ranges."""
    error, errors = np.concatenate(seen.hand) if seen.hand else None, np.concatenate
    n_apart = sum(share >= 0.5 for share in seen.both)
    size = 8 * waveform.n_tx * 4 * waveform.n_chirp * waveform.n_sample
    return {
        "range_cell_m": waveform.range_resolution if math.isfinite(waveform.range_resolution) else None,
        "speed_cell_m_s": waveform.speed_resolution,
        "rate_rms_m_s": rms(seen.rate),
        "azimuth_rms_deg": math.degrees(rms(seen.azimuth)),
        "azimuth_median_deg": math.degrees(float(np.median(np.abs(errors(seen.azimuth))))),
        "motion_found": float(np.mean(errors(seen.found))),
        "hand_median_m": None if error is None else float(np.median(error)),
        "hand_rms_m": None if error is None else rms([np.minimum(error, 1.0)]),
        "person_found_s": float(np.mean(seen.person_s)) if seen.person_s else None,
        "hand_lost": None if error is None else float(np.mean(error >= 1.0)),
        "two_people_share": float(np.mean(seen.both)) if seen.both else None,
        "two_people_scenes": n_apart if seen.both else None,
        "two_people_interval": list(share_interval(n_apart, len(seen.both))) if seen.both else None,
        "points": float(np.mean(seen.points)),
        "baseband_ms": float(np.median(seen.times_ms)),
        "baseband_ms_per_s": float(np.median(seen.times_ms)) / waveform.frame_interval,
        "frame_bytes": size,
        "megabytes_per_s": size / waveform.frame_interval * 1e-6,
    }


def measure(first: int, n: Sequence[int]) -> dict[str, Any]:
    """Measure all waveforms on scenes with the seeds from ``first`` on."""
    found = {name: seen_by(waveform, first, n) for name, waveform in WAVEFORMS.items()}
    made = {name: figures(WAVEFORMS[name], seen) for name, seen in found.items()}
    rows = against_first(
        "waveform", "rms error of the hand's azimuth", {n: (made[n]["azimuth_rms_deg"], s.times_ms) for n, s in found.items()}, "deg"
    )
    ranged = {name: seen for name, seen in found.items() if seen.hand}
    for stage, key, unit in (("hand's track", "hand_median_m", "m"), ("two people", "two_people_share", "")):
        rows += against_first(stage, key, {name: (made[name][key], seen.times_ms) for name, seen in ranged.items()}, unit)
    return {"scenes": dict(zip(("gestures", "hand", "two people"), n, strict=True)), "waveforms": made, "choices": rows}


def run(quick: bool) -> dict[str, Any]:
    """Compare the waveforms; quick: one scene of each kind, of those that the study was developed on.

    Returns ``waveforms`` (by name: cells, errors, shares, milliseconds of the baseband and megabytes), ``choices``.
    """
    return measure(101, (1, 1, 1)) if quick else measure(_FIRST, _SCENES)
