"""Events before classification: samples, events and features of every track, for each sensor by itself (thesis, section 7.2)."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from radar_core import CloudComposite, Pose
from radar_core.config import config, flat, knob, override
from radar_core.geometry import cartesian_to_spherical
from radar_core.types import Float64Array
from radar_gestures.activation import ActivationConfig
from radar_gestures.events import Event, EventConfig, EventDetector
from radar_gestures.features import FeatureConfig, MotionRing, MotionSample, extract, summarise
from radar_gestures.maps import FeatureMaps, GateAxis, MapConfig, MapRing, Share, doppler_gates, shares
from radar_tracking.tracks import TrackedCloud, TrackStatus

_BEFORE_NS: Final[tuple[int, int]] = (1_200_000_000, 200_000_000)  # ns: from there to there before an event the person still was where they
# stood, whatever the start of their step does to the track
_AFTER_NS: Final[int] = 400_000_000  # ns: where a person is after an event

Spherical = tuple[float, float, float]
"""Distance [m], azimuth and elevation [rad] seen from a sensor."""


@config
class GestureConfig:
    """How gestures are found and named."""

    features: FeatureConfig = FeatureConfig()
    events: EventConfig = EventConfig()
    maps: MapConfig = MapConfig()
    margin: float = knob(0.1, unit="s", low=0.0, high=2.0, doc="features also see that much before and after the event")
    walk_distance: float = knob(
        0.6, unit="m", low=0.0, high=100.0, doc="a person who is farther away after an event walked: random, unless both models are sure"
    )
    step_distance: float = knob(0.25, unit="m", low=0.0, high=100.0, doc="a push or pull that ends this far from its start may be a step")
    step_score: float = knob(0.6, low=0.0, high=1.0, doc="a push or pull like that with a lower score is unknown; 0: off")
    min_confidence: float = knob(0.0, low=0.0, high=1.0, doc="a less probable gesture is unknown (random), whatever the model's limit")
    publish_random: bool = knob(True, doc="publish events that are no gesture, with label 0 (random)")
    activation: ActivationConfig = ActivationConfig()


@dataclass(frozen=True, eq=False)
class SensorView:
    """What one sensor saw of an event.

    Attributes
    ----------
    sensor : str
        Its frame_id; empty where the cloud does not name its sensors.
    features : ndarray of float64, shape (13,), or None
        None: too few samples.
    maps : FeatureMaps or None
        From ``margin`` before the event to ``margin`` after it, or as long as `MapConfig` says.
    """

    sensor: str
    features: Float64Array | None
    maps: FeatureMaps | None = None


@dataclass(frozen=True, eq=False)
class TrackEvent:
    """An event before classification; training samples are made of it.

    Attributes
    ----------
    track_id : int
        Whose.
    event : Event
        From when to when.
    walked : float
        How far the track is after it from where it was before [m]; see `walked`.
    views : tuple of SensorView
        One of every sensor that saw fast motion, the strongest first; those without features last.
    position : ndarray of float64, shape (3,)
        Of the track when the event ended, in ``room`` [m]; NaN: not known.
    """

    track_id: int
    event: Event
    walked: float
    views: tuple[SensorView, ...]
    position: Float64Array = dataclasses.field(default_factory=lambda: np.full(3, np.nan))

    @property
    def features(self) -> Float64Array | None:
        """The thirteen features of the first view, shape (13,); None: too few samples."""
        return self.views[0].features if self.views else None

    @property
    def maps(self) -> FeatureMaps | None:
        """The maps of the first view."""
        return self.views[0].maps if self.views else None

    def without_maps(self) -> TrackEvent:
        """Return the same event without its maps, to be kept for long."""
        return dataclasses.replace(self, views=tuple(dataclasses.replace(view, maps=None) for view in self.views))


class EventStage:
    """Find events in tracked clouds; training uses the same class as live recognition.

    A fused cloud (`CloudComposite`) holds what several sensors measured, each from its own place. Range rates of one motion differ from
    sensor to sensor, in sign too, so every sensor has motion samples and maps of its own, with the angles from the body as that sensor sees
    it. The event is common: it begins and ends with the fastest motion that any sensor sees. Each view is cut to the part in which its own
    sensor sees fast motion, which with one sensor is the whole event. Angles of clouds that do not name their sensors are taken from
    ``mount``. Tracks that are nobody yet give no events, unless with ``tentative``.
    """

    def __init__(self, config: GestureConfig, mount: Pose, *, tentative: bool = False) -> None:
        self._config = config
        self._mount = mount
        self._tentative = tentative
        self._states: dict[int, _TrackState] = {}

    @property
    def track_ids(self) -> tuple[int, ...]:
        """Tracks that are being watched."""
        return tuple(self._states)

    def process(self, tracked: TrackedCloud) -> tuple[TrackEvent, ...]:
        """Take one cloud and return the events that ended with it, in the order of the tracks."""
        tracks = tracked.tracks.tracks
        alive = {track.id for track in tracks}
        self._states = {key: state for key, state in self._states.items() if key in alive}
        sensors = list(_by_sensor(tracked, self._mount))
        found = []
        for track, *points in zip(tracks, *(own for _, own in sensors), strict=True):
            if track.id not in self._states:
                self._states[track.id] = _TrackState(self._config)
            place = np.asarray(track.position)
            seen = {key: (share, _seen_from(key[1], place)) for (key, _), share in zip(sensors, points, strict=True)}
            event = self._states[track.id].process(seen, track.id)
            if event is not None and (self._tentative or track.status != TrackStatus.TENTATIVE):
                found.append(dataclasses.replace(event, position=np.asarray(track.position)))
        return tuple(found)


_Sensor = tuple[str, Pose]  # frame_id and mount
_Seen = tuple[Share, Spherical]  # a sensor's points of a track, and where it sees the track's centre


def _by_sensor(tracked: TrackedCloud, mount: Pose) -> Iterator[tuple[_Sensor, Iterator[Share]]]:
    """Give each sensor with what it saw of every track; the sensor of a cloud that names none has no name and stands at ``mount``."""
    cloud, owner = tracked.cloud, tracked.tracks.point_track_id
    ids = [track.id for track in tracked.tracks.tracks]
    if not isinstance(cloud, CloudComposite) or not cloud.sources:
        yield ("", mount), shares(cloud, owner, ids)
        return
    sensors = [(source.frame_id, source.mount) for source in cloud.sources]
    different = list(dict.fromkeys(sensors))
    number = np.array([different.index(sensor) for sensor in sensors])[cloud.sensor]
    for k, sensor in enumerate(different):
        yield sensor, shares(cloud, np.where(number == k, owner, -1), ids)


def _seen_from(mount: Pose, place: Float64Array) -> Spherical:
    distance, azimuth, elevation = cartesian_to_spherical(mount.from_room(place))
    return float(distance), float(azimuth), float(elevation)


class _TrackState:
    """Event detector of one track, and what each sensor saw of it."""

    def __init__(self, config: GestureConfig) -> None:
        self._config = config
        self._detector = EventDetector(config.events)
        self._memories: dict[_Sensor, _Memory] = {}

    def process(self, seen: dict[_Sensor, _Seen], track_id: int) -> TrackEvent | None:
        self._memories |= {sensor: _Memory(self._config) for sensor in seen if sensor not in self._memories}
        samples = [self._memories[sensor].add(points, body) for sensor, (points, body) in seen.items()]
        fastest = max(samples, key=lambda sample: abs(sample.speed))
        event = self._detector.process(fastest.stamp_ns, fastest.speed)
        if event is None:
            return None
        parts = [(name, memory, memory.part_of(event)) for (name, _), memory in self._memories.items()]
        views = [(memory.strength(part), memory.view(part, name)) for name, memory, part in parts if part is not None]
        views.sort(key=lambda entry: (entry[1].features is None, -entry[0]))
        moved = max(memory.walked(event) for memory in self._memories.values())
        return TrackEvent(track_id, event, moved, tuple(view for _, view in views))


class _Memory:
    """The last seconds of what one sensor saw of a track."""

    def __init__(self, config: GestureConfig) -> None:
        self._config = config
        events = config.events
        self._margin_ns = round(config.margin * 1e9)
        event = events.max_duration + max(events.quiet, config.margin) + events.max_gap
        self._motion = MotionRing(event + max(config.margin, _BEFORE_NS[0] * 1e-9))
        self._maps = MapRing(event + config.margin, GateAxis(config.features.gate, config.maps.max_speed))

    def add(self, points: Share, body: Spherical) -> MotionSample:
        picked = doppler_gates(points.radial_speed, points.snr, self._config.features.gate)
        sample = summarise(points, body, self._config.features, picked)
        self._motion.add(sample)
        self._maps.add(points, picked)
        return sample

    def part_of(self, event: Event) -> Event | None:
        """Cut an event to the part in which this sensor sees fast motion; None: it sees none."""
        events = self._config.events
        inside = [(sample.stamp_ns, abs(sample.speed)) for sample in self._motion.between(event.start_ns, event.end_ns)]
        start = next((stamp for stamp, speed in inside if speed > events.threshold), None)
        return None if start is None else Event(start, max(stamp for stamp, speed in inside if speed > events.release))

    def strength(self, part: Event) -> float:
        """Sum of the amplitudes of all that moved."""
        return math.fsum(sample.weight for sample in self._motion.between(part.start_ns, part.end_ns))

    def view(self, part: Event, sensor: str) -> SensorView:
        start, end = part.start_ns - self._margin_ns, part.end_ns + self._margin_ns
        features = extract(self._motion.between(start, end), part.start_ns, self._config.features)
        return SensorView(sensor, features, self._maps.window(start, end, self._config.maps.length))

    def walked(self, event: Event) -> float:
        early, late = (event.start_ns - before for before in _BEFORE_NS)
        before = self._motion.between(early, late) or self._motion.between(late, event.start_ns)  # a young track has only just begun
        return walked(before, self._motion.between(event.end_ns, event.end_ns + _AFTER_NS))


def config_for(settings: Mapping[str, Any], config: GestureConfig) -> GestureConfig:
    """Take what a model names of its own features (``settings``) into a configuration, where that has the default.

    What the configuration says otherwise stays, and the recogniser then refuses the model. Raises `ConfigError` for settings without sense.
    """
    usual, own = flat(GestureConfig()), flat(config)
    named = _dotted({name: settings[name] for name in (*feature_settings(config), "maps") if name in settings})
    return override(config, {name: value for name, value in named.items() if own.get(name) == usual.get(name)}, "gesture model")


def _dotted(settings: Mapping[str, Any], prefix: str = "") -> dict[str, Any]:
    """Name nested settings as `radar_core.config.flat` does."""
    found: dict[str, Any] = {}
    for name, value in settings.items():
        found |= _dotted(value, f"{prefix}{name}.") if isinstance(value, Mapping) else {f"{prefix}{name}": value}
    return found


def feature_settings(config: GestureConfig) -> dict[str, Any]:
    """List the knobs that change what features mean; a model and its recogniser must agree on those that the model names."""
    return {"features": dataclasses.asdict(config.features), "events": dataclasses.asdict(config.events), "margin": config.margin}


def walked(before: Sequence[MotionSample], after: Sequence[MotionSample]) -> float:
    """How far a track is from where it was, on the ground [m]: arms pull at it meanwhile, so medians before and after; 0 when unknown."""
    if not before or not after:
        return 0.0
    step = _ground(after) - _ground(before)
    return float(math.hypot(*step)) if np.isfinite(step).all() else 0.0


def _ground(samples: Sequence[MotionSample]) -> Float64Array:
    """Median place of a track, shape (2,) [m]."""
    distance, azimuth, elevation = np.array([sample.body for sample in samples], np.float64).T
    ground = np.array((np.cos(azimuth), np.sin(azimuth))) * (distance * np.cos(elevation))
    return np.asarray(np.median(ground, axis=1))
