"""A made-up person in front of one radar whose few points sit on the body and on both hands; the hands move up and down and sideways."""

from __future__ import annotations

import numpy as np

from radar_core import PointCloud
from radar_lab.posture.features import PostureFeatureConfig
from radar_lab.posture.training import HandRecording, PostureTrainingConfig
from radar_tracking import Track, TrackedCloud, Tracks, TrackStatus

FRAME_NS = 100_000_000
ORIGIN = np.array([0.0, 0.0, 1.0])
SMALL = PostureTrainingConfig(features=PostureFeatureConfig(history=(0.2,)), hidden=(32,), members=1, epochs=25, components=40)
"""Trains in a few seconds on three minutes of two hands."""


def hands(n: int, seed: int = 0) -> np.ndarray:
    """Paths of both hands relative to the body's place on the floor, shape (n, 2, 3) [m]: slow sines of unrelated rates."""
    t, rng = np.arange(n) * FRAME_NS * 1e-9, np.random.default_rng(seed)
    rate, phase = rng.uniform(1.0, 2.0, (2, 3)), rng.uniform(0, 2 * np.pi, (2, 3))
    middle = np.array([[-0.25, -0.45, 1.2], [-0.25, 0.45, 1.2]])  # facing the radar, the left hand is on the right of the room's x
    return middle + np.array([0.1, 0.2, 0.45]) * np.sin(t[:, None, None] * rate + phase)


def tracked(points: np.ndarray, rate: np.ndarray, k: int, body: np.ndarray, frame_ns: int = FRAME_NS) -> TrackedCloud:
    """A cloud whose points all belong to the one person at ``body``, shape (3,)."""
    p = np.asarray(points, np.float32).reshape(-1, 3)
    cloud = PointCloud(
        k * frame_ns, k, "room", p[:, 0].copy(), p[:, 1].copy(), p[:, 2].copy(), radial_speed=np.asarray(rate, np.float32).reshape(-1)
    )
    track = Track(7, TrackStatus.CONFIRMED, 10.0, 0.0, len(p), body.copy(), np.zeros(3), np.full(3, 0.2), np.eye(6))
    return TrackedCloud(cloud, Tracks(cloud.stamp_ns, k, "room", (track,), np.full(len(p), 7, np.int32)))


def recording(n: int = 600, seed: int = 0, body: tuple[float, float] = (2.0, 0.3), noise: float = 0.08, per_hand: int = 3) -> HandRecording:
    """``n`` clouds of eight body points and ``per_hand`` points at each hand, with an error of ``noise`` [m] in every axis."""
    rng, place = np.random.default_rng(100 + seed), np.array([*body, 1.1])
    true = hands(n, seed) + np.array([*body, 0.0])
    speed = np.gradient(true, FRAME_NS * 1e-9, axis=0)
    clouds = []
    for k in range(n):
        points = [place + rng.normal(0, (0.1, 0.15, 0.3), (8, 3)), *(true[k].repeat(per_hand, axis=0),)]
        away = np.concatenate(points) - ORIGIN
        along = away[8:] / np.linalg.norm(away[8:], axis=1)[:, None]
        rate = np.concatenate([np.zeros(8), (along * speed[k].repeat(per_hand, axis=0)).sum(axis=1)])
        found = np.concatenate(points) + rng.normal(0, noise, (len(away), 3))
        clouds.append(tracked(found, rate, k, place))
    return HandRecording(tuple(clouds), true, ORIGIN)


def mirrored(one: HandRecording) -> HandRecording:
    """The same seen in a mirror at y = 0: every y changes its sign, left and right hand change places."""
    flip = np.array([1.0, -1.0, 1.0])
    clouds = [
        tracked(c.cloud.position * flip, c.cloud.radial_speed, k, c.tracks.tracks[0].position * flip) for k, c in enumerate(one.clouds)
    ]
    return HandRecording(tuple(clouds), one.hands[:, ::-1] * flip, one.origin)
