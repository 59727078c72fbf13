"""Stored clouds to events and features: event detection, features, frame rate and transmitters change without simulating again.

Each sample goes through the same tracking, event detection and features as at run time. What stands in a file is what the radar saw.
"""

from __future__ import annotations

import dataclasses
import functools
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
from joblib import Parallel, delayed
from numpy.typing import NDArray

from radar_core import GESTURES, ConfigError, PointCloud, RadarInfo, vocabulary
from radar_core.geometry import cartesian_to_spherical
from radar_core.types import Float32Array, Float64Array, IndexArray
from radar_gestures.features import FEATURE_NAMES, MotionSample, summarise
from radar_gestures.maps import FeatureMaps, GateAxis, feature_maps
from radar_gestures.stage import EventStage, GestureConfig, TrackEvent, feature_settings
from radar_lab.datasets.samples import BOTH, ONE, SampleSet, info_of, read_sample, sample_files, unpack_clouds
from radar_lab.datasets.scenes import label_events
from radar_lab.evaluation.scoring import TruthSegment
from radar_lab.training.encoder import ATTRIBUTES, MAPS, EncoderConfig, encode, encode_maps
from radar_tracking import PeopleTracker, Track, TrackedCloud

Columns = Mapping[str, NDArray[Any]]
Positions = NDArray[np.floating]
_LEAD: Final[float] = 0.6  # s: time in which a track settles
_LEAST_STEP: Final[int] = 100_000  # ns: no radar has shorter frame intervals, so nearer stamps tell nothing about it
_GATE: Final[float] = 0.8  # m: a track farther from the person on the floor is not theirs


@dataclass(frozen=True, eq=False)
class Reading:
    """What the event stage made of one sample."""

    gesture: str  # what was performed
    person: int  # the subject
    stroke_ns: tuple[int, int]  # true start and end [ns]
    event: TrackEvent | None  # the gesture's event; None: it was missed. Its features are never None
    # The track's own points, in ``room``, from ``margin`` before the event to ``margin`` after it; empty without an event
    clouds: tuple[PointCloud, ...]
    samples: tuple[MotionSample, ...]  # of these clouds: the one-dimensional signals of the thesis's figure 4.9

    @property
    def features(self) -> Float64Array:
        """The thirteen features, shape (13,); NaN when it was missed."""
        given = None if self.event is None else self.event.features
        return np.full(len(FEATURE_NAMES), np.nan) if given is None else given

    @property
    def columns(self) -> dict[str, NDArray[Any]]:
        """Columns of a file that say whether, and how, the gesture was found, and when it was performed."""
        best = self.event
        event = (0, 0) if best is None else (best.event.start_ns, best.event.end_ns)
        return {
            "features": self.features,
            "found": np.array(best is not None),
            "walked": np.array(0.0 if best is None else best.walked),
            "event_ns": np.array(event, np.int64),
            "stroke_ns": np.array(self.stroke_ns, np.int64),
        }


@dataclass(frozen=True, eq=False)
class Cubes:
    """Input of a convolutional network for n samples, each as `encode` or `encode_maps` gives it; the rest as in `SampleSet`."""

    cube: Float32Array
    label: IndexArray
    person: IndexArray
    missed: IndexArray


def read_stroke(
    info: RadarInfo, clouds: Sequence[PointCloud], position: Positions, stroke: TruthSegment, config: GestureConfig, *, padded: bool = True
) -> Reading:
    """Take the clouds of one stroke through tracking, event detection and features.

    An event is the gesture when a training sample of it would get its label (`label_events`) and it is of a track within 0.8 m of the
    person; of several, the longest.

    Parameters
    ----------
    info : RadarInfo
        The radar.
    clouds : sequence of PointCloud
        In order of time, in the sensor frame or in ``room``.
    position : ndarray, shape (n_clouds, 3)
        Of the person when the clouds were made, in ``room`` [m]; NaN: not known, then anybody's event may be the gesture.
    stroke : TruthSegment
        What was performed, and when.
    config : GestureConfig
        Knobs of events and features.
    padded : bool
        Whether the clouds only span the stroke: then those before and after it are continued as a body at rest would look, long enough
        for tracks to settle and events to end.
    """
    room = [cloud.to_room(info.mount) for cloud in clouds]
    places = [*np.asarray(position, np.float64)]
    if padded and room:
        lead, rest = _surroundings(room, stroke, config, info.waveform.frame_interval)
        room = [*lead, *room, *rest]
        places = [*places[:1] * len(lead), *places, *places[-1:] * len(rest)]
    tracker, stage = PeopleTracker(None, info), EventStage(config, info.mount)
    passed: list[TrackedCloud] = []
    found: list[TrackEvent] = []
    for cloud, place in zip(room, places, strict=True):
        tracked = TrackedCloud(cloud, tracker.process(cloud))
        passed.append(tracked)
        for event in stage.process(tracked):
            own = _is_of(tracked.tracks.find(event.track_id), place)
            missed = label_events([(stroke.person_id, event)], [stroke])["missed"].any()
            if own and not missed and event.features is not None:
                found.append(event)
    best = max(found, key=lambda one: one.event.end_ns - one.event.start_ns, default=None)
    own_clouds, samples = ((), ()) if best is None else _signals(passed, best, config, info)
    return Reading(stroke.name, stroke.person_id, (stroke.start_ns, stroke.end_ns), best, own_clouds, samples)


def _is_of(track: Track | None, place: Positions) -> bool:
    """Whether a track is the person's; where the person is may not be known."""
    return track is not None and not math.hypot(track.position[0] - place[0], track.position[1] - place[1]) > _GATE


def _surroundings(
    room: list[PointCloud], stroke: TruthSegment, config: GestureConfig, interval: float
) -> tuple[list[PointCloud], list[PointCloud]]:
    """Clouds to come before and after those of a stroke, in order of time."""
    before = [cloud for cloud in room if cloud.stamp_ns < stroke.start_ns] or room[:1]
    after = [cloud for cloud in room if cloud.stamp_ns > stroke.end_ns] or room[-1:]
    stamps = np.array([cloud.stamp_ns for cloud in room])
    step = round(float(np.median(np.diff(stamps)))) if len(stamps) > 1 else 0
    step = step if step >= _LEAST_STEP else round(interval * 1e9)
    lead = _at_rest(before, config, room[0].stamp_ns - step, -step, _LEAD)
    return lead[::-1], _at_rest(after, config, room[-1].stamp_ns + step, step, config.events.quiet)


def _at_rest(near: list[PointCloud], config: GestureConfig, start_ns: int, step_ns: int, duration: float) -> list[PointCloud]:
    """Clouds before or after those that were simulated: body and hand rest then, so what stands still nearby is what would come.

    With them tracking knows the person, as it long does at run time when a gesture begins, and the quiet time that ends an event passes.
    """
    slow = min(config.features.body_speed, config.events.release)
    still = [cloud.select(np.flatnonzero(~(np.abs(cloud.radial_speed) >= slow))) for cloud in near]
    n = math.ceil(duration * 1e9 / abs(step_ns)) + 1
    return [dataclasses.replace(still[k % len(still)], stamp_ns=start_ns + k * step_ns) for k in range(n)]


def _signals(
    passed: list[TrackedCloud], found: TrackEvent, config: GestureConfig, info: RadarInfo
) -> tuple[tuple[PointCloud, ...], tuple[MotionSample, ...]]:
    """Return the track's own points about the event, cloud by cloud, and what they tell."""
    margin = round(config.margin * 1e9)
    clouds, samples = [], []
    for tracked in passed:
        track = tracked.tracks.find(found.track_id)
        if track is None or not found.event.start_ns - margin <= tracked.cloud.stamp_ns <= found.event.end_ns + margin:
            continue
        own = tracked.cloud.select(np.flatnonzero(tracked.tracks.point_track_id == track.id))
        distance, azimuth, elevation = cartesian_to_spherical(info.mount.from_room(np.asarray(track.position)))
        clouds.append(own)
        samples.append(summarise(own, (float(distance), float(azimuth), float(elevation)), config.features))
    return tuple(clouds), tuple(samples)


def read(sample: Columns, config: GestureConfig | None = None, *, every: int = 1, one_tx: bool = False) -> Reading:
    """Read one stored sample.

    Parameters
    ----------
    sample : mapping
        As `read_samples` gives it.
    config : GestureConfig or None
        Knobs of events and features; None: the defaults.
    every : int
        Take every n-th cloud only, as a radar of a lower frame rate would give them; below 1 raises `ConfigError`.
    one_tx : bool
        Take the clouds of the first transmitter alone; `DataError` when there are none.
    """
    if every < 1:
        raise ConfigError(f"every is {every}; 1 takes every cloud, 2 every second, and so on")
    kind = ONE if one_tx else BOTH
    clouds, (start, end) = unpack_clouds(sample, kind)[::every], sample["stroke_ns"].tolist()
    gesture = str(sample["gesture"])
    own = "" if gesture in GESTURES else gesture
    stroke = TruthSegment(int(sample["subject"]), int(sample["label"]), start, end, own)
    return read_stroke(
        info_of(sample, kind), clouds, sample["position"][::every], stroke, config or GestureConfig(), padded=bool(str(sample["scene"]))
    )


def maps_of(sample: Columns, gate: float | None = None, *, one_tx: bool = False) -> FeatureMaps:
    """Return the feature maps of all that a sample's radar saw (thesis, figures 4.4 to 4.8).

    ``gate`` is the width of a Doppler gate [m/s], None: the usual of `FeatureConfig`; ``one_tx`` is as in `read`.
    """
    kind = ONE if one_tx else BOTH
    width = GestureConfig().features.gate if gate is None else gate
    return feature_maps(unpack_clouds(sample, kind), width, info_of(sample, kind).waveform.max_speed)


def collect(
    folder: str | Path,
    config: GestureConfig | None = None,
    *,
    every: int = 1,
    one_tx: bool = False,
    n_jobs: int = 1,
    vector: Callable[[Reading], NDArray[Any]] | None = None,
    names: tuple[str, ...] = FEATURE_NAMES,
) -> SampleSet:
    """Read a data set into features and labels, as training takes them: of the samples whose gesture was found; the others are ``missed``.

    Parameters
    ----------
    folder : str or Path
        A data set of `radar_lab.datasets.synthesis` or `radar_lab.datasets.labelled`; `DataError` when it is none, or cannot be read.
    config, every, one_tx
        As in `read`.
    n_jobs : int
        Processes, -1: one per core.
    vector : callable or None
        Makes other features of a reading whose event was found, shape (n_features,); a function of a module. None: the thirteen.
    names : tuple of str
        Of these features.
    """
    config = config or GestureConfig()
    found, missed = _each(folder, n_jobs, functools.partial(_row, config=config, every=every, one_tx=one_tx, make=vector or _features))
    features, gesture, person, walked = zip(*found, strict=True) if found else ((),) * 4
    labels = vocabulary((*gesture, *missed))
    return SampleSet(
        features=np.array(features, np.float64).reshape(-1, len(names)),
        label=np.array([labels.index(name) for name in gesture], np.int64),
        person=np.array(person, np.int64),
        walked=np.array(walked, np.float64),
        missed=_counted(missed, labels),
        config=feature_settings(config),
        names=names,
        labels=labels,
    )


def cubes(
    folder: str | Path,
    config: GestureConfig | None = None,
    *,
    encoder: EncoderConfig | None = None,
    every: int = 1,
    one_tx: bool = False,
    n_jobs: int = 1,
) -> Cubes:
    """Read a data set into feature cubes: the strongest detections of each frame of the event, cloud by cloud (section 4.5.5).

    Parameters
    ----------
    folder, config, every, one_tx, n_jobs
        As in `collect`, which also says what is raised.
    encoder : EncoderConfig or None
        Size and kind of the cubes; None: the thesis's 50 detections of 50 frames.
    """
    encoder = encoder or EncoderConfig()
    work = functools.partial(
        _row, config=config or GestureConfig(), every=every, one_tx=one_tx, make=functools.partial(_cube, encoder=encoder)
    )
    return _stack(folder, n_jobs, work, (len(ATTRIBUTES), encoder.n_detections, encoder.n_frames))


def network_maps(
    folder: str | Path,
    config: GestureConfig | None = None,
    *,
    encoder: EncoderConfig | None = None,
    every: int = 1,
    one_tx: bool = False,
    n_jobs: int = 1,
) -> Cubes:
    """Read a data set into the feature maps of each event, all of one length, as a network takes them (sections 4.2 and 4.5.3).

    Parameters
    ----------
    folder, config, every, one_tx, n_jobs
        As in `collect`, which also says what is raised. Gates and speeds of the maps are those of ``config``.
    encoder : EncoderConfig or None
        Number and interval of the frames; None: the thesis's 50.
    """
    encoder, config = encoder or EncoderConfig(), config or GestureConfig()
    work = functools.partial(_row, config=config, every=every, one_tx=one_tx, make=functools.partial(_maps, encoder=encoder, config=config))
    return _stack(folder, n_jobs, work, (len(MAPS), len(GateAxis(config.features.gate, config.maps.max_speed)), encoder.n_frames))


def _stack(folder: str | Path, n_jobs: int, work: Callable[[Path], _Row], shape: tuple[int, ...]) -> Cubes:
    """Arrays of all samples, one after the other; ``shape``: of one."""
    found, missed = _each(folder, n_jobs, work)
    cube, gesture, person, _ = zip(*found, strict=True) if found else ((),) * 4
    labels = vocabulary((*gesture, *missed))
    label = [labels.index(name) for name in gesture]
    return Cubes(
        np.array(cube, np.float32).reshape(-1, *shape), np.array(label, np.int64), np.array(person, np.int64), _counted(missed, labels)
    )


_Row = tuple[NDArray[Any] | None, str, int, float]


def _row(path: Path, config: GestureConfig, every: int, one_tx: bool, make: Callable[[Reading], NDArray[Any]]) -> _Row:
    """Read one file: what ``make`` makes of it, with gesture, person and walked distance; None: the event was missed."""
    reading = read(read_sample(path), config, every=every, one_tx=one_tx)
    if reading.event is None:
        return None, reading.gesture, reading.person, 0.0
    return make(reading), reading.gesture, reading.person, reading.event.walked


def _features(reading: Reading) -> Float64Array:
    return reading.features


def _cube(reading: Reading, encoder: EncoderConfig) -> Float32Array:
    assert reading.event is not None
    distance, azimuth, elevation = np.median([sample.body for sample in reading.samples], axis=0).tolist()
    event = reading.event.event
    return encode(reading.clouds, encoder, start_ns=event.start_ns, end_ns=event.end_ns, body=(distance, azimuth, elevation))


def _maps(reading: Reading, encoder: EncoderConfig, config: GestureConfig) -> Float32Array:
    assert reading.event is not None
    event, gate = reading.event.event, config.features.gate
    return encode_maps(reading.clouds, encoder, gate, config.maps.max_speed, start_ns=event.start_ns, end_ns=event.end_ns)


def _each(folder: str | Path, n_jobs: int, work: Callable[[Path], _Row]) -> tuple[list[_Row], list[str]]:
    """Do the work on every file, several at a time: rows of what was found, in the order of the files, and gestures that were missed."""
    files = sample_files(folder)
    rows: list[_Row] = list(map(work, files)) if n_jobs == 1 else Parallel(n_jobs=n_jobs)(delayed(work)(path) for path in files)
    return [row for row in rows if row[0] is not None], [row[1] for row in rows if row[0] is None]


def _counted(gestures: Sequence[str], labels: Sequence[str]) -> IndexArray:
    """How often each label occurs."""
    return np.bincount([labels.index(name) for name in gestures], minlength=len(labels)).astype(np.int64)
