"""The default library chain on a small computer (thesis, 4.5.4): operations, memory and time of each stage, free and slowed.

One process on one core takes the raw frames of a scene one behind the other, first with all of the core and then with a share of it: a
cgroup's quota, or SIGSTOP and SIGCONT by turns where no cgroup can be made (`benchmarks.slowed`). A turn is longer than most stages take,
so that medians of single stages do not see it: compare the means. Frames with an event are told apart, as in the thesis; everything that is
compiled with its first call was called before. The classifier's times are of frames with an event, the hand's of frames with a hand.
"""

from __future__ import annotations

import contextlib
import dataclasses
import json
import os
import platform
import subprocess
import sys
import time
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np
import psutil
from numpy.typing import NDArray

from benchmarks.chain_counts import STAGES
from benchmarks.slowed import PERIOD, Slowing, pin, precede, slowed
from radar_core import HandwaveError
from radar_sim import load_scene

TIMES: Final = 3.0
"""How much less of its core the slowed process has."""
SCENE: Final = "demo"
SEED: Final = 1  # of the figure; it was developed on 11 and 12
QUICK: Final = "short"
_THESIS: Final = {"i7-8650U": {"no_event": 10.1, "event": 40.3}, "Raspberry Pi 4": {"no_event": 31.5, "event": 67.4}}
_BOARD: Final = Path("/proc/device-tree/model")  # of computers that have one, as a Raspberry Pi


def machine() -> dict[str, Any]:
    """Describe this computer: board, processor and its speed."""
    lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines() if Path("/proc/cpuinfo").exists() else []
    told = {name.strip(): value.strip() for name, _, value in (line.partition(":") for line in lines)}
    frequency = psutil.cpu_freq()
    return {
        "board": _BOARD.read_text(encoding="utf-8").strip("\0\n ") if _BOARD.exists() else "",
        "processor": told.get("model name") or platform.processor() or platform.machine(),
        "mhz": float(told.get("cpu MHz", 0.0)) or (float(frequency.max or frequency.current) if frequency else None),
        "processors": psutil.cpu_count(),
        "load_average": list(os.getloadavg()),
        "made": time.strftime("%Y-%m-%d"),
    }


class Worker:
    """The process that is measured: one line in, one line out."""

    def __init__(self, process: subprocess.Popen[str]) -> None:
        self._process, self.pid = process, process.pid

    def read(self) -> dict[str, Any]:
        """Read what it says next; HandwaveError: it has ended."""
        assert self._process.stdout is not None
        line = self._process.stdout.readline()
        if not line:
            raise HandwaveError("the measured process has ended; what it says above tells why")
        found: dict[str, Any] = json.loads(line)
        return found

    def again(self) -> dict[str, Any]:
        """Let it process the scene once more."""
        assert self._process.stdin is not None
        self._process.stdin.write("\n")
        self._process.stdin.flush()
        return self.read()


@contextlib.contextmanager
def worker(scene: str, seed: int) -> Iterator[Worker]:
    """Run the process; it is gone afterwards."""
    command = [sys.executable, "-m", "benchmarks.chain_process", scene, str(seed)]
    process = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, start_new_session=True)
    try:
        yield Worker(process)
    finally:
        process.kill()
        process.communicate()


def spread(values: Sequence[float] | NDArray[np.float64]) -> dict[str, float | int | None]:
    """Tell number, median, 95th percentile and mean of times [ms]; None of none."""
    if not len(values):
        return {"n": 0, "median": None, "p95": None, "mean": None}
    median, late = np.percentile(values, (50, 95)).tolist()
    return {"n": len(values), "median": median, "p95": late, "mean": float(np.mean(values))}


def figures(found: dict[str, Any], interval_ms: float) -> dict[str, Any]:
    """Tell the times of stages and frames of one run; ``late``: share of frames that took longer than one may.

    ``share_used``: what the process had of its core, ``processor_ms``: what a frame took of that; ``bare_fft_ms``: a bare transform of a
    frame, to compare computers.
    """
    ms, event, hand = np.array(found["ms"]), np.array(found["event"]), np.array(found["hand"])
    rows = {"classifier": event, "hand": hand}
    every = np.ones(len(ms), np.bool_)
    whole = ms.sum(axis=1)
    return {
        "stages": {name: spread(ms[rows.get(name, every), k]) for k, name in enumerate(STAGES)},
        "no_event": spread(whole[~event]),
        "event": spread(whole[event]),
        "every": spread(whole),
        "late": float(np.mean(whole > interval_ms)),
        "bare_fft_ms": found["bare_fft_ms"],
        "share_used": found["share_used"],
        "processor_ms": float(whole.mean()) * found["share_used"],
    }


def stage_shares(flop: Mapping[str, float], stages: Mapping[str, Any], n_frames: int) -> dict[str, dict[str, float]]:
    """Tell the shares of all operations and of all time that each stage has, over the frames that it works on."""
    used = {name: (flop[name] * stages[name]["n"], (stages[name]["mean"] or 0.0) * stages[name]["n"]) for name in STAGES}
    operations, time_ms = (sum(parts) for parts in zip(*used.values(), strict=True))
    return {
        name: {"flop_share": one / operations, "time_share": other / time_ms, "worked": stages[name]["n"] / n_frames}
        for name, (one, other) in used.items()
    }


def row(about: dict[str, Any], free: dict[str, Any]) -> str:
    """Write the row of a computer for the table in docs/research/real-time.md."""
    names = [about["board"] or about["processor"], "" if about["mhz"] is None else f"{about['mhz']:.0f} MHz"]
    cells = [", ".join(filter(None, names))]
    for kind in ("no_event", "event"):
        values = free[kind]
        cells.append("" if values["median"] is None else f"{values['median']:.1f} ms, p95 {values['p95']:.1f} ms")
    return "| " + " | ".join(cells) + " |"


def measure(scene: str, seed: int) -> dict[str, Any]:
    """Measure one scene on this computer."""
    about, interval_ms = machine(), 1e3 * load_scene(scene).radars[0].waveform.frame_interval
    core = max(psutil.Process().cpu_affinity())
    slowing: Slowing
    with worker(scene, seed) as process:
        told = process.read()
        precede(process.pid)
        pin(process.pid, core)
        free = figures(process.again(), interval_ms)
        with slowed(process.pid, TIMES, core) as slowing:
            slow = figures(process.again(), interval_ms)
    shares = stage_shares(told["flop"], free["stages"], told["n_frames"])
    stages = {
        name: {kind: told[kind][name] for kind in ("flop", "peak_bytes", "resident_bytes")}
        | {"free": free["stages"][name], "slowed": slow["stages"][name], **shares[name]}
        for name in STAGES
    }
    return {
        "scene": scene, "seed": seed, "interval_ms": interval_ms, "machine": about,
        "slowed": {"times": TIMES, "period_s": PERIOD, **dataclasses.asdict(slowing)},
        **{name: told[name] for name in ("n_frames", "points", "load", "process_bytes")},
        "flop_features_of_an_event": told["flop"]["features_of_an_event"],
        "stages": stages,
        "free": {name: value for name, value in free.items() if name != "stages"},
        "slow": {name: value for name, value in slow.items() if name != "stages"},
        "slower": slow["every"]["mean"] / free["every"]["mean"],
        "thesis_ms": _THESIS,
        "row": row(about, free),
    }  # fmt: skip


def run(quick: bool) -> dict[str, Any]:
    """Measure the chain on the demo; quick: on six seconds with two gestures.

    Returns ``stages`` (by name: ``flop``, bytes, shares; times ``free`` and ``slowed`` [ms]), ``free`` and ``slow`` (whole frames with and
    without an event [ms], share that is late), ``load`` (what frames hold), ``slower`` (mean time of a frame, slowed over free),
    ``row`` (of this computer, for the table in docs/research/real-time.md).
    """
    return measure(QUICK if quick else SCENE, 7 if quick else SEED)
