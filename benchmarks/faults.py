"""Faults of driver, transport, nodes, machine, files and peers, injected for real: what survives, what is named, what is lost.

Each row of the table (`benchmarks.faults_files` and its neighbours) says by what means its fault is injected, and the words that have to
name it. Nodes are real ones over real DDS, files real files; limits of the kernel and signals stand for what a machine cannot be made to
do. With ``--keep FOLDER`` groups that are done are not done again.
"""

from __future__ import annotations

import json
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, Final

import numpy as np

from benchmarks import faults_boards, faults_files, faults_graph, faults_machine, faults_network, faults_nodes, faults_peers
from benchmarks.faults_rows import Fault, Seen, told
from radar_core import ConfigError
from radar_core.files import write_whole


def _alone(faults: Callable[[], tuple[Fault, ...]], quick: bool) -> Iterator[tuple[Fault, Seen]]:
    """Inject faults that need nothing around them."""
    for fault in faults():
        if fault.quick or not quick:
            yield fault, fault.inject()


def spread(faults: tuple[Fault, ...]) -> tuple[Fault, ...]:
    """Put faults of the same words apart: a node says the same at most every five seconds."""
    words = [fault.words for fault in faults]
    place = {id(fault): (words[:k].count(fault.words) + 0.5) / words.count(fault.words) for k, fault in enumerate(faults)}
    return tuple(sorted(faults, key=lambda fault: place[id(fault)]))


def _shared(faults: tuple[Fault, ...], quick: bool) -> Iterator[tuple[Fault, Seen]]:
    """Inject faults into one graph."""
    chosen = tuple(fault for fault in faults if fault.quick or not quick)
    chosen = spread(chosen)
    if chosen:
        with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as folder:
            yield from faults_graph.measured(chosen, Path(folder))


GROUPS: Final[dict[str, Callable[[bool], Iterator[tuple[Fault, Seen]]]]] = {
    "files": lambda quick: _alone(lambda: faults_files.FAULTS, quick),
    "driver": lambda quick: _alone(lambda: (*faults_boards.faults(), *faults_network.drivers()), quick),
    "peers": lambda quick: _shared(faults_peers.FAULTS, quick),
    "nodes": lambda quick: _shared(faults_nodes.NODES, quick),
    "transport": lambda quick: _shared(faults_nodes.TRANSPORT, quick),
    "machine": lambda quick: _alone(lambda: (*faults_machine.faults(), *faults_network.machines()), quick),
}


def rows_of(group: str, quick: bool, keep: Path | None) -> list[dict[str, Any]]:
    """Inject the faults of a group, or read what an earlier run found."""
    file = keep / f"faults_{group}.json" if keep is not None and not quick else None
    if file is not None and file.exists():
        return list(json.loads(file.read_text(encoding="utf-8")))
    rows = [told(group, fault, seen) for fault, seen in GROUPS[group](quick)]
    if file is not None:
        file.parent.mkdir(parents=True, exist_ok=True)
        write_whole(file, json.dumps(rows))
    return rows


def figures(rows: list[dict[str, Any]]) -> dict[str, Any]:
    """Put together what was seen."""
    times = [row["recover_s"] for row in rows if row["survived"]]
    return {
        "faults": len(rows),
        "survived_fraction": sum(row["survived"] for row in rows) / max(len(rows), 1),
        "unnamed": sum(not row["named_once"] for row in rows),
        "lost_acknowledged": sum(row["lost_acknowledged"] for row in rows),
        "recover_s_median": float(np.median(times or [np.inf])),
        "recover_s_worst": max(times, default=np.inf),
        "not_survived": [f"{row['fault']}: {row['note']}" for row in rows if not row["survived"]],
        "not_named_once": [f"{row['fault']}: {row['named']} lines" for row in rows if not row["named_once"]],
        "rows": rows,
    }


def run(quick: bool, keep: Path | None = None, parts: str = "") -> dict[str, Any]:
    """Inject every fault, or those of the groups that ``parts`` names with commas; quick: a handful."""
    names = parts.split(",") if parts else list(GROUPS)
    if unknown := set(names) - GROUPS.keys():
        raise ConfigError(f"there is no group {', '.join(sorted(unknown))}; choose of {', '.join(GROUPS)}")
    return figures([row for name in names for row in rows_of(name, quick, keep)])
