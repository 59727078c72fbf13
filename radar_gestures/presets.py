"""Knobs of events and features for a radar that nobody has said more about."""

from __future__ import annotations

import dataclasses

from radar_core import RadarInfo
from radar_core.config import load_file
from radar_core.paths import find_config
from radar_gestures.features import FeatureConfig
from radar_gestures.stage import GestureConfig

_SLOW = 0.06  # s: with clouds farther apart than that, the default events ask for more clouds than a stroke has
_COARSE = 0.25  # m/s: with Doppler steps above it the body's own speed would be the first one


def usual_config(info: RadarInfo) -> GestureConfig:
    """Return the knobs for a radar: the defaults, or, for one with few clouds a second, the preset ``slow_radar`` with its Doppler step.

    Raises
    ------
    ConfigError
        When the preset cannot be read.
    """
    if info.waveform.frame_interval < _SLOW:
        return GestureConfig()
    slow = load_file(GestureConfig, find_config("slow_radar", "gestures", ".yaml"))
    step = info.waveform.speed_resolution
    return dataclasses.replace(slow, features=FeatureConfig(gate=step, body_speed=step / 2)) if step > _COARSE else slow
