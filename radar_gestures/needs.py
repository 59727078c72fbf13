"""What a gesture model needs of a radar, by how its events and features are made, and what a radar does not give of it."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any, Final, Protocol

import numpy as np

from radar_core import RadarInfo
from radar_core.config import load
from radar_gestures.events import EventConfig
from radar_gestures.features import FeatureConfig

_CLOUDS_OF_REST: Final = 3.5  # clouds within the quiet time: with fewer, one that is lost ends a gesture that has not ended
_OUTRUN: Final = 2.0  # times the speed that starts an event: hands are about that fast, and faster ones seem to turn round
_SAME: Final = 1e-6  # m: antennas nearer to each other than this stand in one place
_TOLERANCE: Final = 1.02  # clocks and rounded numbers


@dataclass(frozen=True)
class Needs:
    """What a model needs of a radar.

    Attributes
    ----------
    interval : float
        Longest time from one cloud to the next [s].
    speed_step : float
        Widest Doppler cell [m/s].
    max_speed : float
        Least range rate that is told from its opposite [m/s].
    azimuth, elevation : bool
        Whether it uses these angles.
    """

    interval: float
    speed_step: float
    max_speed: float
    azimuth: bool = True
    elevation: bool = True


class _Model(Protocol):
    @property
    def names(self) -> tuple[str, ...]: ...

    @property
    def settings(self) -> Mapping[str, Any]: ...


def needs(model: _Model) -> Needs:
    """Derive what a model needs from the settings of its events and features.

    An event ends after ``quiet`` seconds without motion: these have to hold some clouds. What is slower than ``gate`` is the body: a
    Doppler cell may not reach beyond it to both sides. Hands outrun ``threshold``, at which an event starts.

    Raises
    ------
    ConfigError
        When the settings are none of events and features.
    """
    if "needs" in model.settings:
        return load(Needs, model.settings["needs"], "needs of the gesture model")
    events = load(EventConfig, model.settings.get("events"), "events of the gesture model")
    features = load(FeatureConfig, model.settings.get("features"), "features of the gesture model")
    sides = any(word in name for name in model.names for word in ("azimuth", "side"))
    heights = any(word in name for name in model.names for word in ("elevation", "height"))
    return Needs(events.quiet / _CLOUDS_OF_REST, 2.0 * features.gate, _OUTRUN * events.threshold, sides, heights)


def lacks(wanted: Needs, info: RadarInfo) -> tuple[str, ...]:
    """Say in a sentence each what a radar does not give of what a model needs; empty: it gives all."""
    wave, places = info.waveform, info.array.virtual
    wide, high = (np.ptp(places[:, axis]) > _SAME for axis in (0, 1))
    said = {
        f"clouds come every {wave.frame_interval:.3g} s, where {wanted.interval:.2g} s is wanted: strokes are cut or joined":
            wave.frame_interval > _TOLERANCE * wanted.interval,
        f"a Doppler cell is {wave.speed_resolution:.2g} m/s wide, where {wanted.speed_step:.2g} m/s is wanted: slow hands seem to rest":
            wave.speed_resolution > _TOLERANCE * wanted.speed_step,
        f"speeds are told up to {wave.max_speed:.2g} m/s, where {wanted.max_speed:.2g} m/s is wanted: fast hands seem to turn round":
            wave.max_speed * _TOLERANCE < wanted.max_speed,
        "the radar tells no azimuth: swipes to the right and left look alike": wanted.azimuth and not wide,
        "the radar tells no elevation: swipes up and down look alike": wanted.elevation and not high,
    }  # fmt: skip
    return tuple(sentence for sentence, wrong in said.items() if wrong)


def warning(sentences: Iterable[str], model: str) -> str:
    """Put what a radar lacks into one line; empty when it lacks nothing."""
    told = "; ".join(sentences)
    return f"gesture model {model} was made for another radar: {told}" if told else ""
