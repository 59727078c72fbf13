"""Streams of slots to learn from: of simulated lives, labelled by truth, and changed copies of them."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
from joblib import Parallel, delayed
from numpy.typing import NDArray
from threadpoolctl import threadpool_limits

from radar_core import GESTURES, DataError, RadarInfo
from radar_core.types import Float32Array, Float64Array, IndexArray
from radar_gestures.stream.slots import ELEVATION, FRESH, NAMES, SLOT_NS, SLOW, SPEEDS, SPLIT, Slot, SlotStreams, usual_amplitude
from radar_lab.datasets.lives import Life, life_files, read_life
from radar_lab.evaluation.scoring import TruthSegment
from radar_tracking import TrackerConfig, make_tracker
from radar_tracking.tracks import TrackedCloud

NEAR: Final = 0.8
"""A track is on the person nearest to it, if no farther than this [m]."""
EDGE_NS: Final = 100_000_000
"""So near to begin or end of a gesture [ns] a slot may be called either way: it weighs `EDGE_WEIGHT`."""
EDGE_WEIGHT: Final = 0.3
_LEAST: Final = 10  # slots: shorter sequences teach nothing
_STRETCH: Final = 0.2  # of the logarithm of speed, at most
_GAIN, _LEVEL, _WEAKEST = 0.5, 0.08, 0.01  # spread of the logarithm of amplitudes, of heights [m]; no strength vanishes by it
_OFTEN, _LOST = 0.3, 0.15  # how often slots are lost, heights unknown or faint echoes missing; the largest share of slots that is lost
_FLAT, _MORE = 0.15, 0.4  # how often strengths are unknown; spread of the logarithm of how many points an echo gives
_SIZE, _FAINT = 0.15, 2.0  # by how much larger or smaller motions are, at most; strength up to which echoes may be missing
_SWIPES: Final = ("swipe_right", "swipe_left")


def _places(name: str) -> IndexArray:
    return np.array([number for number, text in enumerate(NAMES) if text == name or text.startswith(f"{name} at ")], np.int64)


_SIDES: Final = np.concatenate([_places("side"), _places("azimuth")])
_STRENGTHS: Final = np.concatenate([_places("strength"), _places("slow strength")])  # at single speeds first
_HEIGHTS: Final = _places("height")
_PLACES: Final = np.concatenate([_HEIGHTS, _places("side"), _places("range")])
_POINTS: Final = _places("points")


@dataclass(frozen=True, eq=False)
class SlotSequence:
    """Successive slots of one track, as one sensor saw them.

    Attributes
    ----------
    features : ndarray of float32, shape (n_slots, n_features)
        See `radar_gestures.stream.slots.NAMES`.
    label : ndarray of int64, shape (n_slots,)
        Index into `GESTURES`; 0 where nothing is performed.
    weight : ndarray of float32, shape (n_slots,)
        How much a slot counts in the training.
    stroke : ndarray of int64, shape (n_slots,)
        Index into the strokes of the life; -1: none.
    """

    features: Float32Array
    label: IndexArray
    weight: Float32Array
    stroke: IndexArray

    def __post_init__(self) -> None:
        n = len(self.label)
        if self.features.ndim != 2 or len(self.features) != n or self.weight.shape != (n,) or self.stroke.shape != (n,):
            raise DataError(f"a sequence has {n} labels, but features {self.features.shape}, weight {self.weight.shape}")


@dataclass(frozen=True, eq=False)
class LifeSlots:
    """What the tracker made of a life.

    Attributes
    ----------
    number, kind : int, str
        Of the life, and of its radar.
    info : RadarInfo
        The radar.
    minutes : float
        How long it lasted [min].
    strokes : tuple of TruthSegment
        What was performed, followed by the tracker or not.
    sequences : tuple of SlotSequence
        Of all tracks.
    """

    number: int
    kind: str
    info: RadarInfo
    minutes: float
    strokes: tuple[TruthSegment, ...]
    sequences: tuple[SlotSequence, ...]


def read_lives(folder: str | Path, first: int = 0, end: int | None = None, *, n_jobs: int = 1) -> list[LifeSlots]:
    """Track people through lives of a folder, and label their slots.

    Parameters
    ----------
    folder : str or Path
        As `radar_lab.datasets.lives.generate_lives` fills it.
    first, end : int, int or None
        Of its files, in order, from which one on, and up to which; None: to the last.
    n_jobs : int
        Lives that are read at the same time.

    Raises
    ------
    DataError
        When the folder holds no lives, or one cannot be read.
    """
    return list(Parallel(n_jobs=n_jobs)(delayed(_read)(path) for path in life_files(folder)[first:end]))


def _read(path: Path) -> LifeSlots:
    with threadpool_limits(1):
        return slots_of(read_life(path))


def slots_of(life: Life, followed: Iterable[TrackedCloud] | None = None) -> LifeSlots:
    """Label the slots of a life's tracks.

    Parameters
    ----------
    life : Life
        Who was where, and what they performed.
    followed : iterable of TrackedCloud or None
        Its clouds in ``room``, and whose their points are; None: as the default tracker says.
    """
    streams = _streams(life.info, _tracked(life) if followed is None else followed)
    sequences = tuple(_sequence(life, slots) for slots in streams if len(slots) >= _LEAST)
    minutes = (life.clouds[-1].stamp_ns - life.clouds[0].stamp_ns) / 60e9
    return LifeSlots(life.number, life.kind, life.info, minutes, life.segments, sequences)


def _tracked(life: Life) -> Iterator[TrackedCloud]:
    tracker = make_tracker(TrackerConfig(), life.info)
    for cloud in life.clouds:
        room = cloud.to_room(life.info.mount)
        yield TrackedCloud(room, tracker.process(room))


def _streams(info: RadarInfo, followed: Iterable[TrackedCloud]) -> list[list[Slot]]:
    """Slots of each track and sensor, parted where nothing is known of what was before."""
    streams = SlotStreams(info)
    parts: list[list[Slot]] = []
    last: dict[tuple[int, str], list[Slot]] = {}
    for tracked in followed:
        for slot in streams.process(tracked):
            key = (slot.track_id, slot.sensor)
            if slot.begins or key not in last:
                last[key] = []
                parts.append(last[key])
            last[key].append(slot)
    return parts


def _sequence(life: Life, slots: Sequence[Slot]) -> SlotSequence:
    number = np.array([slot.number for slot in slots], np.int64)
    place = np.array([slot.position[:2] for slot in slots])
    return SlotSequence(np.array([slot.features for slot in slots], np.float32), *label_slots(number, place, life))


def label_slots(number: IndexArray, place: Float64Array, life: Life) -> tuple[IndexArray, Float32Array, IndexArray]:
    """Name slots of a track by what the person nearest to it performs in their middles.

    Parameters
    ----------
    number : ndarray of int64, shape (n_slots,)
        Of the slots.
    place : ndarray of float64, shape (n_slots, 2)
        Of the track on the ground [m].
    life : Life
        Who was where, and what they performed.

    Returns
    -------
    label, weight, stroke : ndarray, shape (n_slots,)
        As in `SlotSequence`.
    """
    middle = number * SLOT_NS + SLOT_NS // 2
    stamps = np.array([cloud.stamp_ns for cloud in life.clouds], np.int64)
    at = np.clip(np.searchsorted(stamps, middle), 0, len(stamps) - 1)
    away = np.linalg.norm(life.position[at, :, :2] - place[:, None], axis=-1)
    nearest = away.argmin(axis=1)
    person = np.where(away[np.arange(len(at)), nearest] <= NEAR, life.person_id[nearest], -1)
    label, stroke = np.zeros(len(at), np.int64), np.full(len(at), -1, np.int64)
    weight = np.ones(len(at), np.float32)
    for index, segment in enumerate(life.segments):
        own = person == segment.person_id
        inside = own & (middle >= segment.start_ns) & (middle <= segment.end_ns)
        label[inside], stroke[inside] = segment.label, index
        for edge in (segment.start_ns, segment.end_ns):
            weight[own & (np.abs(middle - edge) < EDGE_NS)] = EDGE_WEIGHT
    return label, weight, stroke


def mirrored(features: NDArray[np.float32]) -> Float32Array:
    """Features of the same motions seen in a mirror: left and right change places; shape (..., n_features)."""
    changed = np.array(features, np.float32)
    changed[..., _SIDES] *= -1.0
    return changed


def mirrored_labels(label: IndexArray, labels: Sequence[str] = GESTURES) -> IndexArray:
    """Labels, shape (n,), of what a mirror shows: a swipe to the right is one to the left; ``labels`` says what they mean."""
    swapped = np.arange(len(labels), dtype=np.int64)
    if set(_SWIPES) <= set(labels):
        right, left = (labels.index(name) for name in _SWIPES)
        swapped[[right, left]] = left, right
    return swapped[label]


def varied(sequence: SlotSequence, rng: np.random.Generator, labels: Sequence[str] = GESTURES) -> SlotSequence:
    """Change a sequence as another person, place or radar could have: what was performed stays the same.

    Half of the time in a mirror; a little faster or slower, larger or smaller; with more or less amplitude, and more or fewer points; a
    little higher or lower; and now and then without faint echoes, with slots lost, or as a radar sees it that tells no heights, or no
    strengths.
    """
    n = len(sequence.label)
    at = np.minimum((np.arange(n) * np.exp(rng.uniform(-_STRETCH, _STRETCH))).astype(np.int64), n - 1)
    x, label = sequence.features[at], sequence.label[at]
    if rng.random() < 0.5:
        x, label = mirrored(x), mirrored_labels(label, labels)
    x[:, _POINTS] = np.log1p(np.expm1(np.maximum(x[:, _POINTS], 0.0)) * np.exp(rng.normal(0.0, _MORE)))
    if rng.random() < _FLAT:
        _flatten(x)
    strength = x[:, _STRENGTHS]
    louder = np.maximum(strength + np.float32(rng.normal(0.0, _GAIN)), np.float32(_WEAKEST))
    x[:, _STRENGTHS] = np.where(strength > 0.0, louder, 0.0)
    x[:, _HEIGHTS] += np.float32(rng.normal(0.0, _LEVEL)) * (strength[:, : len(_HEIGHTS)] > 0.0)
    x[:, _PLACES] *= np.float32(rng.uniform(1.0 - _SIZE, 1.0 + _SIZE))
    if rng.random() < _OFTEN:
        _weaken(x, rng.uniform(0.0, _FAINT))
    if rng.random() < _OFTEN:
        x = _with_losses(x, rng)
    if rng.random() < _OFTEN:
        x[:, _HEIGHTS], x[:, ELEVATION] = 0.0, 0.0
    return SlotSequence(x, label, sequence.weight[at], sequence.stroke[at])


def _flatten(x: Float32Array) -> None:
    """Give strengths as of a radar that tells none: every point counts as much as `SlotStreams` takes it for."""
    each = x[:, :SPLIT].reshape(len(x), len(SPEEDS), -1)
    one = usual_amplitude(3.0 * x[:, NAMES.index("distance")].astype(np.float64))
    amplitude = np.expm1(np.maximum(each[..., -1], 0.0)) * one[:, None]
    each[..., 0] = np.log1p(amplitude)
    x[:, NAMES.index("slow strength")] = np.log1p(amplitude[:, SLOW].sum(axis=1))
    x[:, NAMES.index("strength")] = np.log1p(amplitude.sum(axis=1))


def _weaken(x: Float32Array, least: float) -> None:
    """Take all away that is known of speeds with less strength than that."""
    each = x[:, :SPLIT].reshape(len(x), len(SPEEDS), -1)
    each[each[..., 0] < least] = 0.0


def _with_losses(x: Float32Array, rng: np.random.Generator) -> Float32Array:
    """Let some slots hold what the one before held, as `SlotStreams` fills them in."""
    lost: NDArray[Any] = rng.random(len(x)) < rng.uniform(0.0, _LOST)
    held = x[np.maximum.accumulate(np.where(lost, 0, np.arange(len(x))))]
    held[lost, FRESH] = 0.0
    return held
