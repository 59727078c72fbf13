"""All nodes of a graph in one process: `handwave up --composed` starts it and watches it as it watches nodes."""

from __future__ import annotations

import importlib
import json
import os
import sys
from collections.abc import Callable, Sequence
from dataclasses import asdict
from functools import partial
from typing import Any

from radar_app.graph import NodeSpec, arguments

_PULSE = 0.2  # s: how often it is looked what happens


def composed_spec(specs: Sequence[NodeSpec]) -> NodeSpec:
    """Describe the process that runs these nodes."""
    return NodeSpec("graph", "radar_app.composed", words=(json.dumps([asdict(spec) for spec in specs]),))


def run_composed(specs: Sequence[NodeSpec], tell: Callable[[str], None] | None = None) -> int:
    """Run all nodes in this process, on one executor, until interrupted; returns the exit status. ``tell`` is told what happens."""
    from radar_ros.stage import run

    def make(spec: NodeSpec) -> Any:
        return importlib.import_module(spec.module).make_node(cli_args=arguments(spec), use_global_arguments=False)

    # Drivers last: their frames begin to come at once, and loops may have to be compiled for whoever reads them.
    makers: list[Callable[[], Any]] = [partial(make, spec) for spec in sorted(specs, key=lambda spec: spec.name == "driver")]
    if tell is not None:
        makers.append(partial(_teller_node, [spec.path for spec in specs], tell))
    return run(*makers)


def _teller_node(names: Sequence[str], tell: Callable[[str], None]) -> Any:
    """Make a node that tells what happens in the graph beside it."""
    import rclpy

    from radar_app.watching.listener import Ears
    from radar_app.watching.teller import Teller

    node: Any = rclpy.create_node(f"handwave_up_{os.getpid()}", start_parameter_services=False)
    node.close = lambda: None
    node.create_timer(_PULSE, Teller(Ears(node), names, tell).look)
    return node


def main() -> int:
    """Run the nodes that the command line describes."""
    specs = [NodeSpec(**description) for description in json.loads(sys.argv[1])]
    del sys.argv[1:]
    return run_composed(specs, partial(print, flush=True))


if __name__ == "__main__":
    raise SystemExit(main())
