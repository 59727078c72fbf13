"""Models of propagation by name, and ``auto``: for each frame the cheapest that is within the tolerance."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from radar_core import ConfigError
from radar_sim.modulation import Ofdm, Tone
from radar_sim.propagation.base import Float64Array, Physics, Propagator, Sampling
from radar_sim.propagation.blocks import Blocks
from radar_sim.propagation.exact import Exact
from radar_sim.propagation.nufft import Nufft
from radar_sim.propagation.predict import FLOOR, Sizes, blocks_error, separable_error
from radar_sim.propagation.reference import Reference
from radar_sim.propagation.separable import Separable
from radar_sim.scatterers import Echoes
from radar_sim.scene import MODELS, Fidelity


@dataclass(frozen=True)
class Step:
    """One place on the dial between accuracy and time.

    Attributes
    ----------
    model : str
        One of `radar_sim.scene.MODELS`.
    blocks, order : int
        For blocks.
    """

    model: str
    blocks: int = 0
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


def make_propagator(fidelity: Fidelity, physics: Physics, sampling: Sampling, tolerance: float) -> Propagator:
    """Make the model of propagation that a scene names.

    A tone and OFDM always follow the true path (`radar_sim.modulation`), whatever ``fidelity`` and ``physics`` say.

    Parameters
    ----------
    fidelity : Fidelity
        Which model.
    physics : Physics
        What the scene names.
    sampling : Sampling
        When and where samples are taken.
    tolerance : float
        Relative rms error that auto may make.

    Raises
    ------
    ConfigError
        When the model cannot show the physics, or has more blocks than there are chirps.
    """
    modulation = sampling.info.waveform.modulation
    if modulation != "fmcw":
        return Tone(sampling) if modulation == "cw" else Ofdm(sampling)
    if fidelity.model == "auto":
        return Auto(physics, sampling, tolerance)
    return make_step(Step(fidelity.model, fidelity.blocks, fidelity.order), physics, sampling)


def make_step(step: Step, physics: Physics, sampling: Sampling) -> Propagator:
    """Make one model; errors as for `make_propagator`."""
    if step.model == "blocks":
        return Blocks(physics, sampling, step.blocks, step.order)
    models: dict[str, Callable[[Physics, Sampling], Propagator]] = {
        "separable": Separable,
        "nufft": Nufft,
        "exact": Exact,
        "reference": Reference,
    }
    if step.model not in models:
        raise ConfigError(f"fidelity.model is {step.model!r}; choose one of {', '.join(('auto', *MODELS))}", key=("fidelity", "model"))
    return models[step.model](physics, sampling)


class Auto:
    """For each frame, the cheapest model whose predicted error is within the tolerance.

    Costs and errors are closed forms of the echoes (`radar_sim.propagation.predict`), so a frame is the same on every machine. Physics that
    a scene names but that matters less than the tolerance does not cost the time of showing it.

    Parameters
    ----------
    physics, sampling
        As for every model.
    tolerance : float
        Relative rms error.
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
        gridded = late is None and echoes.envelope is None
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
