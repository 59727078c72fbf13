"""Compile what a tracker needs before its first cloud comes."""

from __future__ import annotations

import contextlib
from dataclasses import replace

import numpy as np

from radar_core import HandwaveError, PointCloud
from radar_tracking.people.config import TrackerConfig
from radar_tracking.people.make import make_tracker

_WARM_UP = 50  # clouds at 50 Hz: enough for two people to be found, followed and confirmed, and to come so near that their points merge
_ALONE = 10  # of these show one person: arrays of one row are contiguous where others are not, which is another type for numba
_APART = 30  # before this one the two are 0.9 m apart


def warm_up(config: TrackerConfig) -> None:
    """Compile what a tracker of that configuration needs, by following two made-up people, so that a node loses no cloud meanwhile."""
    everywhere = replace(
        TrackerConfig(), tracker=config.tracker, association=config.association, filter=config.filter
    )  # no zones, no bounds
    tracker = make_tracker(everywhere)
    rng = np.random.default_rng(1)
    with contextlib.suppress(HandwaveError):  # what is wrong with the configuration is said when it is used
        for k in range(_WARM_UP):
            tracker.process(_made_up(rng, k))


def _made_up(rng: np.random.Generator, sequence: int) -> PointCloud:
    """Make a cloud of a body that walks, and later of a second one that joins it."""
    aside = 0.45 - 0.0175 * max(sequence - _APART, 0)
    bodies = [[2.0, aside, 1.0], [2.0, -aside, 1.0]][: 1 if sequence < _ALONE else 2]
    centre = np.repeat(bodies, 30, axis=0)
    centre[:, 0] += 0.02 * sequence
    x, y, z = (centre + rng.normal(0.0, 0.05, centre.shape)).astype(np.float32).T
    speed = rng.normal(1.0, 0.2, len(centre)).astype(np.float32)
    cloud = PointCloud(20_000_000 * sequence, sequence, "room", x=x, y=y, z=z)
    return replace(cloud, radial_speed=speed, snr=np.full(len(centre), 20.0, np.float32))
