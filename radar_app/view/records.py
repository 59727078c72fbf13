"""What the feed keeps beside the library's own results: maps, and how the nodes are doing."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal

from radar_core.types import Float32Array
from radar_gestures.maps import FeatureMaps

Level = Literal["ok", "warn", "error", "stale"]
"""How a node is doing, as on the topic diagnostics."""


@dataclass(frozen=True, eq=False)
class EventMaps:
    """The feature maps of one finished event.

    Attributes
    ----------
    stamp_ns, track_id : int
        Of the cloud at which it was decided [ns], and whose it is: those of the `Gesture` of the same event.
    start_ns, end_ns : int
        First and last moment of the event [ns].
    maps : FeatureMaps
        Micro-Doppler, azimuth, elevation and distance.
    """

    stamp_ns: int
    track_id: int
    start_ns: int
    end_ns: int
    maps: FeatureMaps


@dataclass(frozen=True, eq=False)
class RangeDoppler:
    """The range-Doppler map of one frame, all channels added without their phases.

    Attributes
    ----------
    frame_id : str
        Of the radar.
    power : ndarray of float32, shape (n_range, n_speed)
        Over the median of the map [dB].
    max_range : float
        Where the last range cell ends [m].
    max_speed : float
        Speeds reach from minus to plus this, positive = receding [m/s].
    """

    frame_id: str
    power: Float32Array
    max_range: float
    max_speed: float


@dataclass(frozen=True)
class StageFigures:
    """What a stage did in the last while."""

    stage: str
    rate: float  # messages per second
    compute: float  # median time spent on a message [s]; NaN: none came
    latency: float  # median time from the publication of a frame to this stage's result [s]; NaN: not known
    dropped: int  # since the node started
    stale: bool


@dataclass(frozen=True)
class NodeHealth:
    """The last word of one node on the topic diagnostics."""

    name: str
    level: Level
    message: str
    values: Mapping[str, str] = field(default_factory=dict)
