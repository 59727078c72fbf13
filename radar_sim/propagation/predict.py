"""How large the error of a model is on given echoes, in closed form: what ``fidelity: auto`` goes by.

Every simplification leaves a phase (or relative amplitude) that is a product of powers of slow time, fast time and place in the array. Its
rms over the frame is known, echoes add up without phase, and one that is off by more than a radian counts as lost.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np

from radar_core import SPEED_OF_LIGHT
from radar_sim.propagation.base import NEAR, Float64Array, Physics, Sampling
from radar_sim.propagation.kernels import TINY
from radar_sim.scatterers import Echoes, Motion

FLOOR: Final[dict[str, float]] = {"separable": 1e-6, "nufft": 3e-5, "blocks": 3e-5, "exact": 3e-5, "reference": 1e-7}
"""What arithmetic leaves, relative rms; measured at most 5e-7, 1e-5, 1e-5, 1e-5, 5e-8."""
_LOST = 2.0
"""Squared relative error of an echo whose phase is anywhere."""
_MOMENTS = (1.0, 1.8 / 2, 3.9 / 6)
"""Rms of x^(n + 1) / (n + 1)! over that of x to this power, x a product of two even distributions."""


@dataclass(frozen=True, eq=False)
class Sizes:
    """What errors are made of, one number per echo.

    Attributes
    ----------
    weight : ndarray
        Power of each, their sum is 1.
    path, rate, bend, twist : ndarray
        Path out and back and its first three derivatives [m, m/s, ...]; the last a bound.
    fading : ndarray
        Relative rate of the amplitude [1/s].
    side, spread, turning, hook, sphere : ndarray
        Path differences over the array [m], each rms over the channels: of planes about the origin; about their mean; their rate [m/s];
        a bound of half their acceleration [m/s^2]; of spheres against planes.
    """

    weight: Float64Array
    path: Float64Array
    rate: Float64Array
    bend: Float64Array
    twist: Float64Array
    fading: Float64Array
    side: Float64Array
    spread: Float64Array
    turning: Float64Array
    hook: Float64Array
    sphere: Float64Array

    @classmethod
    def of(cls, echoes: Echoes, sampling: Sampling) -> Sizes:
        """Measure echoes in the middle of the frame."""
        out, back = _Ray(echoes.out, sampling.tx), _Ray(echoes.back, sampling.rx)
        near = [np.maximum(ray.length, NEAR) for ray in (out, back)]
        power = (np.abs(echoes.strength) / (near[0] * near[1])) ** 2
        if echoes.envelope is not None:
            power = power * np.mean(echoes.envelope.astype(np.float64) ** 2, axis=(0, 1))
        total = float(power.sum())
        return cls(
            weight=power / total if total > 0 else np.zeros(len(power)),
            path=out.length + back.length,
            rate=out.rate + back.rate,
            bend=out.bend + back.bend,
            twist=out.twist + back.twist,
            fading=np.abs(out.rate / near[0] + back.rate / near[1]),
            side=_over(out.sides, back.sides, centred=False),
            spread=_over(out.sides, back.sides, centred=True),
            turning=_over(out.turning, back.turning, centred=False),
            hook=out.hook + back.hook,
            sphere=_over(out.sphere, back.sphere, centred=False),
        )


class _Ray:
    """One leg; arrays over elements are (element, n)."""

    def __init__(self, motion: Motion, elements: Float64Array) -> None:
        p, v, a = motion.position, motion.velocity, motion.acceleration
        self.length = np.sqrt((p**2).sum(-1))
        safe = np.maximum(self.length, TINY)
        direction = p / safe[:, None]
        self.rate = (direction * v).sum(-1)
        across = v - direction * self.rate[:, None]
        speed, force = np.sqrt((across**2).sum(-1)), np.sqrt((a**2).sum(-1))
        self.bend = (direction * a).sum(-1) + speed**2 / safe
        self.twist = 3 * speed * (force + speed * np.abs(self.rate) / safe) / safe
        self.sides = elements @ direction[:, 1:].T
        self.turning = elements @ (across[:, 1:] / safe[:, None]).T
        reach = math.sqrt(float((elements**2).sum(-1).mean()))
        self.hook = 0.5 * reach * (force + 2 * speed * np.abs(self.rate) / safe) / safe
        self.sphere = ((elements**2).sum(-1)[:, None] - self.sides**2) / (2 * safe)


def _over(out: Float64Array, back: Float64Array, centred: bool) -> Float64Array:
    """Rms over all pairs of elements of the sum of both legs' numbers."""
    mean = 0.0 if centred else out.mean(0) + back.mean(0)
    return np.asarray(np.sqrt(out.var(0) + back.var(0) + mean**2))


def separable_error(sizes: Sizes, physics: Physics, sampling: Sampling) -> float:
    """Relative rms of what the separable models leave out of the physics."""
    slow, fast, wave, slope = _scales(sampling, 1)
    left: list[Float64Array] = []
    if physics.range_migration:
        left += [slope * sizes.rate * slow * fast, slope * sizes.path * sizes.rate * slow / SPEED_OF_LIGHT, sizes.fading * slow]
    if physics.range_migration and physics.doppler_in_chirp:
        left += [slope * sizes.rate * _square(fast)]
    if physics.squint:
        left += [slope * sizes.side * fast]
    if physics.curvature:
        left += [wave * sizes.bend / 2 * _square(slow), wave * sizes.turning * slow]
    if physics.curvature and physics.doppler_in_chirp:
        left += [wave * sizes.bend * slow * fast]
    if physics.near_field:
        left += [wave * sizes.sphere]
    return _total(sizes, left)


def blocks_error(sizes: Sizes, physics: Physics, sampling: Sampling, blocks: int, order: int) -> float:
    """Relative rms of what `radar_sim.propagation.blocks.Blocks` leaves out."""
    slow, fast, wave, slope = _scales(sampling, blocks)
    shifts, left = np.zeros(len(sizes.weight)), []
    if physics.range_migration:
        shifts += (slope * sizes.rate * slow * fast) ** 2
    if physics.squint:
        shifts += (slope * sizes.spread * fast) ** 2
    if physics.curvature:
        left += [wave * sizes.twist / 6 * (math.sqrt(3) * slow) ** 3 / math.sqrt(7), wave * sizes.hook * _square(slow)]
    if physics.curvature and physics.doppler_in_chirp:
        shifts += (wave * sizes.bend * slow * fast) ** 2 + (wave * sizes.turning * fast) ** 2
    if order < 2 and physics.doppler_in_chirp:
        change = slope * sizes.rate if physics.range_migration else 0.0 * sizes.rate
        left += [(change + wave * sizes.bend / 2 if physics.curvature else change) * _square(fast)]
    return _total(sizes, [*left, _MOMENTS[order] * np.sqrt(shifts) ** (order + 1)])


def _scales(sampling: Sampling, blocks: int) -> tuple[float, float, float, float]:
    """Rms of slow and fast time about their middle [s]; radians per metre of path, and per metre of path and second."""
    w = sampling.info.waveform
    turns = 2 * math.pi / SPEED_OF_LIGHT
    return w.acquisition_time / blocks / math.sqrt(12), w.chirp_duration / math.sqrt(12), turns * w.carrier, turns * w.slope


def _square(rms: float) -> float:
    """Rms of the square of what is distributed evenly about 0, from its own rms."""
    return 3 * rms**2 / math.sqrt(5)


def _total(sizes: Sizes, left: list[Float64Array]) -> float:
    lost = np.minimum(sum((x**2 for x in left), np.zeros(len(sizes.weight))), _LOST)
    return math.sqrt(float((sizes.weight * lost).sum()))
