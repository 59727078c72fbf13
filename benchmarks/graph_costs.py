"""Where the processor time of the demo graph goes, node by node, and what the same work takes without a graph.

Every node of the demo runs in a process of its own with its time taken apart (`benchmarks.costs_node`), at 50 Hz. Beside: the library
alone, in one thread on the same frames, before and after; and one hop between two bare nodes, of a frame and of a small message: the most
that a way for frames without copies could save.
"""

from __future__ import annotations

import importlib
import json
import os
import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np

from benchmarks.costs_node import LIBRARY, PARTS, Costs
from benchmarks.graph_load import SCENE, demo_nodes, hop
from benchmarks.graph_runs import separate
from radar_app.composed import composed_spec
from radar_app.graph import NodeSpec, arguments
from radar_app.supervisor import environment
from radar_core import HandwaveError
from radar_lab.pipeline import Pipeline
from radar_sim import Simulator, load_scene

DOMAIN: Final = 150 + (os.getpid() + 20) % 80
_SECONDS: Final = (5.0, 30.0)
_FRAMES: Final = (100, None)  # of the scene; None: all, as the graph's window has them
_WARM: Final = 20  # frames
_SMALL: Final = 64  # bytes


def counted(spec: NodeSpec, folder: Path) -> NodeSpec:
    """Describe the same node with its time taken apart."""
    words = (spec.module, str(folder / f"{spec.name}.jsonl"), *arguments(spec))
    return NodeSpec(spec.name, "benchmarks.costs_node", namespace=spec.namespace, place=spec.place, words=words)


def _through(simulator: Simulator, n_frames: int) -> None:
    pipeline = Pipeline(simulator.info)
    for k in range(n_frames):
        pipeline.process(simulator.process(k).frame)


def offline(n_frames: int | None) -> dict[str, float]:
    """Give what the library takes for a frame, one frame behind the other, by stage [ms]; None: for all frames of the scene."""
    spent: dict[str, Costs] = {}
    kept = []
    for name, (where, kind, method) in LIBRARY.items():
        owner, costs = getattr(importlib.import_module(where), kind), Costs()
        kept.append((owner, method, getattr(owner, method)))
        setattr(owner, method, costs.wrap("own work", getattr(owner, method)))
        spent[name] = costs
    try:
        simulator = Simulator(load_scene(SCENE))
        n_frames = n_frames or simulator.n_frames
        _through(simulator, _WARM)  # what is compiled or planned at first is not measured
        for costs in spent.values():
            costs.spent.clear()
        _through(simulator, n_frames)
    finally:
        for owner, method, function in kept:
            setattr(owner, method, function)
    return {name: costs.spent["own work"] / n_frames * 1e-6 for name, costs in spent.items()}


def of_window(path: Path, seconds: float) -> dict[str, float]:
    """Read what a node took within the last so many seconds, by part, in processors."""
    lines = [json.loads(line) for line in path.read_text(encoding="utf-8").splitlines()]
    last = lines[-1]
    first = next(line for line in lines if line["at"] >= last["at"] - seconds - 0.5)
    if last["at"] - first["at"] < 0.5 * seconds:
        raise HandwaveError(f"{path.stem} reported for {last['at'] - first['at']:.1f} s of {seconds:g} s only: is this machine too busy?")
    return {part: (last[part] - first[part]) / (last["at"] - first["at"]) for part in PARTS}


def shares(alone: Sequence[Mapping[str, float]], processes: Sequence[Mapping[str, float]], interval_ms: float) -> dict[str, Any]:
    """Put what ``processes`` took together, by part [processors], over the library ``alone``, by stage [ms].

    ``least_over_library``: the stages as they are in the graph, and what it takes to publish and to take messages; nothing else.
    """
    usual = sum(sum(each.values()) for each in alone) / len(alone)
    parts = {part: sum(process[part] for process in processes) * interval_ms for part in PARTS}
    least = sum(parts[part] for part in ("own work", "publishing", "executor", "other threads"))
    return {
        "ms_per_frame_by_part": parts,
        "ms_per_frame_all": sum(parts.values()),
        "over_library": sum(parts.values()) / usual,
        "slower_in_graph": parts["own work"] / usual,
        "least_over_library": least / usual,
    }


def figures(alone: Sequence[Mapping[str, float]], nodes: Mapping[str, Mapping[str, float]], interval_ms: float) -> dict[str, Any]:
    """Put the library ``alone``, by stage [ms], beside what ``nodes`` took, each in a process, by part [processors]."""
    library = {name: sum(each[name] for each in alone) / len(alone) for name in LIBRARY}
    ways = (("driver", "conversion"), ("driver", "publishing"), ("baseband", "conversion"), ("baseband", "executor"))
    return {
        "ms_per_frame": {name: {part: cores * interval_ms for part, cores in node.items()} for name, node in nodes.items()},
        **shares(alone, list(nodes.values()), interval_ms),
        "library_ms": library,
        "library_ms_all": sum(library.values()),
        "frame_transport_share": sum(nodes[name][part] for name, part in ways) / sum(sum(node.values()) for node in nodes.values()),
    }


def run(quick: bool) -> dict[str, Any]:
    """Measure."""
    os.environ.update(environment(DOMAIN))
    interval_ms = 1e3 * load_scene(SCENE).radars[0].waveform.frame_interval
    seconds, n_frames = _SECONDS[not quick], _FRAMES[not quick]
    alone = [offline(n_frames)]
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as name:
        folder = Path(name)
        load = separate([counted(spec, folder) for spec in demo_nodes(folder)], seconds, DOMAIN)
        nodes = {path.stem: of_window(path, seconds) for path in sorted(folder.glob("*.jsonl"))}
        one = folder / "one"
        one.mkdir()
        separate([counted(composed_spec(demo_nodes(one)), one)], seconds, DOMAIN)
        together = of_window(one / "graph.jsonl", seconds)
    alone.append(offline(n_frames))
    hops = {name: float(np.median(hop(min(seconds, 10.0), DOMAIN, size))) for name, size in (("frame", None), ("small", _SMALL))}
    return {
        "frames": load.due,
        "dropped_fraction": load.dropped,
        "latency_ms_median": float(np.median(load.latencies_ms)),
        **{f"hop_ms_{name}": value for name, value in hops.items()},
        **figures(alone, nodes, interval_ms),
        **{f"composed_{name}": value for name, value in shares(alone, [together], interval_ms).items()},
    }
