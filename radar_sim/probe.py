"""How much each effect changes a scene's frames: measured on some of them, with the effect and without.

It is measured in samples, and in where the echoes of a frame come from: the places of the strongest echoes.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from radar_core import SPEED_OF_LIGHT, ConfigError, RadarInfo
from radar_core.linalg import first_max
from radar_sim.effects.chain import SIGNAL, is_named, switched
from radar_sim.effects.config import PHYSICS, Effects
from radar_sim.scene import Fidelity, Scene

ROOM: Final[tuple[str, ...]] = ("occlusion", "multipath", "pattern", "field_of_view")
"""Effects of every real room and antenna on what there is to see, and where; they act on each other."""
SHADES: Final[tuple[str, ...]] = ("occlusion", "field_of_view")
"""Effects that only take echoes away, which saves about the time that they cost: they are always judged by samples, which is stricter."""
_PROBES = 5
"""Frames that are looked at, evenly over the scene."""
_CELLS = 32
"""Strongest cells that are looked at."""
_DIRECTIONS = np.linspace(-1.0, 1.0, 181)
"""Sines of azimuth that are compared."""


Cubes = NDArray[np.complex128]


@dataclass(frozen=True)
class Change:
    """What an effect changes."""

    samples: float  # rms of the change of samples over the rms of the echoes
    # What is held against the scene's tolerance. It is the change of samples where the scene is for samples; always so of effects on
    # samples, which set the floor that everything is detected against, and of `SHADES`. Else it is how far the effect moves the
    # strongest echoes, over their range: see `places`.
    decisive: float

    def __str__(self) -> str:
        """Say both where they differ."""
        moves = f" and moves the strongest echoes by {self.decisive:.2g} of their range" if self.decisive != self.samples else ""
        return f"it changes the samples by {self.samples:.2g}{moves}"


MakeSimulator = Callable[..., Any]
"""Makes `radar_sim.simulator.Simulator`, which uses probes itself, so it is not imported here: of a scene as one radar sees it, with the
world that another one made, where it is given."""


@dataclass(frozen=True, eq=False)
class Probe:
    """Some frames of a scene as one radar would see them, with any set of effects."""

    scene: Scene  # without ``effects: auto``
    make: MakeSimulator  # what simulates it: `radar_sim.Simulator`
    radar: str = ""  # which radar

    def simulator(self, effects: Effects, **more: Any) -> Any:
        """Simulate the scene with other effects."""
        return self.make(replace(self.scene, effects=effects, **more), self.radar, self._bare_simulator.world)

    def frames(self, effects: Effects, *, exact: bool = True) -> Cubes:
        """Simulate the probed frames [V], shape (frame, tx, chirp, rx, sample).

        Chirp by chirp, whatever the scene's fidelity; or not ``exact``: quickly, without what happens to echoes within a frame.
        """
        if exact:
            return self._take(self.simulator(effects, fidelity=Fidelity(model="exact")))
        still: dict[str, Any] = dict.fromkeys(PHYSICS, False)
        return self._take(self.simulator(replace(effects, **still), fidelity=Fidelity()))

    def _take(self, simulator: Any) -> Cubes:
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
    def _echoes(self) -> Cubes:
        return self.frames(self.bare())

    @cached_property
    def _quick_echoes(self) -> Cubes:
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
    def _bare_simulator(self) -> Any:
        """What has the world, with any effects, made once."""
        return self.make(replace(self.scene, effects=Effects()), self.radar)

    def _room(self) -> Effects:
        effects = self.bare()
        for name in ROOM:
            effects = switched(effects, name, True)
        return effects

    @cached_property
    def _whole(self) -> Cubes:
        return self.frames(self._room(), exact=False)

    def _change(self, name: str, with_it: Cubes, without: Cubes, echoes: Cubes) -> Change:
        changed, reference = (float(np.linalg.norm(x)) for x in (with_it - without, echoes))
        samples = changed / reference if reference > 0.0 else (math.inf if changed > 0.0 else 0.0)
        purpose = self.scene.purpose
        if purpose == "samples" or name in (*SIGNAL, *SHADES) or samples == 0.0:
            return Change(samples, samples)
        one, other = (places(x, self._bare_simulator.info, moving=purpose != "detections") for x in (with_it, without))
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


def places(cubes: Cubes, info: RadarInfo, *, moving: bool) -> NDArray[np.float64]:
    """Find the middle of the strongest echoes of each frame.

    Range-Doppler cells count by the square of their power, as a detector follows peaks: an echo 8 dB below another weighs 2.5 %, and what
    lies in side lobes nothing. The azimuth of a cell is that of the strongest beam of the first transmitter's receivers. Radars whose
    samples are no beats (CW, OFDM) have cells of speed only; theirs are places of direction at a distance of 1.

    Parameters
    ----------
    cubes : ndarray of complex128, shape (frame, tx, chirp, rx, sample)
        Samples without noise.
    info : RadarInfo
        Whose they are.
    moving : bool
        Leave out what stands still during a frame, as who follows people does.

    Returns
    -------
    ndarray of float64, shape (frame, 2)
        (x, y) in the sensor's plane [m]; NaN where nothing comes back.
    """
    return np.array([_place(cube, info, moving) for cube in cubes]).reshape(-1, 2)


def displacement(one: NDArray[np.float64], other: NDArray[np.float64]) -> float:
    """Rms distance between the places of two looks, over the rms range of the first; infinite where only one of them finds something.

    Parameters
    ----------
    one, other : ndarray of float64, shape (frame, 2)
        Of `places`.
    """
    seen = np.isfinite(one).all(-1)
    if (seen != np.isfinite(other).all(-1)).any():
        return math.inf
    return float(np.linalg.norm(one[seen] - other[seen]) / np.linalg.norm(one[seen])) if seen.any() else 0.0


def _place(cube: NDArray[np.complex128], info: RadarInfo, moving: bool) -> NDArray[np.float64]:
    w = info.waveform
    if moving:
        cube = cube - cube.mean(axis=1, keepdims=True)
    if w.modulation == "fmcw":
        spectrum = np.fft.fft2(cube * np.hanning(w.n_chirp)[:, None, None] * np.hanning(w.n_sample), axes=(1, 3))
        ranges = np.arange(w.n_sample) * w.range_resolution
    else:
        spectrum, ranges = np.fft.fft(cube * np.hanning(w.n_chirp)[:, None, None], axis=1), np.ones(cube.shape[-1])
    power = (np.abs(spectrum) ** 2).sum(axis=(0, 2))
    if not power.max() > 0.0:
        return np.full(2, np.nan)
    strongest = np.argsort(power, axis=None, kind="stable")[-_CELLS:]
    doppler, column = np.unravel_index(strongest, power.shape)
    weight = (power[doppler, column] / power.max()) ** 2
    lateral = np.array([y for y, _ in info.array.rx]) * (2 * math.pi * w.carrier / SPEED_OF_LIGHT)
    beams = np.abs(spectrum[0, doppler, :, column] @ np.exp(1j * lateral[:, None] * _DIRECTIONS))
    sine = _DIRECTIONS[first_max(beams, 1)]  # of two that are equally strong, the same on every machine
    span = ranges[column]
    across = np.stack([span * np.sqrt(1.0 - sine**2), span * sine], axis=-1)
    return np.asarray(np.average(across, axis=0, weights=weight))
