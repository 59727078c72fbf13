"""Search the noise of a hand's estimator: in steps of two from a start to the best neighbour, until no neighbour is better."""

from __future__ import annotations

import functools
import itertools
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Final

from benchmarks.hand_runs import Tracked, counts, follow, residual, rms
from radar_core.config import load, nest
from radar_tracking import HandConfig

START: Final = {"process_noise": 4.0, "position_std": 0.02}  # [m^2/s^3], [m]
BETTER: Final = 0.005  # errors that differ by less than this share are alike
_MOST: Final = 40  # settings of one estimator that are tried at most


@dataclass(frozen=True)
class Searched:
    """The best setting of an estimator, and where it was looked for."""

    config: HandConfig
    error: float  # rms over the tuning scenes, a lost hand counts as a metre [m]
    tried: int  # settings
    inside: bool  # whether all eight neighbours were tried and none is better

    def knobs(self) -> dict[str, float]:
        """Give what was found, by name."""
        return {"process_noise": self.config.estimator.process_noise, "position_std": self.config.position_std}


def configured(name: str, process_noise: float, position_std: float) -> HandConfig:
    """Configure another estimator."""
    knobs = {"estimator.name": name, "estimator.process_noise": process_noise, "position_std": position_std}
    return load(HandConfig, nest(knobs))


def tune(tracked: Sequence[Tracked], name: str, most: int = _MOST) -> Searched:
    """Search both noises of one estimator for the smallest error (rms, a lost hand counts as a metre) on the tuning scenes."""
    return search(lambda config: rms(residual(one, follow(one, config))[counts(one)] for one in tracked), name, most)


def search(error: Callable[[HandConfig], float], name: str, most: int = _MOST) -> Searched:
    """Go to the best of eight neighbours, twice or half of each noise, while that is better by `BETTER`; at most so many settings."""
    base = tuple(START.values())

    @functools.cache
    def at(steps: tuple[int, int]) -> float:
        return error(_setting(name, base, steps))

    best, inside = (0, 0), False
    while not inside and at.cache_info().misses + len(_AROUND) <= max(most, 1 + len(_AROUND)):
        near = [(best[0] + a, best[1] + b) for a, b in _AROUND]
        other = min(near, key=at)
        inside = at(other) >= (1.0 - BETTER) * at(best)
        best = best if inside else other
    return Searched(_setting(name, base, best), at(best), at.cache_info().misses, inside)


_AROUND: Final = tuple(step for step in itertools.product((-1, 0, 1), repeat=2) if step != (0, 0))


def _setting(name: str, base: tuple[float, ...], steps: tuple[int, int]) -> HandConfig:
    return configured(name, base[0] * 2.0 ** steps[0], base[1] * 2.0 ** steps[1])
