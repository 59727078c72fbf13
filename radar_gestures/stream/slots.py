"""What the points of each track do in each time slot: the inputs of `radar_gestures.stream.network.StreamNet`."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from radar_core import CloudComposite, PointCloud, Pose, RadarInfo
from radar_core.types import Float32Array, Float64Array
from radar_tracking.tracks import Track, TrackedCloud, TrackStatus

SLOT_NS: Final = 50_000_000
"""Length of a slot [ns]: the clouds of a slot are taken together, so that radars of any frame rate give the same inputs."""
SPEEDS: Final = (-2.8, -1.7, -1.0, -0.55, -0.25, 0.0, 0.25, 0.55, 1.0, 1.7, 2.8)
"""Range rates relative to the body at which a point counts fully [m/s]; between two of them it is shared, beyond it is at the last."""
_PER_SPEED: Final = ("strength", "range", "side", "height", "points")
_TOTALS: Final = ("slow strength", "strength", "distance", "azimuth", "body speed", "points", "fresh")
_RADAR: Final = ("elevation", "Doppler cell", "range cell", "interval")
NAMES: Final = (*(f"{name} at {speed:g}" for speed in SPEEDS for name in _PER_SPEED), *_TOTALS, *_RADAR)
"""What the inputs mean, in order."""
_N, _KINDS = len(SPEEDS), len(_PER_SPEED)
SPLIT: Final = _N * _KINDS
"""So many inputs belong to single speeds, shape (n_speeds, 5) = strength, range, side, height, points; the totals follow."""
FRESH: Final = NAMES.index("fresh")
"""The input that says whether a cloud came within the slot."""
ELEVATION: Final = NAMES.index("elevation")
"""The input that says whether the radar tells heights."""
SLOW: Final = slice(3, 8)
"""Of `SPEEDS`, those of a body."""
_FAST: Final = np.abs(SPEEDS) >= 1.0
_MIDDLE: Final = 1.1  # m: heights count from there
_FARTHEST: Final = 1.5  # m: no hand is farther from its body
_USUAL_SNR, _MOST_SNR = 10.0, 60.0  # dB: where the radar does not tell; more says no more
_NEAREST, _REFERENCE = 0.3, 2.0  # m: amplitudes are those of the same echo at the reference; nearer than the nearest they are not corrected
_TRACE: Final = 0.3  # amplitude of an echo that says little of where it comes from: places of weaker ones count as the body's
SETTLED: Final = 0.5
"""Age [s] from which a tentative track counts, where such tracks do."""
_FORGET: Final = 40  # slots without a cloud after which a stream begins anew


@dataclass(frozen=True, eq=False)
class Slot:
    """A slot of a track, as one sensor saw it.

    Attributes
    ----------
    track_id : int
        Whose.
    sensor : str
        frame_id of the sensor; empty where the cloud does not name its sensors.
    number : int
        It begins at ``number * SLOT_NS`` [ns].
    features : ndarray of float32, shape (n_features,)
        See `NAMES`.
    begins : bool
        Nothing is known of the slots before.
    position : ndarray of float64, shape (3,)
        Of the track, in ``room`` [m].
    """

    track_id: int
    sensor: str
    number: int
    features: Float32Array
    begins: bool
    position: Float64Array


@dataclass
class _Open:
    """The slot of a track that has not ended yet."""

    number: int
    sums: Float64Array = field(default_factory=lambda: np.zeros((_N, _KINDS)))  # strength; times range, side and height; points
    clouds: int = 0
    body: tuple[float, float, float] = (0.0, 0.0, 0.0)  # distance, azimuth, speed
    points: int = 0  # of the last cloud
    position: Float64Array = field(default_factory=lambda: np.zeros(3))


class SlotStreams:
    """Sums up the points of every track, for each sensor by itself, in slots of `SLOT_NS`.

    Parameters
    ----------
    info : RadarInfo
        The radar; of a fused cloud every sensor counts as of this kind, seen from its own mount.
    tentative : bool
        Whether tracks that are nobody yet count, from the age of `SETTLED` on: most that are flicker end before.
    """

    def __init__(self, info: RadarInfo, *, tentative: bool = False) -> None:
        self._mount, self._radar = info.mount, about_radar(info)
        self._settled = SETTLED if tentative else math.inf
        self._open: dict[tuple[int, str], _Open] = {}
        self._last: dict[tuple[int, str], Slot] = {}

    @property
    def track_ids(self) -> tuple[int, ...]:
        """Tracks that are being watched."""
        return tuple(dict.fromkeys(number for number, _ in self._open))

    def process(self, tracked: TrackedCloud) -> list[Slot]:
        """Take one cloud; return the slots that ended with it, in the order of the tracks.

        Slots without a cloud hold what the one before held, and say so (`FRESH`).
        """
        number = tracked.cloud.stamp_ns // SLOT_NS
        known = TrackStatus.CONFIRMED, TrackStatus.COASTING
        alive = {track.id for track in tracked.tracks.tracks if track.status in known or track.age > self._settled}
        self._open = {key: one for key, one in self._open.items() if key[0] in alive}
        self._last = {key: one for key, one in self._last.items() if key[0] in alive}
        ended: list[Slot] = []
        for sensor, mount, points, owner in _by_sensor(tracked, self._mount):
            for track in tracked.tracks.tracks:
                if track.id in alive:
                    key = (track.id, sensor)
                    one = self._open.get(key)
                    if one is not None and one.number != number:
                        ended.extend(self._close(key, one))
                        one = None
                    if one is None:
                        one = self._open[key] = _Open(number)
                    _add(one, points, owner == track.id, track, mount)
        return sorted(ended, key=lambda slot: (slot.number, slot.track_id))

    def _close(self, key: tuple[int, str], one: _Open) -> Iterator[Slot]:
        """Give the slots since the last one that was given, up to this one."""
        last = self._last.get(key)
        begins = last is None or not 0 < one.number - last.number <= _FORGET
        if last is not None and not begins:
            held = last.features.copy()
            held[FRESH] = 0.0
            for number in range(last.number + 1, one.number):
                yield Slot(*key, number, held, False, last.position)
        slot = Slot(*key, one.number, _features(one, self._radar), begins, one.position)
        self._last[key] = slot
        yield slot


_Sensed = tuple[str, Pose, Float64Array, np.ndarray[tuple[int, ...], np.dtype[np.int32]]]


def _by_sensor(tracked: TrackedCloud, mount: Pose) -> Iterator[_Sensed]:
    """Give each sensor's frame_id, mount, points, shape (n_points, 5) = x, y, z, range rate, SNR, and whose they are."""
    cloud, owner = tracked.cloud, tracked.tracks.point_track_id
    points = _columns(cloud)
    if not isinstance(cloud, CloudComposite) or not cloud.sources:
        yield "", mount, points, owner
        return
    for number, source in enumerate(cloud.sources):
        own = cloud.sensor == number
        yield source.frame_id, source.mount, points[own], owner[own]


def _columns(cloud: PointCloud) -> Float64Array:
    return np.stack([cloud.x, cloud.y, cloud.z, cloud.radial_speed, cloud.snr], axis=-1).astype(np.float64)


def _add(one: _Open, points: Float64Array, own: np.ndarray[tuple[int, ...], np.dtype[np.bool_]], track: Track, mount: Pose) -> None:
    """Add a cloud to a slot."""
    origin = np.asarray(mount.origin, np.float64)
    away = np.asarray(track.position, np.float64) - origin
    ground = max(float(np.hypot(away[0], away[1])), 1e-6)
    velocity = np.asarray(track.velocity, np.float64)[:2]
    velocity = np.where(np.isfinite(velocity), velocity, 0.0)
    one.clouds += 1
    one.body = (ground, float(np.arctan2(away[1], away[0])), float(np.hypot(*velocity)))
    one.position, one.points = np.asarray(track.position, np.float64), int(np.count_nonzero(own))
    if not one.points:
        return
    x, y, z, rate, snr = points[own].T
    way = np.stack([x - origin[0], y - origin[1], np.where(np.isfinite(z), z - origin[2], 0.0)], axis=-1)
    distance = np.maximum(np.linalg.norm(way, axis=1), 1e-6)
    relative = rate - (way[:, :2] / distance[:, None]) @ velocity
    share = spread(np.where(np.isfinite(relative), relative, 0.0))
    strong = amplitude(np.clip(np.where(np.isfinite(snr), snr, _USUAL_SNR), 0.0, _MOST_SNR), distance)
    side = (way[:, 1] * away[0] - way[:, 0] * away[1]) / ground
    height = np.where(np.isfinite(z), z - _MIDDLE, 0.0)
    weight = share * strong[:, None]
    values = np.stack([np.ones_like(side), distance - np.linalg.norm(away), side, height], axis=-1)
    one.sums[:, :4] += weight.T @ values
    one.sums[:, 4] += share.sum(axis=0)


def usual_amplitude(distance: Float64Array) -> Float64Array:
    """Give what a point counts whose radar does not tell how strong it is, by its distance, shape (n,) [m]."""
    return amplitude(np.array(_USUAL_SNR), distance)


def amplitude(level: Float64Array, distance: Float64Array) -> Float64Array:
    """Amplitude of the same echo 2 m away, by its SNR [dB] and distance [m], shape (...)."""
    return np.asarray(10.0 ** (level / 20.0) * (np.maximum(distance, _NEAREST) / _REFERENCE) ** 2)


def moving(features: Float32Array) -> bool:
    """Whether a slot, shape (n_features,), holds half a point a cloud or more that is faster than about 0.8 m/s relative to the body."""
    counts = np.expm1(features[_PER_SPEED.index("points") : SPLIT : _KINDS])
    return bool(counts[_FAST].sum() >= 0.5)


def spread(speed: Float64Array) -> Float64Array:
    """Share range rates, shape (...) [m/s], among `SPEEDS`, shape (..., n_speeds); the shares of each sum to 1."""
    centres = np.array(SPEEDS)
    v = np.clip(speed, centres[0], centres[-1])
    k = np.clip(np.searchsorted(centres, v) - 1, 0, _N - 2)
    upper = (v - centres[k]) / (centres[k + 1] - centres[k])
    share = np.zeros((*v.shape, _N))
    np.put_along_axis(share, k[..., None], (1.0 - upper)[..., None], axis=-1)
    np.put_along_axis(share, k[..., None] + 1, upper[..., None], axis=-1)
    return share


def _features(one: _Open, radar: Float64Array) -> Float32Array:
    return slot_features(one.sums, one.clouds, np.array(one.body), np.array(one.points), radar)


def slot_features(sums: Float64Array, clouds: int, body: Float64Array, points: NDArray[Any], radar: Float64Array) -> Float32Array:
    """Make the features of slots of sums over their points.

    Parameters
    ----------
    sums : ndarray of float64, shape (..., n_speeds, 5)
        At each of `SPEEDS`: amplitude, amplitude times range [m] before the body, side [m] and height [m], and how many points.
    clouds : int
        So many clouds are in the sums.
    body : ndarray of float64, shape (..., 3)
        Distance on the ground from the radar [m], azimuth [rad] and speed [m/s] of the body.
    points : ndarray, shape (...)
        Of the last cloud.
    radar : ndarray of float64, shape (4,)
        The last four of `NAMES`, see `about_radar`.

    Returns
    -------
    ndarray of float32, shape (..., n_features)
        See `NAMES`; of slots that hold a cloud.
    """
    strength = sums[..., 0]
    mean = np.clip(sums[..., 1:4] / (strength + _TRACE * clouds)[..., None], -_FARTHEST, _FARTHEST)
    each = np.concatenate([np.log1p(strength / clouds)[..., None], mean, np.log1p(sums[..., 4:] / clouds)], axis=-1)
    distance, azimuth, speed = np.moveaxis(body, -1, 0)
    totals = [np.log1p(strength[..., SLOW].sum(axis=-1) / clouds), np.log1p(strength.sum(axis=-1) / clouds)]
    totals += [distance / 3.0, azimuth, speed, np.log1p(points), np.ones_like(distance)]
    shape = strength.shape[:-1]
    parts = [each.reshape(*shape, -1), np.stack(totals, axis=-1), np.broadcast_to(radar, (*shape, len(radar)))]
    return np.concatenate(parts, axis=-1).astype(np.float32)


def about_radar(info: RadarInfo) -> Float64Array:
    """Say of which kind a radar is, shape (4,): whether it tells heights, and its Doppler cell, range cell and interval."""
    wave = info.waveform
    high = float(np.ptp(info.array.virtual[:, 1]) > 1e-6)
    return np.array([high, wave.speed_resolution / 0.5, wave.range_resolution / 0.5, wave.frame_interval / 0.05])
