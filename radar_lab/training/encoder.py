"""What the convolutional networks take: the feature cube of [SFL+20] (thesis, section 4.5.5), and the thesis's feature maps (4.2, 4.5.3).

A cube holds the strongest detections of every frame, maps the strongest of every Doppler gate.

[SFL+20] Y. Sun, T. Fei, X. Li, A. Warnecke, E. Warsitz, N. Pohl, "Real-time radar-based gesture detection and recognition built in an
edge-computing platform", IEEE Sensors Journal 20(18), 2020.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np

from radar_core import DataError, PointCloud
from radar_core.config import config, knob
from radar_core.types import Float32Array, IndexArray
from radar_gestures.maps import feature_maps

ATTRIBUTES: Final[tuple[str, ...]] = ("amplitude", "range", "radial_speed", "azimuth", "elevation")
"""First axis of the cube: SNR [dB], range [m], range rate [m/s], azimuth and elevation seen from the sensor [rad]."""
MAPS: Final[tuple[str, ...]] = ("micro_doppler", "azimuth", "elevation")
"""First axis of the maps of a network: SNR [dB], azimuth and elevation seen from the sensor [rad]."""

_LIMITS: Final[Float32Array] = np.array([200.0, 1e3, 1e3, 10.0, 10.0], np.float32)[:, None]
"""Larger values are cut: no radar measures them, and one would drown a cube."""


@config
class EncoderConfig:
    """How an event becomes a cube."""

    n_detections: int = knob(50, low=1, high=10_000, doc="strongest detections kept of each frame; [SFL+20] has 25, the thesis 50")
    n_frames: int = knob(50, low=1, high=10_000, doc="frames of a cube")
    frame_interval: float = knob(0.02, unit="s", low=1e-4, high=10.0, doc="time from frame to frame of the cube, whatever the radar's")
    relative: bool = knob(False, doc="take range, azimuth and elevation from the person's body, not from the sensor")


def encode(
    clouds: Sequence[PointCloud],
    config: EncoderConfig,
    *,
    start_ns: int | None = None,
    end_ns: int | None = None,
    body: tuple[float, float, float] = (0.0, 0.0, 0.0),
) -> Float32Array:
    """Arrange the detections of one event in a cube: strongest first, frame by frame, zeros where there is nothing.

    Frames are counted in time, not in clouds: at half the frame rate every other one is empty, and a lost cloud moves none of the others.
    Of an event longer than the cube the last frames are kept, as in section 4.5.5; of a shorter one the rest is zeros.

    Parameters
    ----------
    clouds : sequence of PointCloud
        Of one person, or of the one person in view, in any order.
    config : EncoderConfig
        The knobs.
    start_ns, end_ns : int or None
        The event [ns]; clouds outside are left out. None: from the first, to the last cloud.
    body : tuple of float, length 3
        Range [m], azimuth and elevation [rad] of the person, seen from the sensor; only used, and then finite, when ``relative`` is set.

    Returns
    -------
    ndarray of float32, shape (5, n_detections, n_frames)
        Axes (attribute, detection, frame), see `ATTRIBUTES`; always finite: what the sensor does not measure is 0.
    """
    if config.relative and not np.isfinite(body).all():
        raise DataError(f"encode: the body is at {body}; a cube relative to it needs finite numbers")
    cube = np.zeros((len(ATTRIBUTES), config.n_detections, config.n_frames), np.float32)
    inside = _inside(clouds, start_ns, end_ns)
    if not inside:
        return cube
    frame = _frames([c.stamp_ns for c in inside], config, start_ns, end_ns)
    column = np.repeat(frame, [len(c) for c in inside])
    points = np.concatenate([[c.snr, c.range, c.radial_speed, c.azimuth, c.elevation] for c in inside], axis=1)
    points, column = points[:, column >= 0], column[column >= 0]
    strength = np.where(np.isnan(points[0]), -np.inf, points[0])
    order = np.lexsort((-strength, column))  # by frame, within a frame the strongest first
    column = column[order]
    row = np.arange(len(column)) - np.searchsorted(column, column)  # place within the frame
    kept = row < config.n_detections
    values = points[:, order[kept]]
    if config.relative:
        values[[1, 3, 4]] -= np.array(body, np.float32)[:, None]
        values[3] = (values[3] + np.pi) % (2 * np.pi) - np.pi
    values = np.clip(np.nan_to_num(values, nan=0.0, posinf=np.inf, neginf=-np.inf), -_LIMITS, _LIMITS)
    cube[:, row[kept], column[kept]] = values
    return cube


def encode_maps(
    clouds: Sequence[PointCloud],
    config: EncoderConfig,
    gate: float,
    max_speed: float,
    *,
    start_ns: int | None = None,
    end_ns: int | None = None,
) -> Float32Array:
    """Arrange the three feature maps of one event as the input of a network: as many frames for every event (thesis, section 4.2).

    Frames are those of `encode`: counted in time, the last ones of an event that is longer, zeros after one that is shorter. Of two
    clouds in one frame the later one counts.

    Parameters
    ----------
    clouds, start_ns, end_ns
        As in `encode`.
    config : EncoderConfig
        ``n_frames`` and ``frame_interval``; the rest is for cubes.
    gate, max_speed : float
        Width of a Doppler gate, and how far the gates reach to both sides [m/s], as in `feature_maps`.

    Returns
    -------
    ndarray of float32, shape (3, n_speed, n_frames)
        Axes (map, Doppler gate, frame), see `MAPS`; gates ascend, receding ones last. Always finite: 0 where nothing was detected, and for
        what the sensor does not measure.
    """
    inside = sorted(_inside(clouds, start_ns, end_ns), key=lambda cloud: cloud.stamp_ns)
    found = feature_maps(inside, gate, max_speed)
    maps = np.zeros((len(MAPS), len(found.speed), config.n_frames), np.float32)
    if not inside:
        return maps
    values, limits = np.array([getattr(found, name) for name in MAPS]), _LIMITS[[0, 3, 4], None]
    values = np.clip(np.nan_to_num(values, nan=0.0, posinf=np.inf, neginf=-np.inf), -limits, limits)
    for k, frame in enumerate(_frames([cloud.stamp_ns for cloud in inside], config, start_ns, end_ns).tolist()):
        if frame >= 0:
            maps[:, :, frame] = values[:, k]
    return maps


def _inside(clouds: Sequence[PointCloud], start_ns: int | None, end_ns: int | None) -> list[PointCloud]:
    """Clouds of the event, in the order given."""
    return [c for c in clouds if (start_ns is None or c.stamp_ns >= start_ns) and (end_ns is None or c.stamp_ns <= end_ns)]


def _frames(stamps: Sequence[int], config: EncoderConfig, start_ns: int | None, end_ns: int | None) -> IndexArray:
    """Frame of the cube that each stamp falls into, shape (n_clouds,); -1: before the last `n_frames` of the event."""
    interval = round(config.frame_interval * 1e9)
    start = min(stamps) if start_ns is None else start_ns
    end = max(stamps) if end_ns is None else end_ns
    # Differences of Python integers: stamps of a real clock have no room for sums in a double.
    first = max(0, (end - start + interval // 2) // interval - (config.n_frames - 1))
    number = np.array([(stamp - start + interval // 2) // interval - first for stamp in stamps], np.int64)
    return np.where((number >= 0) & (number < config.n_frames), number, -1)
