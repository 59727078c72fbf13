"""`handwave compile`: the loops that the usual graph needs, compiled once and kept on disk; and what nodes say of it."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import TYPE_CHECKING, TypeVar

if TYPE_CHECKING:
    from rich.console import Console

T = TypeVar("T")

_FRAMES = (*range(4), *range(200, 380))  # of the demo scene: first nobody is seen, then two are followed while one pushes
_HAND = 370  # from this frame on a hand is followed


def compile_loops() -> None:
    """Compile the loops that `handwave demo` needs, so that its first frame comes within seconds.

    Takes a minute or two, and a few seconds when it was done before. What is compiled is kept beside the code, or in the folder that
    NUMBA_CACHE_DIR names.
    """
    from rich.console import Console

    from radar_lab.pipeline import Pipeline
    from radar_sim import Simulator, load_scene

    console = Console(stderr=True)
    started = time.monotonic()

    def simulate() -> Simulator:
        simulator = Simulator(load_scene("demo"))
        for k in _FRAMES[::20]:
            simulator.process(k)
        return simulator

    def follow() -> None:
        for k in _FRAMES:
            found = pipeline.process(simulator.process(k).frame)
            if k == _HAND:
                pipeline.hand.start(None, found.cloud.stamp_ns)

    simulator = _step(console, "the simulated radar", simulate)
    pipeline = _step(console, "the detector", lambda: Pipeline(simulator.info))
    _step(console, "tracking, gestures and hand", follow)
    console.print(f"compiled: all loops of the usual graph, in {time.monotonic() - started:.0f} s", highlight=False)


def told(line: str) -> str:
    """Take out of a line of a node's log what it says about compiling; empty: nothing."""
    found = line.partition("]: ")[2]
    return found if found.startswith(("compiling ", "compiled ")) else ""


def _step(console: Console, what: str, work: Callable[[], T]) -> T:
    """Do a part of it, and say how long it took."""
    started = time.monotonic()
    with console.status(f"compiling {what}"):
        found = work()
    console.print(f"  {what}: {time.monotonic() - started:.0f} s", highlight=False)
    return found
