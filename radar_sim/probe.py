"""How much each effect changes a scene's frames: measured on some of them, with the effect and without."""

from __future__ import annotations

import math
import time
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, Final, Protocol

import numpy as np
from numpy.typing import NDArray

from radar_core import ConfigError, RadarInfo
from radar_sim.effects.base import Setting
from radar_sim.effects.chain import SIGNAL, is_named, switched
from radar_sim.effects.config import PHYSICS, Effects
from radar_sim.places import displacement, places
from radar_sim.scatterers import Echoes
from radar_sim.scene import Fidelity, Scene
from radar_sim.truth import SimulatedFrame
from radar_sim.world import World

ROOM: Final[tuple[str, ...]] = ("occlusion", "multipath", "pattern", "field_of_view")
"""Effects of every real room and antenna on what there is to see, and where; they act on each other."""
SHADES: Final[tuple[str, ...]] = ("occlusion", "field_of_view")
"""Effects that only take echoes away, which saves about the time that they cost: they are always judged by samples, which is stricter."""
_PROBES = 5
"""Frames that are looked at, evenly over the scene."""


@dataclass(frozen=True)
class Change:
    """What an effect changes.

    Attributes
    ----------
    samples : float
        Rms of the change of samples over the rms of the echoes.
    decisive : float
        What is held against the scene's tolerance. It is the change of samples where the scene is for samples; always so of effects on
        samples, which set the floor that everything is detected against, and of `SHADES`. Else it is how far the effect moves the
        strongest echoes, over their range: see `radar_sim.places`.
    """

    samples: float
    decisive: float

    def __str__(self) -> str:
        """Say both where they differ."""
        moves = f" and moves the strongest echoes by {self.decisive:.2g} of their range" if self.decisive != self.samples else ""
        return f"it changes the samples by {self.samples:.2g}{moves}"


class ProbedSimulator(Protocol):
    """What a probe needs of a simulator: `radar_sim.simulator.Simulator` is one. It uses probes itself, so it is not imported here."""

    scene: Scene
    setting: Setting
    info: RadarInfo
    world: World
    n_frames: int

    def process(self, sequence: int) -> SimulatedFrame:
        """Simulate one frame."""
        ...

    def echoes(self, sequence: int) -> Echoes:
        """Return what comes back to the radar during a frame."""
        ...


class MakeSimulator(Protocol):
    """Makes a simulator of a scene as one radar sees it; of a world that another one made, where it is given."""

    def __call__(self, scene: Scene, radar: str, world: World | None = None, /) -> ProbedSimulator:
        """Make it."""
        ...


@dataclass(frozen=True, eq=False)
class Probe:
    """Some frames of a scene as one radar would see them, with any set of effects.

    Parameters
    ----------
    scene : Scene
        Without ``effects: auto``.
    make : MakeSimulator
        What simulates it: `radar_sim.Simulator`.
    radar : str
        Which radar.
    """

    scene: Scene
    make: MakeSimulator
    radar: str = ""

    def simulator(self, effects: Effects, **more: Any) -> ProbedSimulator:
        """Simulate the scene with other effects."""
        return self.make(replace(self.scene, effects=effects, **more), self.radar, self._world)

    def frames(self, effects: Effects, *, exact: bool = True) -> NDArray[np.complex128]:
        """Simulate the probed frames [V], shape (frame, tx, chirp, rx, sample).

        Chirp by chirp, whatever the scene's fidelity; or not ``exact``: quickly, without what happens to echoes within a frame.
        """
        if exact:
            return self._take(self.simulator(effects, fidelity=Fidelity(model="exact")))
        still: dict[str, Any] = dict.fromkeys(PHYSICS, False)
        return self._take(self.simulator(replace(effects, **still), fidelity=Fidelity()))

    def _take(self, simulator: ProbedSimulator) -> NDArray[np.complex128]:
        n, converter = simulator.n_frames, simulator.scene.effects.converter
        chosen = sorted({round((k + 0.5) * n / _PROBES - 0.5) for k in range(_PROBES)}) if n else []
        volts = 1.0 if converter is None else converter.full_scale / 2 ** (converter.bits - 1)
        cubes = [simulator.process(k).frame.cube.astype(np.complex128) * volts for k in chosen]
        return np.stack(cubes) if cubes else np.zeros((0, *simulator.info.cube_shape), np.complex128)

    def bare(self) -> Effects:
        """Leave out the scene's effects on samples: the others are measured without them."""
        nothing: dict[str, Any] = dict.fromkeys(SIGNAL)
        return replace(self.scene.effects, **nothing)

    @cached_property
    def _echoes(self) -> NDArray[np.complex128]:
        return self.frames(self.bare())

    @cached_property
    def _quick_echoes(self) -> NDArray[np.complex128]:
        return self.frames(self.bare(), exact=False)

    def can(self, name: str) -> bool:
        """Whether this radar can have an effect; some are made for FMCW only.

        Raises
        ------
        ConfigError
            When the scene names an effect that its radar cannot have.
        """
        try:
            self.simulator(switched(self.scene.effects, name, True))
        except ConfigError:
            if is_named(self.scene.effects, name):
                raise
            return False
        return True

    def change(self, name: str) -> float:
        """Measure an effect: the rms of what it changes over the rms of the echoes; infinite where there are no echoes."""
        return self.measure(name).samples

    def measure(self, name: str) -> Change:
        """Measure what an effect changes in the scene as it is: in the samples, and in the quantity that the scene is for."""
        if not self.can(name):
            return Change(0.0, 0.0)
        exact = name in PHYSICS  # nothing else needs the true path of every chirp
        echoes = self._echoes if exact else self._quick_echoes
        with_it, without = echoes, echoes
        if name in SIGNAL or not is_named(self.scene.effects, name):
            with_it = self.frames(switched(self.bare(), name, True), exact=exact)
        else:
            without = self.frames(switched(self.bare(), name, False), exact=exact)
        return self._change(name, with_it, without, echoes)

    def missed(self, name: str) -> Change:
        """Measure what is lost when an effect is left out of a real room: among the others on what there is to see and where it is seen.

        They act on each other: only reflections may lie beyond the field of view. Effects on how echoes travel, and on samples, do not.
        """
        if name in ROOM:
            without = self.frames(switched(self._room(), name, False), exact=False)
            return self._change(name, self._whole, without, self._whole)
        return self.travel((name,)) if name in PHYSICS else self.measure(name)

    def travel(self, names: tuple[str, ...] = PHYSICS) -> Change:
        """Measure what effects on how echoes travel change together, against none of them; to a tenth of the tolerance."""
        only: dict[str, Any] = dict.fromkeys(PHYSICS, False) | dict.fromkeys(names, True)
        fine = self.simulator(replace(self.bare(), **only), fidelity=Fidelity(), tolerance=max(self.scene.tolerance / 10, 1e-6))
        return self._change(names[0], self._take(fine), self._quick_echoes, self._quick_echoes)

    @cached_property
    def _bare_simulator(self) -> ProbedSimulator:
        return self.make(replace(self.scene, effects=Effects()), self.radar)

    @property
    def _world(self) -> World:
        """What is there, with any effects: made once."""
        return self._bare_simulator.world

    @property
    def _info(self) -> RadarInfo:
        return self._bare_simulator.info

    def _room(self) -> Effects:
        effects = self.bare()
        for name in ROOM:
            effects = switched(effects, name, True)
        return effects

    @cached_property
    def _whole(self) -> NDArray[np.complex128]:
        return self.frames(self._room(), exact=False)

    def _change(
        self, name: str, with_it: NDArray[np.complex128], without: NDArray[np.complex128], echoes: NDArray[np.complex128]
    ) -> Change:
        changed, reference = (float(np.linalg.norm(x)) for x in (with_it - without, echoes))
        samples = changed / reference if reference > 0.0 else (math.inf if changed > 0.0 else 0.0)
        purpose = self.scene.purpose
        if purpose == "samples" or name in (*SIGNAL, *SHADES) or samples == 0.0:
            return Change(samples, samples)
        one, other = (places(x, self._info, moving=purpose != "detections") for x in (with_it, without))
        return Change(samples, displacement(one, other))

    def cost(self, name: str, repeat: int = 9) -> float:
        """Measure what an effect adds to the time of a frame, with the scene's own fidelity and other effects; at least 0 [ms]."""
        if not self.can(name):
            return 0.0
        pair = [self.simulator(switched(self.scene.effects, name, on)) for on in (False, True)]
        middle = pair[0].n_frames // 2
        times: list[list[float]] = [[], []]
        for _ in range(repeat if pair[0].n_frames else 0):
            for simulator, taken in zip(pair, times, strict=True):
                start = time.perf_counter_ns()
                simulator.process(middle)
                taken.append((time.perf_counter_ns() - start) * 1e-6)
        return max(float(np.median(times[1]) - np.median(times[0])), 0.0) if times[0] else 0.0
