"""`handwave compile`: the loops that the usual graph needs, compiled once and kept on disk."""

from __future__ import annotations

_FRAMES = (*range(4), *range(200, 380))  # of the demo scene: first nobody is seen, then two are followed while one pushes
_HAND = 370  # from this frame on a hand is followed


def compile_loops() -> None:
    """Compile the loops that `handwave demo` needs, so that its first frame comes within seconds.

    Takes a minute, and a few seconds when it was done before. What is compiled is kept beside the code, or in the folder that
    NUMBA_CACHE_DIR names.
    """
    from rich.console import Console
    from rich.progress import track

    from radar_lab.pipeline import Pipeline
    from radar_sim import Simulator, load_scene

    simulator = Simulator(load_scene("demo"))
    console = Console(stderr=True)
    with console.status("compiling the detector"):
        pipeline = Pipeline(simulator.info)
    for k in track(_FRAMES, "compiling simulator, tracking, gestures and hand", console=console, transient=True):
        found = pipeline.process(simulator.process(k).frame)
        if k == _HAND:
            pipeline.hand.start(None, found.cloud.stamp_ns)
    console.print("compiled: all loops of the usual graph", highlight=False)
