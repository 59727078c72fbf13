"""Hands followed: tracked clouds of simulated scenes, what a hand tracker makes of them, and how far that is from the truth."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray
from scipy.stats import chi2

from benchmarks.report import timed
from benchmarks.stores import Store, clouds_of, pack, room_effects, unpack
from radar_core import PointCloud, Pose, RadarInfo, merge
from radar_core.config import plain
from radar_core.linalg import canonical_svd
from radar_dsp import BasebandConfig
from radar_sim import Scene, Simulator, Truth
from radar_sim.people import Action, Draw, Person, Reach
from radar_sim.scene import SceneRadar
from radar_tracking import HandConfig, HandTracker, TrackedCloud, TrackerConfig, make_tracker
from radar_tracking.estimators import SnapshotVelocity
from radar_tracking.fusion.clouds import fused_info

Float64Array = NDArray[np.float64]

BASELINE: Final = 0.5  # from one radar to the other [m]
HEIGHT: Final = 1.2  # of both radars above the floor [m]
STAND: Final = 0.8  # how long everybody stands still before the hand begins [s]
DISTANCES: Final = (0.8, 1.2, 1.6, 2.0, 2.5)  # of the hand from the middle between the radars, one for each seed [m]
_OFFSET: Final = 5e-6  # s: the second radar sends that much later, so that their chirps do not meet
_ARM: Final = 0.5  # m: the hand draws that far in front of the body
_PALM: Final = 0.12  # m: what is seen within that of the hand's joint is hand; the mesh has nothing else there


@dataclass(frozen=True)
class Script:
    """What a hand does."""

    name: str
    duration: float  # of the scene [s]
    draws: tuple[Draw, ...] = ()  # one after the other; empty: the hand goes to and fro between places and rests there

    def actions(self, at: tuple[float, float, float]) -> tuple[Action, ...]:
        """Write the script of somebody whose hand draws around a place in the room [m]."""
        start = Action(stand=STAND)
        if self.draws:
            return (start, *(Action(draw=draw) for draw in self.draws))
        x, y, z = at
        places = [(x, y + side, z + up) for side, up in ((0.22, 0.0), (-0.2, 0.1), (0.15, -0.2), (0.15, 0.2), (-0.2, -0.1))]
        return (start, *(Action(reach=Reach(to=place, hold=0.5)) for place in places))


def _drawn(name: str, shape: str, size: float, speed: float, duration: float) -> Script:
    return Script(name, duration, (Draw(shape=shape, size=size, speed=speed, duration=duration - STAND),))


SCRIPTS: Final = (
    _drawn("slow line", "line_side", 0.25, 0.25, 6.8),
    _drawn("fast line", "line_side", 0.25, 1.3, 5.8),
    _drawn("circle", "circle", 0.25, 0.9, 5.8),
    Script("stop and go", 6.8),
    _drawn("slider", "line_up", 0.25, 0.4, 7.8),
)
"""What is measured."""
TUNING: Final = (
    _drawn("eight", "eight", 0.25, 1.0, 5.8),
    _drawn("slow circle", "circle", 0.2, 0.3, 5.8),
    _drawn("fast line up", "line_up", 0.25, 1.2, 5.8),
    _drawn("slow line side", "line_side", 0.2, 0.35, 5.8),
)
"""What filters are tuned on."""


def scene(script: Script, seed: int, distance: float, body: str = "mesh", offset: float = _OFFSET, noise: float = 15.0) -> Scene:
    """Put one person, drawn by a seed, before two radars, the hand at a distance [m]; the second one begins ``offset`` later [s]."""
    rng = np.random.default_rng([seed, 7])
    side = float(rng.uniform(-0.15, 0.15))
    person = Person(
        height=float(rng.uniform(1.6, 1.9)),
        sex=("male", "female")[int(rng.integers(2))],
        build=float(rng.uniform(0.2, 0.8)),
        arm=("right", "left")[int(rng.integers(2))],
        body=body,
        position=(distance + _ARM, side),
        heading=float(np.pi),
    )
    arm = 0.15 if person.arm == "right" else -0.15
    person = dataclasses.replace(person, script=script.actions((distance, side + arm, 0.62 * person.height)))
    radars = tuple(
        SceneRadar(frame_id=f"{name}/radar", mount=Pose(y=y, z=HEIGHT), trigger_offset=late)
        for name, y, late in (("left", BASELINE / 2, 0.0), ("right", -BASELINE / 2, offset))
    )
    return Scene(duration=script.duration, seed=seed, radars=radars, effects=room_effects(noise), people=(person,))


@dataclass(frozen=True, eq=False)
class Stream:
    """What one radar saw of a scene, and the truth at its clouds."""

    clouds: list[PointCloud]  # in the sensor's frame
    # shape (n_clouds, 3): of what the radar sees of the hand, elements weighted by their cross-section [m]; NaN: it sees nothing of it
    centroid: Float64Array
    weight: Float64Array  # shape (n_clouds,): the sum of those cross-sections [m^2]
    # hand, velocity, body: shape (n_clouds, 3): the hand's joint [m], its velocity [m/s], and the body's centre [m]
    hand: Float64Array
    velocity: Float64Array
    body: Float64Array
    drawing: NDArray[np.bool_]  # shape (n_clouds,): whether the hand draws or reaches


class HandStore(Store):
    """Streams of scenes in a folder, one file for each radar."""

    def __init__(self, folder: Path) -> None:
        super().__init__(folder, "hands", _simulate, [plain(BasebandConfig())])

    def fill(self, scenes: Sequence[Scene], *, n_jobs: int = 1, progress: bool = True) -> None:
        """Simulate what is not there yet."""
        self.make([(made, radar) for made in scenes for radar in range(len(made.radars))], n_jobs=n_jobs, progress=progress)

    def read(self, made: Scene, radar: int) -> Stream:
        """Read what one radar saw."""
        columns = self.columns(made, radar)
        truth = (columns[f"true_{name}"] for name in ("centroid", "weight", "hand", "velocity", "body", "drawing"))
        return Stream(unpack(columns, made.radars[radar].frame_id), *truth)


def visible(truth: Truth) -> tuple[Float64Array, float]:
    """Centroid of what a radar sees of the acting hand [m], and its cross-section towards the radar [m^2]; NaN and 0: nothing."""
    away = truth.scatterer_position.astype(np.float64) - truth.hand_position[0]
    own = (np.linalg.norm(away, axis=1) < _PALM) & (truth.scatterer_owner == 0)
    weight = truth.scatterer_rcs[own].astype(np.float64)
    total = float(weight.sum())
    return (truth.hand_position[0] + weight @ away[own] / total, total) if total > 0 else (np.full(3, np.nan), 0.0)


def _simulate(made: Scene, radar: int) -> dict[str, NDArray[Any]]:
    clouds, truths = clouds_of(Simulator(made, made.radars[radar].frame_id))
    seen = [visible(truth) for truth in truths]
    return pack(clouds) | {
        "true_centroid": np.array([place for place, _ in seen]),
        "true_weight": np.array([weight for _, weight in seen]),
        "true_hand": np.array([truth.hand_position[0] for truth in truths]),
        "true_velocity": np.array([truth.hand_velocity[0] for truth in truths]),
        "true_body": np.array([truth.position[0] for truth in truths]),
        "true_drawing": np.array([truth.drawing[0] for truth in truths]),
    }


MaskArray = NDArray[np.bool_]

TRIGGER: Final = STAND + 0.3  # when the hand is to be followed [s]: it comes up then
SETTLED: Final = STAND + 0.6  # from then on errors count [s]
FAST: Final = 0.6  # a hand faster than this is in a fast part [m/s]
SLOP: Final = 0.02  # clouds whose stamps are farther apart than this are not put together, as by the fusion node [s]
LOST: Final = 1.0  # error where there is no hand track although there is a hand [m]
_AFTER: Final = 0.3  # s: how long after a reversal one looks


@dataclass(frozen=True, eq=False)
class Tracked:
    """A scene up to the hand tracker, and what is true."""

    clouds: list[TrackedCloud]  # of both radars together, or of the first alone
    info: RadarInfo  # the radar that they seem to come from
    time: Float64Array  # shape (n,): of each cloud since the scene began [s]
    hand: Float64Array  # shape (n, 3): centroid of what the radars see of the hand [m]
    # joint, velocity: shape (n, 3): the hand's joint [m] and its velocity [m/s]
    joint: Float64Array
    velocity: Float64Array


@dataclass(frozen=True, eq=False)
class Followed:
    """What a hand tracker made of a scene; rows of clouds without a hand track are NaN."""

    # position, velocity: shape (n, 3): [m], [m/s]
    position: Float64Array
    velocity: Float64Array
    covariance: Float64Array  # shape (n, 6, 6): of both
    value: Float64Array  # shape (n,): control value
    snapshots: list[SnapshotVelocity | None]  # what each cloud alone said of the velocity
    spent_ms: list[float]  # what each cloud took [ms]

    @property
    def times_ms(self) -> list[float]:
        """What each cloud with a hand track took [ms]."""
        return [spent for spent, active in zip(self.spent_ms, np.isfinite(self.position[:, 0]), strict=True) if active]


def track(store: HandStore, scene: Scene, *, single: bool = False, second: Scene | None = None, clock_ns: int = 0) -> Tracked:
    """Fuse the clouds of a scene and track the person; ``single``: only the first radar.

    ``second``: what the second radar saw, where it measures at other times; ``clock_ns``: how much its clock is ahead [ns]: clouds are
    paired by what the clocks say, and left out without a partner.
    """
    streams = [store.read(second if second is not None and number else scene, number) for number in range(len(scene.radars))]
    n = min(len(stream.clouds) for stream in streams)  # the same for one radar, so that both can be compared cloud by cloud
    streams = streams[:1] if single else streams
    infos = [radar.info for radar in scene.radars[: len(streams)]]
    weight = np.stack([stream.weight[:n] for stream in streams])[..., None]
    seen = np.stack([np.nan_to_num(stream.centroid[:n]) for stream in streams])
    total = weight.sum(axis=0)
    with np.errstate(invalid="ignore"):
        hand = np.where(total > 0, (weight * seen).sum(axis=0) / total, streams[0].hand[:n])
    info = infos[0] if single else fused_info(infos)
    people, clouds, kept = make_tracker(TrackerConfig(), info), [], []
    for number, cloud in enumerate(streams[0].clouds[:n]):
        parts = [cloud, *(_nearest(stream.clouds, cloud.stamp_ns, clock_ns) for stream in streams[1:])]
        if abs(parts[-1].stamp_ns - cloud.stamp_ns) > SLOP * 1e9:
            continue
        fused = cloud.to_room(infos[0].mount) if single else merge(parts, [info.mount for info in infos], SLOP)
        clouds.append(TrackedCloud(fused, people.process(fused)))
        kept.append(number)
    seconds = np.array([cloud.cloud.stamp_ns for cloud in clouds]) * 1e-9
    return Tracked(clouds, info, seconds, hand[kept], streams[0].hand[kept], streams[0].velocity[kept])


def follow(tracked: Tracked, config: HandConfig | None = None, trigger: float = TRIGGER) -> Followed:
    """Follow the hand through a tracked scene, from a time on [s]."""
    tracker, n = HandTracker(config, tracked.info), len(tracked.clouds)
    tracker.start(None, round(trigger * 1e9))
    position, velocity = np.full((n, 3), np.nan), np.full((n, 3), np.nan)
    covariance, value = np.full((n, 6, 6), np.nan), np.full(n, np.nan)
    snapshots: list[SnapshotVelocity | None] = []
    times: list[float] = []
    for k, cloud in enumerate(tracked.clouds):
        hand, spent = timed(tracker.process, cloud)
        times.append(spent)
        snapshots.append(None if tracker.measured is None else tracker.measured.snapshot)
        if hand is not None and hand.active:
            position[k], velocity[k], covariance[k], value[k] = hand.position, hand.velocity, hand.covariance, hand.value
    return Followed(position, velocity, covariance, value, snapshots, times)


def counts(tracked: Tracked) -> MaskArray:
    """Clouds whose errors count."""
    return tracked.time >= SETTLED


def fast(tracked: Tracked) -> MaskArray:
    """Clouds of the fast parts that count."""
    return counts(tracked) & (np.linalg.norm(tracked.velocity, axis=1) > FAST)


def residual(tracked: Tracked, followed: Followed, axes: int = 3) -> Float64Array:
    """Distance of the track from the visible hand, in space (3) or on the floor plane (2), shape (n,) [m]; a lost hand is a metre off."""
    error = np.linalg.norm((followed.position - tracked.hand)[:, :axes], axis=1)
    return np.where(np.isnan(error), LOST, error)


def consistency(found: Sequence[tuple[Tracked, Followed]]) -> dict[str, float]:
    """Mean squared position error over what the track says it is, along each axis, and of all three per degree of freedom; 1 is honest."""
    error, told = [], []
    for tracked, followed in found:
        own = counts(tracked) & np.isfinite(followed.value)
        error.append((followed.position - tracked.hand)[own])
        told.append(followed.covariance[own, :3, :3])
    e, P = np.concatenate(error), np.concatenate(told)
    nees = (e * np.linalg.solve(P, e[..., None])[..., 0]).sum(axis=1) / 3.0
    by_axis = {name: float(np.mean(e[:, k] ** 2 / P[:, k, k])) for k, name in enumerate("xyz")}
    return by_axis | {"all": float(nees.mean()), "within_99_percent": float(np.mean(3.0 * nees < chi2.ppf(0.99, 3)))}


def lateral_std(tracked: Tracked, followed: Followed) -> Float64Array:
    """Tell how sure the snapshots are of the velocity across the line from the radars, shape (n,) [m/s]; infinite: not told."""
    found = np.full(len(tracked.clouds), np.inf)
    for k, snapshot in enumerate(followed.snapshots):
        if snapshot is None:
            continue
        x, y = tracked.hand[k, :2] - np.asarray(tracked.info.mount.origin)[:2]
        part = snapshot.axes @ (np.array([-y, x, 0.0]) / np.hypot(x, y))
        told = np.isfinite(snapshot.along)
        if float((part[~told] ** 2).sum()) < 0.1:  # nine tenths of what goes across are told
            found[k] = float(np.sqrt(((part[told] * snapshot.std[told]) ** 2).sum()))
    return found


def settling(tracked: Tracked, followed: Followed, bound: float = 0.1) -> list[float]:
    """Give how long after each reversal of a line the residual is above a bound, at most `_AFTER` [s]."""
    main = canonical_svd(tracked.velocity[counts(tracked)])[2][0]
    along = tracked.velocity @ main
    turns = np.flatnonzero((np.sign(along[1:]) != np.sign(along[:-1])) & counts(tracked)[1:]) + 1
    error, found = residual(tracked, followed), []
    for k in turns:
        after = (tracked.time >= tracked.time[k]) & (tracked.time < tracked.time[k] + _AFTER)
        peak = np.linalg.norm(tracked.velocity[after], axis=1).max(initial=0.0)
        if peak < FAST:  # it stopped, or wobbles about a rest
            continue
        above = np.flatnonzero(after & (error >= bound))
        found.append(float(tracked.time[above[-1]] - tracked.time[k]) if len(above) else 0.0)
    return found


def rms(values: Iterable[Float64Array]) -> float:
    """Root mean square of all together."""
    joined = np.concatenate([np.empty(0), *values])
    return float(np.sqrt(np.mean(joined**2))) if len(joined) else float("nan")


def percentile(values: Sequence[Float64Array], share: float = 95.0) -> float:
    """Percentile of all together."""
    joined = np.concatenate([np.empty(0), *values])
    return float(np.percentile(joined, share)) if len(joined) else float("nan")


def _nearest(clouds: Sequence[PointCloud], stamp_ns: int, clock_ns: int) -> PointCloud:
    """Pick the cloud whose stamp, by a clock that is ahead, is nearest to another; with the stamp of that clock."""
    apart = [abs(cloud.stamp_ns + clock_ns - stamp_ns) for cloud in clouds]
    found = clouds[int(np.argmin(apart))]
    return replace(found, stamp_ns=found.stamp_ns + clock_ns)
