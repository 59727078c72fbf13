"""Stone Soup on real recordings: the knobs that a search found on the recordings to develop on."""

from __future__ import annotations

from typing import Final

from benchmarks.people_sources import MakeTracker
from benchmarks.stone_soup import StoneSoupConfig, StoneSoupTracker

TUNED: Final = StoneSoupConfig(confirm_updates=3, eps=1.0, process_noise=0.1, position_std=0.3)


def peer(config: StoneSoupConfig) -> MakeTracker:
    """Make Stone Soup's tracker with a configuration."""
    return lambda info: StoneSoupTracker(config)
