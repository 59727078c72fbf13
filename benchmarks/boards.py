"""Boards: frames lost, time from a frame's being ready to its being in hand, recovery, processor time; over emulated boards.

The TinyRad is emulated below the real libusb with umockdev (apt-get install umockdev gir1.2-umockdev-1.0 python3-gi): pyusb, libusb and the
system calls are real, the kernel's part and the cable are not. The emulator runs in a process of its own on the same cores.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np
import scipy.signal

from benchmarks import boards_udp
from benchmarks.boards_udp import emulated, watched
from benchmarks.graph import DOMAIN
from benchmarks.report import AbsentError, choices, measure_together
from radar_app.graph import graph
from radar_driver.tinyrad import wire
from radar_driver.tinyrad.config import TinyRadConfig
from radar_driver.tinyrad.convert import analytic
from radar_dsp.windows import make_window

_FRAMES = 250
_TRANSFERS = {"whole frame": 0, "32 KiB": 32768, "16 KiB": 16384, "4 KiB": 4096}
_WITHOUT = ("baseband", "tracking", "gestures", "hand", "visualisation")


def run(quick: bool) -> dict[str, Any]:
    """Measure the TinyRad over USB, and the boards over UDP; raise AbsentError outside a checkout, or without what emulates USB."""
    if missing := emulated("umockdev_machine").missing():
        raise AbsentError(missing)
    count = 40 if quick else _FRAMES
    runs = {name: _usb(count, transfer=size) for name, size in list(_TRANSFERS.items())[: 2 if quick else None]}
    usb = runs["whole frame"]
    figures: dict[str, Any] = {
        "usb_frames": count,
        "usb_lost": usb["lost"],
        "usb_median_ms": float(np.median(usb["delivery_ms"])),
        "usb_p99_ms": float(np.percentile(usb["delivery_ms"], 99)),
        "usb_max_ms": float(np.max(usb["delivery_ms"])),
        "usb_resume_replug_s": _replug(),
        **({} if quick else _kill(5)),  # a node has to live for a while before its death says anything
        "cpu": {"usb": usb["cpu"]},
        "load": os.getloadavg()[0],
    }
    lost = {name: one["lost"] for name, one in runs.items()}
    rows = choices("usb transfer", ("lost", "frames"), lost, {name: one["delivery_ms"] for name, one in runs.items()}, "whole frame")
    rows += _conversions(repeat=5 if quick else 300)
    other = boards_udp.figures(quick)
    return {**figures, **other, "choices": rows + other["choices"]}


@contextmanager
def _machine() -> Iterator[Any]:
    machine = emulated("umockdev_machine").Machine()
    try:
        yield machine
    finally:
        machine.close()


@contextmanager
def _child(machine: Any, count: int, **knobs: Any) -> Iterator[Iterator[dict[str, Any]]]:
    """Run a program that reads the board; gives what it says."""
    line = [sys.executable, emulated("tinyrad_child").__file__, str(count), json.dumps(knobs)]
    process = subprocess.Popen(line, env=machine.environment, stdout=subprocess.PIPE, text=True)
    assert process.stdout is not None
    try:
        yield map(json.loads, process.stdout)
    finally:
        process.kill()
        process.communicate()


def _usb(count: int, **knobs: Any) -> dict[str, Any]:
    """Read so many frames: delivery times [ms], frames lost on the way or replaced unseen, processor time of the reading program."""
    with _machine() as machine, _child(machine, count, **knobs) as heard:
        lines = list(heard)
        ready = machine.say("report")["ready_ns"]
    frames, end = [line for line in lines if "sequence" in line], lines[-1]
    interval = round(TinyRadConfig().frame_interval * 1e9)
    delivery = [(frame["arrived"] - ready[0] - frame["sequence"] * interval) * 1e-6 for frame in frames]
    return {"delivery_ms": delivery, "lost": end["report"]["lost_frames"] + end["replaced"], "cpu": end["cpu"]}


def _next(heard: Iterator[dict[str, Any]], key: str) -> dict[str, Any]:
    return next(line for line in heard if line.get(key))


def _replug() -> float:
    """Unplug the board and plug it in again: seconds until the next frame."""
    with _machine() as machine, _child(machine, 1 << 30) as heard:
        _next(heard, "stamp")
        machine.say("unplug")
        _next(heard, "problem")
        time.sleep(1.0)
        machine.say("plug")
        plugged = time.monotonic_ns()
        return (_next(heard, "stamp")["arrived"] - plugged) * 1e-9


def _kill(attempts: int) -> dict[str, float]:
    """Kill the driver node under the supervisor; seconds until the board has its next frame ready, and until a subscriber has one."""
    with _machine() as machine:
        os.environ.update(machine.changes)
        specs = graph("live", parameters={"driver": {"source": "tinyrad"}}, without=_WITHOUT)
        times = []
        try:
            with watched(specs, DOMAIN) as driver:
                for _ in range(attempts):
                    driver.wait(600)  # 12 s: a node that lived that long is started again at once
                    killed, seen = driver.kill()
                    report = machine.say("report")
                    began = next(t for t in report["began_ns"] if t * 1e-9 > killed)
                    times.append((next(t for t in report["ready_ns"] if t > began) * 1e-9 - killed, seen - killed))
        finally:
            for name in machine.changes:
                os.environ.pop(name, None)
    median, worst = np.median(times, axis=0), np.max(times, axis=0)
    return {
        "usb_resume_kill_s": float(median[0]),
        "usb_resume_kill_worst_s": float(worst[0]),
        "usb_resume_kill_seen_s": float(median[1]),
        "usb_resume_kill_seen_worst_s": float(worst[1]),
    }


def _conversions(repeat: int) -> list[dict[str, Any]]:
    """Real samples to complex ones: the largest ghost of a beat between two cells, behind a Nuttall window, and the time of a frame."""
    config = TinyRadConfig()
    n_real = config.samples - config.skip
    samples = np.random.default_rng(0).normal(0.0, 100 * wire.VOLTS, (128, wire.N_RX, n_real)).astype(np.float32)
    calls: dict[str, Any] = {
        "half rate, tapered (the driver's)": analytic,
        "half rate, not tapered": lambda x: _plain(x),
        "full rate, not tapered (scipy.signal.hilbert)": lambda x: scipy.signal.hilbert(x, axis=-1).astype(np.complex64),
        "none: real samples as they are": lambda x: x.astype(np.complex64),
    }
    times = measure_together({name: (lambda call=call: call(samples)) for name, call in calls.items()}, repeat=repeat)
    ghosts = {name: _ghost(call, n_real) for name, call in calls.items()}
    figure = ("largest ghost below 27 of 32 cells", "dB")
    return choices("real to complex", figure, ghosts, times, "none: real samples as they are")


def _plain(samples: np.ndarray) -> np.ndarray:
    n = (samples.shape[-1] + 1) // 2
    spectrum = np.fft.rfft(samples, axis=-1)[..., :n]
    spectrum[..., 1:] *= 2
    return (np.fft.ifft(spectrum, axis=-1) * (n / samples.shape[-1])).astype(np.complex64)


def _ghost(call: Any, n_real: int) -> float:
    """Largest deviation of a spectrum from that of an ideal complex echo, relative to its peak [dB]; echoes in cells 4 to 27."""
    worst = 0.0
    for turns in np.arange(4.0, 27.0, 0.37):
        got = call(np.cos(2 * np.pi * turns * np.arange(n_real) / n_real + turns).astype(np.float32))
        n = len(got)
        window = make_window("nuttall", n)
        ideal = np.fft.fft(window * np.exp(1j * (2 * np.pi * turns * np.arange(n) / n + turns)))
        error = np.abs(np.fft.fft(window * got) - ideal)
        worst = max(worst, float(error.max() / np.abs(ideal).max()))
    return 20 * np.log10(worst)
