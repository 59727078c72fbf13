"""Streams of slots of lives that no sample was simulated of: bodies are point targets of a simple radar.

A life takes a tenth of a second, a fortieth of the time that simulating it takes. Networks learn most of what arms do from many of these,
and then, from fewer of `radar_lab.datasets.lives`, what radars, walls, clutter and the tracker make of it. Nothing is measured on them.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from joblib import Parallel, delayed
from threadpoolctl import threadpool_limits

from radar_core import GESTURES, ConfigError, RadarInfo
from radar_core.types import BoolArray, Float32Array, Float64Array, IndexArray
from radar_gestures.stream.slots import FRESH, SLOT_NS, SPEEDS, about_radar, amplitude, slot_features, spread
from radar_lab.datasets.body_targets import levels, placed, seen_from, shadows
from radar_lab.datasets.life_scenes import DURATION, life_scene
from radar_lab.datasets.life_strokes import gesture_of
from radar_lab.datasets.point_radar import Echoes, PointRadar, Targets
from radar_lab.training.slot_sequences import EDGE_NS, EDGE_WEIGHT, SlotSequence
from radar_sim import Scene
from radar_sim.bodies.base import Pose
from radar_sim.world import World

OFTEN: Final = 0.65
"""Share of what people do that is a gesture."""
_STREAM: Final = 77  # keeps quick lives apart from other scenes with the same seed
_TRIES: Final = 30  # draws of a scene until one is possible
_SLOT: Final = SLOT_NS * 1e-9  # s
_SPAN: Final = 4e-3  # s: range rates are of so long
_LEVEL: Final = (14.0, 44.0)  # dB: of a trunk 2 m away, over all waveforms, noise figures and losses
_GATE: Final = 1.0  # m: points farther from a body are nobody's
_MIDDLE: Final = 1.1  # m: heights count from there, as in slots
_MOST_SNR: Final = 60.0  # dB, as in slots


def quick_lives(number: int, *, seed: int = 1, gestures: float = OFTEN, first: int = 0, n_jobs: int = 1) -> list[SlotSequence]:
    """Make the sequences of quick lives ``first`` to ``first + number``; they depend on the seed and their number only.

    Parameters
    ----------
    number, first : int
        Of lives; one without a possible scene is left out.
    seed : int
        Of all draws.
    gestures : float
        Share of what people do that is a gesture, see `life_scene`.
    n_jobs : int
        Lives that are made at the same time.
    """
    made = Parallel(n_jobs=n_jobs)(delayed(quick_life)(k, seed, gestures) for k in range(first, first + number))
    return [sequence for life in made for sequence in life]


def quick_life(number: int, seed: int = 1, gestures: float = OFTEN) -> list[SlotSequence]:
    """Make the sequences of one quick life, one of each person; none: thirty draws gave no possible scene."""
    rng = np.random.default_rng([_STREAM, seed, number])
    for _ in range(_TRIES):
        try:
            scene = life_scene(number, rng, gestures=gestures)
            with threadpool_limits(1):
                return _sequences(scene, World(scene), rng)
        except ConfigError:  # a way through somebody: the next draw is another one
            continue
    return []


def _sequences(scene: Scene, world: World, rng: np.random.Generator) -> list[SlotSequence]:
    info = scene.radars[0].info
    origin = np.asarray(info.mount.origin, np.float64)
    middle: Float64Array = (np.arange(round(DURATION / _SLOT), dtype=np.float64) + 0.5) * _SLOT
    before, after = world.skeletons(middle - _SPAN / 2), world.skeletons(middle + _SPAN / 2)
    trunks = [_centre(one) - origin for one in before]
    level, radar = rng.uniform(*_LEVEL), PointRadar(info, rng)
    found = []
    for k, (earlier, later) in enumerate(zip(before, after, strict=True)):
        targets = seen_from(origin, placed(earlier), placed(later), _SPAN, level + levels(rng))
        dark = shadows(targets, trunks[k], trunks[:k] + trunks[k + 1 :])
        targets = Targets(targets.range, targets.azimuth, targets.elevation, targets.rate, targets.level + dark)
        features = _features(radar, targets, trunks[k], info)
        found.append(SlotSequence(features, *_labels(scene, world, k, middle)))
    return found


def _centre(pose: Pose) -> Float64Array:
    return np.asarray(pose.centre, np.float64)


def _features(radar: PointRadar, targets: Targets, trunk: Float64Array, info: RadarInfo) -> Float32Array:
    """Features of the slots of one body, whose trunk is there, shape (T, 3), from the sensor [m]."""
    interval = info.waveform.frame_interval
    clouds, about = max(1, round(_SLOT / interval)), about_radar(info)
    velocity = np.gradient(trunk[:, :2], _SLOT, axis=0)
    sums, points = np.zeros((len(trunk), len(SPEEDS), 5)), np.zeros(len(trunk))
    for _ in range(clouds):
        points = np.zeros(len(trunk))
        for echoes in radar.process(targets):
            own = _add(sums, echoes, trunk, velocity, info.mount.z - _MIDDLE if about[0] else None)
            points += own.sum(axis=1)
    body = np.column_stack([np.hypot(trunk[:, 0], trunk[:, 1]), np.arctan2(trunk[:, 1], trunk[:, 0]), np.hypot(*velocity.T)])
    return _held(slot_features(sums, clouds, body, points, about), interval)


def _add(sums: Float64Array, echoes: Echoes, trunk: Float64Array, velocity: Float64Array, height: float | None) -> BoolArray:
    """Add the points of a cloud to the sums of slots, as `SlotStreams` does; returns which are the body's, shape (T, n_targets).

    ``height``: of the sensor above where heights count from [m]; None: it tells none.
    """
    flat = echoes.range * np.cos(echoes.elevation)
    x, y = flat * np.cos(echoes.azimuth), flat * np.sin(echoes.azimuth)
    own = np.asarray(echoes.found & (np.hypot(x - trunk[:, None, 0], y - trunk[:, None, 1]) < _GATE))
    row, _ = np.nonzero(own)  # in order of time, and mostly few: nothing is worked out of the others
    away, rate, elevation, snr = (value[own] for value in (echoes.range, echoes.rate, echoes.elevation, echoes.snr))
    x, y, there, moves = x[own], y[own], trunk[row], velocity[row]
    ground = np.maximum(np.hypot(there[:, 0], there[:, 1]), 1e-6)
    relative = rate - (x * moves[:, 0] + y * moves[:, 1]) / np.maximum(away, 1e-6)
    side = (y * there[:, 0] - x * there[:, 1]) / ground
    above = np.zeros_like(side) if height is None else away * np.sin(elevation) + height
    values = np.stack([np.ones_like(side), away - np.linalg.norm(there, axis=1), side, above], axis=-1)
    share = spread(relative)
    weight = share * amplitude(np.clip(snr, 0.0, _MOST_SNR), np.maximum(away, 1e-6))[:, None]
    added = np.concatenate([weight[..., None] * values[:, None], share[..., None]], axis=-1)
    first = np.flatnonzero(np.diff(row, prepend=-1))
    sums[row[first]] += np.add.reduceat(added, first, axis=0) if len(first) else 0.0
    return own


def _held(features: Float32Array, interval: float) -> Float32Array:
    """Slots in which no cloud came hold what the one before held, where clouds are farther apart than slots."""
    if interval <= _SLOT * 1.01:
        return features
    number = np.arange(len(features))
    fresh = np.diff(np.floor((number + 1) * _SLOT / interval), prepend=-1.0) > 0
    held = features[np.maximum.accumulate(np.where(fresh, number, 0))]
    held[~fresh, FRESH] = 0.0
    return held


def _labels(scene: Scene, world: World, k: int, middle: Float64Array) -> tuple[IndexArray, Float32Array, IndexArray]:
    """Label, weight and stroke of slots, as `SlotSequence` has them, by what a person performs; strokes are not counted."""
    label, weight = np.zeros(len(middle), np.int64), np.ones(len(middle), np.float32)
    for row, time in enumerate(middle.tolist()):
        doing = world.timelines[k].at(time)
        if doing is None or doing.gesture is None:
            continue
        name = scene.labels[doing.gesture]
        label[row] = GESTURES.index(name if name in GESTURES else gesture_of(name, scene.people[k]))
        for edge in (doing.start, doing.end):
            weight[np.abs(middle - edge) < EDGE_NS * 1e-9] = EDGE_WEIGHT
    return label, weight, np.full(len(middle), -1, np.int64)
