"""How the house stands: lines per room, lengths of modules and functions, import circles, what live nodes import, how fast they start."""

from __future__ import annotations

import ast
import functools
import json
import subprocess
import sys
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from radar_app.graph import NODES, VARIANTS

ROOT = Path(__file__).resolve().parent.parent
ORDER = (
    "radar_core",
    "radar_sim",
    "radar_driver",
    "radar_dsp",
    "radar_tracking",
    "radar_gestures",
    "radar_lab",
    "radar_ros",
    "radar_app",
    "benchmarks",
)
"""The rooms, in the order data flows: each may import itself and those before it."""

_SOURCES = ("radar_sim", "radar_driver")
"""Simulator and boards: the live graph imports of them what its source needs, so they are not counted."""

LONGEST_MODULE = 400  # lines; a longer module is two rooms in one

_START = """
import importlib, json, sys, time
begin = time.perf_counter()
import rclpy
bare = time.perf_counter()
rclpy.init(args=[])
node = importlib.import_module(sys.argv[1]).make_node() if sys.argv[1] else rclpy.create_node("bare")
ready = time.perf_counter()
held = {name: getattr(module, "__file__", None) for name, module in sys.modules.items() if name.startswith("radar_")}
node.destroy_node()
rclpy.try_shutdown()
print(json.dumps({"modules": held, "seconds": ready - begin}))
"""


def modules(root: Path = ROOT) -> dict[str, Path]:
    """Find every module of the rooms: dotted name to file."""
    files = [path for room in ORDER for path in (root / room).rglob("*.py")]
    return {".".join(path.relative_to(root).with_suffix("").parts).removesuffix(".__init__"): path for path in files}


@functools.cache
def _read(path: Path) -> tuple[frozenset[str], tuple[tuple[str, int], ...]]:
    """Give what a file imports, see `imported`, and ``line name`` and lines of its functions; a file is parsed once."""
    names: set[str] = set()
    functions: list[tuple[str, int]] = []
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module and node.level == 0:
            names |= {node.module} | {f"{node.module}.{alias.name}" for alias in node.names}
        elif isinstance(node, (ast.FunctionDef, ast.AsyncFunctionDef)):
            functions.append((f"{node.lineno} {node.name}", (node.end_lineno or 0) - node.lineno + 1))
    return frozenset(names), tuple(functions)


def imported(path: Path) -> frozenset[str]:
    """Every name that a file imports, lazily or not: modules, and ``module.name`` of what is taken out of them."""
    return _read(path)[0]


def imports(files: Mapping[str, Path]) -> dict[str, set[str]]:
    """Which of the modules each module imports; a package whose module is taken counts only as that module."""
    found = {}
    for name, path in files.items():
        taken = {other for other in imported(path) if other in files and other != name}
        found[name] = {other for other in taken if not any(more.startswith(other + ".") for more in taken)}
    return found


def circles(graph: Mapping[str, set[str]]) -> list[list[str]]:
    """Find groups of modules that import each other, sorted; empty: there is none (Tarjan, 1972)."""
    index: dict[str, int] = {}
    low: dict[str, int] = {}
    stack: list[str] = []
    found: list[list[str]] = []

    def visit(name: str) -> None:
        index[name] = low[name] = len(index)
        stack.append(name)
        for other in sorted(graph.get(name, ())):
            if other not in index:
                visit(other)
                low[name] = min(low[name], low[other])
            elif other in stack:
                low[name] = min(low[name], index[other])
        if low[name] == index[name]:
            group = stack[stack.index(name) :]
            del stack[stack.index(name) :]
            if len(group) > 1:
                found.append(sorted(group))

    for name in sorted(graph):
        if name not in index:
            visit(name)
    return sorted(found)


def function_lengths(files: Mapping[str, Path]) -> dict[str, int]:
    """Lines of every function and method, from ``def`` to its end, docstring included: ``module:line name`` to lines."""
    return {f"{name}:{place}": lines for name, path in files.items() for place, lines in _read(path)[1]}


def _lines(path: str | Path) -> int:
    return len(Path(path).read_text(encoding="utf-8").splitlines())


def _start(module: str) -> dict[str, Any]:
    """Start a node in a process of its own: the modules of ours that it then holds, and the seconds until it was made."""
    begin = time.perf_counter()
    made = subprocess.run([sys.executable, "-c", _START, module], capture_output=True, text=True, check=True, cwd=ROOT)
    told: dict[str, Any] = json.loads(made.stdout.splitlines()[-1])
    return told | {"process_seconds": time.perf_counter() - begin}


def _closure(repeat: int) -> dict[str, Any]:
    """Measure what the live graph imports, without simulator and boards, and how long each node takes to start."""
    held: dict[str, str] = {}
    bare = float(np.median([_start("")["seconds"] for _ in range(repeat)]))
    rows = []
    for name in VARIANTS["live"].nodes:
        starts = [_start(NODES[name].module) for _ in range(repeat)]
        files = {key: path for key, path in starts[0]["modules"].items() if path}
        held |= files
        seconds = float(np.median([start["seconds"] for start in starts]))
        rows.append({"node": name, "lines": sum(map(_lines, files.values())), "start_s": seconds, "start_over_bare": seconds / bare})
    rooms = {room: sum(_lines(path) for key, path in held.items() if key.split(".")[0] == room) for room in ORDER}
    return {
        "live_closure_lines": sum(lines for room, lines in rooms.items() if room not in _SOURCES),
        "live_closure_rooms": rooms,
        "nodes": rows,
        "bare_start_s": bare,
    }


def run(quick: bool = False) -> dict[str, Any]:
    """Measure the house."""
    files = modules()
    lines = {name: _lines(path) for name, path in files.items()}
    lengths = function_lengths(files)
    p50, p90, p99 = np.percentile(list(lengths.values()), [50, 90, 99])
    found = circles(imports(files))
    return {
        "lines": sum(lines.values()),
        "rooms": {room: sum(n for name, n in lines.items() if name.split(".")[0] == room) for room in ORDER},
        "modules": len(files),
        "modules_over_400": sum(n > LONGEST_MODULE for n in lines.values()),
        "longest_modules": dict(sorted(lines.items(), key=lambda item: -item[1])[:10]),
        "function_p50": float(p50),
        "function_p90": float(p90),
        "function_p99": float(p99),
        "longest_functions": dict(sorted(lengths.items(), key=lambda item: -item[1])[:20]),
        "import_circles": len(found),
        "circles": found,
        **_closure(1 if quick else 5),
    }
