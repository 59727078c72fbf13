"""The running graph over real DDS: latency from frame to tracks, lost frames, processor time; beside the library without a graph."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any, Final

import numpy as np

from benchmarks import graph_load
from benchmarks.graph_runs import Load, composed, separate
from benchmarks.report import Found, Panel, of_share, timed
from benchmarks.tradeoff.stages import StudyConfig
from radar_app.graph import NodeSpec, graph
from radar_app.supervisor import environment, refuse_busy_domain
from radar_core import HandwaveError
from radar_lab.pipeline import Pipeline
from radar_sim import Simulator, load_scene

DOMAIN: Final = 150 + os.getpid() % 80  # a ROS domain of its own: stale readers of another run distort measurements
PANEL = Panel("processes", "frames that gave tracks", "", "higher", "each node a process", "the library on the same frames, no graph")
SEPARATE, COMPOSED = "each node a process", "all nodes in one process"
_SCENE: Final = "demo"
_SECONDS: Final = (6.0, 25.0)


def nodes(scene: str) -> tuple[NodeSpec, ...]:
    """List the nodes that are measured: the live graph without pictures, its scene again and again."""
    return graph("live", parameters={"driver": {"scene": scene, "at_end": "loop"}}, without=("visualisation",))


def library(study: StudyConfig) -> list[float]:
    """Time the library on frames of a scene, one after the other [ms]."""
    simulator = Simulator(load_scene(study.scene or _SCENE))
    pipeline, n = Pipeline(simulator.info), min(simulator.n_frames, study.pick(250, 1000))
    return [timed(pipeline.process, simulator.process(k).frame)[1] for k in range(n)]


def compare(study: StudyConfig) -> tuple[Found, dict[str, Load]]:
    """Measure no graph, processes, and one process; the graphs run at the scene's frame rate. Also what was heard of each graph."""
    scene, found, reference = study.scene or _SCENE, Found(), library(study)
    found.rows.append(PANEL.row("library, no graph", 1.0, reference, reference, margin=of_share(1.0, len(reference))))
    os.environ.update(environment(study.domain))
    refuse_busy_domain([spec.label for spec in nodes(scene)], "", study.domain)
    graphs = {}
    for name, run_graph in ((SEPARATE, separate), (COMPOSED, composed)):
        try:
            heard = graphs[name] = run_graph(nodes(scene), study.pick(*_SECONDS), study.domain)
        except HandwaveError as error:
            found.leave_out(PANEL.name, name, str(error))
            continue
        margin = of_share(1.0 - heard.dropped, max(heard.due, 1))
        found.rows.append(PANEL.row(name, 1.0 - heard.dropped, heard.latencies_ms, reference, margin=margin))
    return found, graphs


def measure(study: StudyConfig) -> Found:
    """Compare processes, one process, and no graph at all."""
    return compare(study)[0]


def run(quick: bool) -> dict[str, Any]:
    """Measure on the demo scene at 50 Hz."""
    study = StudyConfig(Path(), quick, domain=DOMAIN)
    found, graphs = compare(study)
    if found.left_out:
        raise HandwaveError("; ".join(one["why"] for one in found.left_out))
    result: dict[str, Any] = {"frame_rate_hz": 50, "seconds": study.pick(*_SECONDS)}
    for prefix, heard in (("", graphs[SEPARATE]), ("composed_", graphs[COMPOSED])):
        result |= {
            f"{prefix}latency_ms_median": float(np.median(heard.latencies_ms)),
            f"{prefix}latency_ms_p99": float(np.percentile(heard.latencies_ms, 99)),
            f"{prefix}dropped_fraction": heard.dropped,
            f"{prefix}frames": heard.due,
            f"{prefix}cpu_percent": {name: round(100 * used / heard.seconds, 1) for name, used in heard.cpu.items()},
        }
    return {**result, **graph_load.measure(quick, DOMAIN), "choices": found.rows}
