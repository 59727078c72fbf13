"""Stone Soup on real recordings: what is tried for it, and the knobs that were chosen."""

from __future__ import annotations

from typing import Any, Final

import numpy as np

from benchmarks.people_sources import MakeTracker
from benchmarks.stone_soup import StoneSoupConfig, StoneSoupTracker
from radar_core.config import load, plain

TUNED: Final = StoneSoupConfig(
    eps=0.628, min_points=2, min_speed=0.1, process_noise=0.04, position_std=0.219, initial_speed_std=1.51, gate=5.19, confirm_updates=11,
    tentative_after=0.182, delete_after=6.19,
)  # fmt: skip
"""Best of 30 draws and those by hand on the recordings to develop on, then of 16 draws about the best, and of the best four on those to
choose on, by `benchmarks.people_real.search`."""
BY_HAND: Final = {
    "hand, crossing": StoneSoupConfig(confirm_updates=9, min_points=5),
    "hand, mars": StoneSoupConfig(confirm_updates=3, eps=1.0, process_noise=0.1, position_std=0.3),
}
"""Those of `python -m benchmarks recordings`."""
RANGES: Final = {
    "eps": (0.3, 1.5), "process_noise": (0.03, 3.0), "position_std": (0.05, 0.5), "initial_speed_std": (0.3, 2.0), "gate": (2.0, 10.0),
    "tentative_after": (0.1, 1.0), "delete_after": (0.5, 10.0), "confirm_updates": (3, 40), "min_points": (1, 6),
}  # fmt: skip
"""Knobs that are drawn, evenly in their logarithms; whole numbers are rounded. Slow points are left out in half of the draws."""
_WHOLE: Final = ("confirm_updates", "min_points")


def peer(config: StoneSoupConfig) -> MakeTracker:
    """Make Stone Soup's tracker with a configuration."""
    return lambda info: StoneSoupTracker(config)


def candidates(n: int = 30, seed: int = 1, near: StoneSoupConfig | None = None) -> dict[str, tuple[MakeTracker, Any]]:
    """Draw configurations, those chosen by hand before them; ``near``: draw about this one, within a quarter of the ranges."""
    rng = np.random.default_rng(seed)
    made = dict(BY_HAND) if near is None else {"near": near}
    for k in range(n):
        knobs: dict[str, Any] = {}
        for name, (low, high) in RANGES.items():
            place = rng.uniform()
            if near is not None:
                place = np.clip(np.log(getattr(near, name) / low) / np.log(high / low) + (place - 0.5) / 4, 0, 1)
            value = low * (high / low) ** place
            knobs[name] = round(value) if name in _WHOLE else float(f"{value:.3g}")
        knobs["min_speed"] = float(rng.choice([0.0, 0.1])) if near is None else near.min_speed
        made[f"{'drawn' if near is None else 'near'} {seed}-{k}"] = load(StoneSoupConfig, knobs)
    return {name: (peer(config), plain(config)) for name, config in made.items()}
