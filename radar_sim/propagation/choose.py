"""Models of propagation by name, and ``auto``: for each frame the cheapest that is within the tolerance.

Errors are predicted in closed form. Every simplification leaves a phase (or relative amplitude) that is a product of powers of slow time,
fast time and place in the array. Its rms over the frame is known, echoes add up without phase, and one that is off by more than a radian
counts as lost.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from radar_core import SPEED_OF_LIGHT, ConfigError
from radar_sim.propagation.base import NEAR, Float64Array, Physics, Propagator, Sampling
from radar_sim.propagation.blocks import Blocks
from radar_sim.propagation.exact import Exact
from radar_sim.propagation.kernels import TINY
from radar_sim.propagation.reference import Ofdm, Reference
from radar_sim.propagation.separable import HAS_NUFFT, Nufft, Separable
from radar_sim.scatterers import Echoes, Motion
from radar_sim.scene import MODELS, Fidelity


@dataclass(frozen=True)
class Step:
    """One place on the dial between accuracy and time."""

    model: str  # one of `radar_sim.scene.MODELS`
    blocks: int = 0  # for blocks
    order: int = 0

    def __str__(self) -> str:
        return f"{self.model} {self.blocks} order {self.order}" if self.model == "blocks" else self.model


DIAL: Final = (
    Step("separable"),
    Step("nufft"),
    Step("blocks", 1, 1),
    Step("blocks", 1, 2),
    Step("blocks", 2, 2),
    Step("blocks", 4, 2),
    Step("exact"),
    Step("reference"),
)
"""What auto chooses from; with any physics named, errors fall from blocks to blocks."""
FLOOR: Final[dict[str, float]] = {"separable": 1e-6, "nufft": 3e-5, "blocks": 3e-5, "exact": 3e-5, "reference": 1e-7}
"""What arithmetic leaves, relative rms; measured at most 5e-7, 1e-5, 1e-5, 1e-5, 5e-8."""
_LOST = 2.0
"""Squared relative error of an echo whose phase is anywhere."""
_MOMENTS = (1.0, 1.8 / 2, 3.9 / 6)
"""Rms of x^(n + 1) / (n + 1)! over that of x to this power, x a product of two even distributions."""


def make_propagator(fidelity: Fidelity, physics: Physics, sampling: Sampling, tolerance: float) -> Propagator:
    """Make the model of propagation that a scene names.

    A tone and OFDM always follow the true path (`radar_sim.propagation.reference`), whatever ``fidelity`` and ``physics`` say; a tone is a
    sweep that does not sweep. ``tolerance`` is the relative rms error that auto may make.

    Raises
    ------
    ConfigError
        When the model cannot show the physics, or has more blocks than there are chirps.
    """
    modulation = sampling.info.waveform.modulation
    if modulation != "fmcw":
        return Exact(Physics.all(), sampling) if modulation == "cw" else Ofdm(sampling)
    if fidelity.model == "auto":
        return Auto(physics, sampling, tolerance)
    return make_step(Step(fidelity.model, fidelity.blocks, fidelity.order), physics, sampling)


def make_step(step: Step, physics: Physics, sampling: Sampling) -> Propagator:
    """Make one model; errors as for `make_propagator`."""
    if step.model == "blocks":
        return Blocks(physics, sampling, step.blocks, step.order)
    models: dict[str, Callable[..., Propagator]] = {"separable": Separable, "nufft": Nufft, "exact": Exact, "reference": Reference}
    if step.model not in models:
        raise ConfigError(f"fidelity.model is {step.model!r}; choose one of {', '.join(('auto', *MODELS))}", key=("fidelity", "model"))
    return models[step.model](physics, sampling)


class Auto:
    """For each frame, the cheapest model whose predicted error is within the tolerance.

    Costs and errors are closed forms of the echoes, so a frame is the same on every machine that has finufft; without, the matrix product
    takes the place of its transform. Physics that a scene names but that matters
    less than the tolerance, a relative rms error, does not cost the time of showing it.
    """

    def __init__(self, physics: Physics, sampling: Sampling, tolerance: float) -> None:
        self._physics, self._sampling, self._tolerance = physics, sampling, tolerance
        chirps = sampling.info.waveform.n_chirp
        self._dial = tuple(step for step in DIAL if step.blocks <= chirps)
        self._models: dict[Step, Propagator] = {}

    def process(self, echoes: Echoes, late: Float64Array | None = None) -> NDArray[np.complex64]:
        """Superpose echoes, as `Propagator.process`."""
        step = self.choose(echoes, late)
        if step not in self._models:
            simple = Physics(doppler_in_chirp=self._physics.doppler_in_chirp)
            self._models[step] = make_step(step, simple if step.model in ("separable", "nufft") else self._physics, self._sampling)
        return self._models[step].process(echoes, late)

    def choose(self, echoes: Echoes, late: Float64Array | None = None) -> Step:
        """Say which model a frame gets."""
        gridded = late is None and echoes.envelope is None and HAS_NUFFT
        dial = [step for step in self._dial if gridded or step.model != "nufft"]
        sizes = None if self._physics.separable else Sizes.of(echoes, self._sampling)
        for step in sorted(dial, key=lambda step: cost(step, len(echoes), self._sampling)):
            if step.model == "reference" or predicted(step, sizes, self._physics, self._sampling) <= self._tolerance:
                return step
        raise AssertionError("the reference is always on the dial")


def predicted(step: Step, sizes: Sizes | None, physics: Physics, sampling: Sampling) -> float:
    """Relative rms error of a model; without sizes what its arithmetic leaves."""
    floor = FLOOR[step.model]
    if sizes is None or step.model in ("exact", "reference"):
        return floor
    if step.model == "blocks":
        return floor + blocks_error(sizes, physics, sampling, step.blocks, step.order)
    return floor + separable_error(sizes, physics, sampling)


def cost(step: Step, n: int, sampling: Sampling) -> float:
    """About how long a frame of n echoes takes [us].

    The constants were measured with the default radar (`python -m benchmarks simulator`); other radars are scaled by what each model's
    work is proportional to. Only their order matters, and that it does not depend on a clock.
    """
    w, n_rx = sampling.info.waveform, len(sampling.rx)
    channels = w.n_tx * n_rx / 8
    lanes = channels * w.n_chirp / 64
    samples = lanes * w.n_sample / 64
    if step.model == "separable":
        return 20 + 2.45 * n * samples
    if step.model == "nufft":
        return 20 + 450 * samples + 0.23 * n * channels
    if step.model == "blocks":
        return 50 + 400 * samples + (0.8 * lanes + 0.18 * step.blocks * channels) * n
    return 30 + (10.7 if step.model == "exact" else 3800.0) * n * samples


@dataclass(frozen=True, eq=False)
class Sizes:
    """What errors are made of, one number per echo; path differences over the array are rms over the channels."""

    weight: Float64Array  # power of each, their sum is 1
    path: Float64Array  # path out and back [m], and its first three derivatives [m/s, ...]; the last a bound
    rate: Float64Array
    bend: Float64Array
    twist: Float64Array
    fading: Float64Array  # relative rate of the amplitude [1/s]
    side: Float64Array  # path differences of planes about the origin [m]
    spread: Float64Array  # about their mean [m]
    turning: Float64Array  # their rate [m/s]
    hook: Float64Array  # a bound of half their acceleration [m/s^2]
    sphere: Float64Array  # of spheres against planes [m]

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
