"""Joints of people as point targets of `radar_lab.datasets.point_radar`."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np

from radar_core.types import BoolArray, Float64Array
from radar_lab.datasets.point_radar import Targets
from radar_sim.bodies.base import BONES, Pose

_ARMS: Final = [[BONES.index(f"{bone}_{side}") for bone in ("upperarm", "lowerarm", "hand")] for side in "lr"]
_LEVELS: Final = {"arm": -4.0, "hand": -6.0, "head": -4.0, "calf": -6.0, "foot": -6.0, "ball": -6.0}
_TRUNK: Final = ("spine", "pelvis", "thigh", "clavicle", "neck")
_OTHERS: Final = -6.0  # dB
_SHADOW: Final = -14.0  # dB: of what is behind a trunk
_BEHIND, _BESIDE = 0.12, 0.2  # m: farther behind the middle of one's own trunk, and nearer to its line of sight, one's limbs are hidden
_BEHIND_OTHERS, _BESIDE_OTHERS = 0.2, 0.22  # m: the same of others
_UNLIKE: Final = 2.0  # dB: by how much parts of bodies differ from person to person


def placed(pose: Pose) -> Float64Array:
    """Places of a body's targets at T times, shape (T, n_targets, 3) [m]: joints, hands, and the middles of upper and lower arms."""
    arms = pose.joint[:, _ARMS]
    middles = (arms[:, :, 1:] + arms[:, :, :-1]) / 2.0
    return np.concatenate([pose.joint, pose.hand, middles.reshape(len(arms), -1, 3)], axis=1)


def levels(rng: np.random.Generator) -> Float64Array:
    """Draw how strong a body's targets are beside a trunk's, shape (n_targets,) [dB]; see `placed`."""
    joints = [0.0 if any(name in bone for name in _TRUNK) else _level(bone) for bone in BONES]
    usual = np.array([*joints, *[_LEVELS["hand"]] * 2, *[_LEVELS["arm"]] * 4])
    return np.asarray(usual + rng.normal(0.0, _UNLIKE, len(usual)))


def _level(bone: str) -> float:
    return next((level for name, level in _LEVELS.items() if name in bone), _OTHERS)


def seen_from(origin: Float64Array, before: Float64Array, after: Float64Array, span: float, level: Float64Array) -> Targets:
    """See targets from a place, shape (3,): where they are at the begin and the end of ``span`` [s], shape (T, n_targets, 3) each [m]."""
    near, far = (np.linalg.norm(place - origin, axis=-1) for place in (before, after))
    x, y, z = np.moveaxis((before + after) / 2.0 - origin, -1, 0)
    azimuth, elevation = np.arctan2(y, x), np.arctan2(z, np.hypot(x, y))
    return Targets((near + far) / 2.0, azimuth, elevation, (far - near) / span, np.broadcast_to(level, near.shape))


def shadows(targets: Targets, own: Float64Array, others: Sequence[Float64Array]) -> Float64Array:
    """Say what trunks take of the levels of a body's targets, shape (T, n_targets) [dB].

    ``own`` and each of ``others``: where the middle of the trunk is, from the sensor, shape (T, 3) [m].
    """
    hidden = _behind(targets, own, _BEHIND, _BESIDE)
    for other in others:
        hidden |= _behind(targets, other, _BEHIND_OTHERS, _BESIDE_OTHERS)
    return np.where(hidden, _SHADOW, 0.0)


def _behind(targets: Targets, trunk: Float64Array, behind: float, beside: float) -> BoolArray:
    flat = np.hypot(trunk[:, 0], trunk[:, 1])[:, None]
    turn = targets.azimuth - np.arctan2(trunk[:, 1], trunk[:, 0])[:, None]
    aside = np.abs((turn + np.pi) % (2.0 * np.pi) - np.pi) * flat
    return np.asarray((targets.range > np.linalg.norm(trunk, axis=1)[:, None] + behind) & (aside < beside))
