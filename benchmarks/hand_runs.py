"""Hands followed: tracked clouds of simulated scenes, what a hand tracker makes of them, and how far that is from the truth."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.stats import chi2

from benchmarks.hand_clouds import STAND, HandStore
from benchmarks.report import timed
from radar_core import PointCloud, RadarInfo, merge
from radar_core.linalg import canonical_svd
from radar_sim import Scene
from radar_tracking import HandConfig, HandTracker, PeopleTracker, TrackedCloud, TrackerConfig
from radar_tracking.estimators import SnapshotVelocity
from radar_tracking.fusion.clouds import fused_info

Float64Array = NDArray[np.float64]
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
    times_ms: list[float]  # what each cloud with a hand track took [ms]


def track(store: HandStore, scene: Scene, *, single: bool = False, second: Scene | None = None, clock_ns: int = 0) -> Tracked:
    """Fuse the clouds of a scene and track the person.

    ``store``: that holds the scene; ``scene``: which; ``single``: only the first radar; ``second``: what the second radar saw, where it is
    not the same scene: one in which it measures at other times; ``clock_ns``: how much the second radar's clock is ahead [ns]: clouds are
    paired by what the clocks say; those without a partner are left out.
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
    people, clouds, kept = PeopleTracker(TrackerConfig(), info), [], []
    for number, cloud in enumerate(streams[0].clouds[:n]):
        parts = [cloud, *(_nearest(stream.clouds, cloud.stamp_ns, clock_ns) for stream in streams[1:])]
        if abs(parts[-1].stamp_ns - cloud.stamp_ns) > SLOP * 1e9:
            continue
        fused = cloud.to_room(infos[0].mount) if single else merge(parts, [info.mount for info in infos], SLOP)
        clouds.append(TrackedCloud(fused, people.process(fused)))
        kept.append(number)
    seconds = np.array([cloud.cloud.stamp_ns for cloud in clouds]) * 1e-9
    return Tracked(clouds, info, seconds, hand[kept], streams[0].hand[kept], streams[0].velocity[kept])


def follow(tracked: Tracked, config: HandConfig | None = None) -> Followed:
    """Follow the hand through a tracked scene, from `TRIGGER` on."""
    tracker, n = HandTracker(config, tracked.info), len(tracked.clouds)
    tracker.start(None, round(TRIGGER * 1e9))
    position, velocity = np.full((n, 3), np.nan), np.full((n, 3), np.nan)
    covariance, value = np.full((n, 6, 6), np.nan), np.full(n, np.nan)
    snapshots: list[SnapshotVelocity | None] = []
    times: list[float] = []
    for k, cloud in enumerate(tracked.clouds):
        hand, spent = timed(tracker.process, cloud)
        snapshots.append(None if tracker.measured is None else tracker.measured.snapshot)
        if hand is not None and hand.active:
            position[k], velocity[k], covariance[k], value[k] = hand.position, hand.velocity, hand.covariance, hand.value
            times.append(spent)
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
