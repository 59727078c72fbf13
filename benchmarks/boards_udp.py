"""The DCA1000's receiver against an emulated board in a process of its own, over real UDP on loopback: `boards` merges this."""

from __future__ import annotations

import contextlib
import dataclasses
import importlib
import json
import math
import os
import signal
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import rclpy
from handwave.msg import RadarFrame as RadarFrameMsg

from benchmarks.graph import DOMAIN
from benchmarks.report import checkout, choices
from radar_app.graph import NodeSpec
from radar_app.supervisor import Supervisor, environment
from radar_core import HandwaveError
from radar_driver.dca1000.board import Dca1000Config, Dca1000Source
from radar_driver.dca1000.decode import decode_frame, frame_bytes
from radar_driver.dca1000.receiver import Receiver
from radar_driver.live import Reader
from radar_ros import qos
from radar_ros.interrupts import ros

_PATIENCE = 60.0  # s: for frames to come
N_FRAMES = 250
NAPS = (0.0, 0.001, 0.002, 0.005)  # how long packets gather before they are taken together [s]


def emulated(name: str) -> Any:
    """Import an emulated board, which is the tests'; raise AbsentError outside a checkout of the project."""
    if (folder := str(checkout("test", "driver"))) not in sys.path:
        sys.path.insert(0, folder)
    return importlib.import_module(name)


@dataclasses.dataclass
class Run:
    """What came of one run."""

    lost: int  # frames that did not come whole
    delay: np.ndarray  # shape (n,): from the sending of a frame's last packet to its delivery [ms]
    cpu: np.ndarray  # shape (n,): time that the reading thread computed for each frame [ms]
    flagged: float  # share of the chirps touched by lost packets that were marked; NaN: none was lost
    misplaced: int  # frames with a wrong sample that is not marked

    @property
    def load(self) -> float:
        """Share of one core that receiving and decoding take at 50 frames a second."""
        return float(self.cpu.mean()) / 20


def figures(quick: bool) -> dict[str, Any]:
    """Run the emulated board without and with losses; flat figures, and `choices`: how long packets gather."""
    n = 25 if quick else N_FRAMES
    clean, lossy = stream(n), stream(n, {"lose": 0.01})
    runs = {f"gather {nap * 1e3:g} ms": stream(n, nap=nap) for nap in NAPS[: 2 if quick else None]}
    late = {name: float(np.percentile(run.delay, 99)) for name, run in runs.items()}
    times = {name: run.cpu.tolist() for name, run in runs.items()}
    return {
        "udp_lost": clean.lost,
        "udp_p99_ms": float(np.percentile(clean.delay, 99)),
        "udp_cpu": clean.load,
        "udp_flagged": lossy.flagged,
        "udp_misplaced": clean.misplaced + lossy.misplaced,
        "udp_kill9_s": after_kill(),
        "choices": choices("dca1000 receive", ("p99 delivery", "ms"), late, times, next(iter(runs))),
    }


def stream(n: int, faults: Mapping[str, float] | None = None, nap: float | None = None) -> Run:
    """Receive n frames of table 3.1's radar (131,072 bytes, 91 packets) at 50 Hz, and compare them with what was sent."""
    emulator = emulated("dca1000_emulator")
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "radar.cfg"
        path.write_text(emulator.cfg(64, 64))
        ports = emulator.free_ports()
        addresses = {"host_address": emulator.HOST, "board_address": emulator.BOARD, "config_port": ports[0], "data_port": ports[1]}
        source = Dca1000Source(Dca1000Config(config=str(path), **addresses))
    size = frame_bytes(source.info, 2)
    if nap is not None:
        source._board.port = Receiver(emulator.HOST, emulator.BOARD, ports[1], size, nap=nap)
    told = {"frame_bytes": size, "ports": ports, "faults": dict(faults or {}), "n_frames": n}
    command = [sys.executable, emulator.__file__, json.dumps(told)]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as board:
        assert board.stdin is not None
        assert board.stdout is not None
        board.stdout.readline()  # it is there
        taken = _receive(source, board.stdin, n)
        board.stdin.close()
        said = json.loads(board.stdout.read())
    return _judge(taken, said, source, n)


class Watched:
    """The frames that a subscriber gets from a driver node under a supervisor, which can be killed."""

    def __init__(self, supervisor: Supervisor, node: Any, arrived: list[float]) -> None:
        self._supervisor, self._node, self.arrived = supervisor, node, arrived

    def wait(self, more: int) -> None:
        """Wait for frames. Raises HandwaveError when they do not come."""
        end, wanted = time.monotonic() + _PATIENCE, len(self.arrived) + more
        while len(self.arrived) < wanted:
            if time.monotonic() > end:
                raise HandwaveError(f"no frames of the emulated board within {_PATIENCE:g} s")
            self._supervisor.poll()
            rclpy.spin_once(self._node, timeout_sec=0.01)

    def kill(self) -> tuple[float, float]:
        """Kill the driver with SIGKILL; returns when that was, and when the next frame of the respawned one came [s]."""
        os.kill(self._supervisor.pid("driver"), signal.SIGKILL)
        killed = time.monotonic()
        while not self._supervisor.poll():
            time.sleep(0.005)
        for _ in range(100):  # what was on its way
            rclpy.spin_once(self._node, timeout_sec=0.0)
        self.arrived.clear()
        self.wait(1)
        return killed, self.arrived[0]


@contextlib.contextmanager
def watched(specs: Sequence[NodeSpec], domain: int) -> Iterator[Watched]:
    """Run nodes under a supervisor that starts them again, and subscribe to their frames."""
    os.environ.update(environment(domain))
    arrived: list[float] = []
    with ros():
        node = rclpy.create_node("boards_benchmark")
        node.create_subscription(RadarFrameMsg, "radar/frame", lambda _: arrived.append(time.monotonic()), qos.sensor())
        try:
            with Supervisor(specs, domain=domain, respawn=True, log=lambda name, line: None) as supervisor:
                yield Watched(supervisor, node, arrived)
        finally:
            node.destroy_node()


def after_kill() -> float:
    """Kill the driver node with SIGKILL while frames come; time until a subscriber gets the next frame of the respawned one [s]."""
    emulator = emulated("dca1000_emulator")
    with tempfile.TemporaryDirectory() as folder, contextlib.ExitStack() as stack:
        path, tty = Path(folder) / "radar.cfg", Path(folder) / "tty"
        path.write_text(emulator.cfg(64, 64))
        cli = stack.enter_context(emulator.SensorCli(tty))
        card = stack.enter_context(emulator.CaptureCard(emulator.noise(131072)))
        card.running = lambda: cli.running
        given = {"config": str(path), "serial_port": str(tty), "host_address": emulator.HOST, "board_address": emulator.BOARD}
        given |= {"config_port": card.config_port, "data_port": card.data_port}
        spec = NodeSpec("driver", "radar_ros.nodes.driver", {"source": "dca1000", **{f"dca1000.{k}": v for k, v in given.items()}})
        driver = stack.enter_context(watched((spec,), DOMAIN))
        driver.wait(50)
        killed, seen = driver.kill()
        return seen - killed


def _receive(source: Dca1000Source, told: Any, n: int) -> list[tuple[Any, int, int]]:
    """Frames, when they were delivered, and the reading thread's time until then [ns]."""
    taken: list[tuple[Any, int, int]] = []
    done = threading.Event()

    def take() -> None:
        now, spent = time.monotonic_ns(), time.thread_time_ns()
        reading = reader.take()
        if reading is not None:
            taken.append((reading.data, now, spent))
            if reading.data.sequence == n - 1:
                done.set()

    reader = Reader(source, take)
    source.power_up()
    reader.start()
    time.sleep(0.5)  # a sensor that ran already is refused
    told.write("start\n")
    told.flush()
    done.wait(0.02 * n + 3.0)
    reader.stop()
    source.power_down()
    return taken


def _judge(taken: list[tuple[Any, int, int]], said: Mapping[str, Any], source: Dca1000Source, n: int) -> Run:
    size = frame_bytes(source.info, 2)
    sent = [decode_frame(data, source.info) for data in emulated("dca1000_emulator").noise(size)]
    n_tx, n_chirp, _, _ = source.info.cube_shape
    chirps = n_tx * n_chirp
    touched: set[tuple[int, int]] = set()
    for place, length in said["lost"]:
        touched |= {divmod(chirp, chirps) for chirp in range(place * chirps // size, (place + length - 1) * chirps // size + 1)}
    marked = {(frame.sequence, int(k)) for frame, _, _ in taken for k in frame.missing}
    came = {frame.sequence for frame, _, _ in taken}
    touched = {(number, chirp) for number, chirp in touched if number in came}
    misplaced = 0
    for frame, _, _ in taken:
        good = np.ones(chirps, bool)
        good[frame.missing] = False
        same = (frame.cube == sent[frame.sequence % len(sent)]).all(axis=(2, 3)).swapaxes(0, 1).ravel()
        misplaced += not same[good].all()
    return Run(
        lost=n - sum(len(frame.missing) == 0 for frame, _, _ in taken),
        delay=np.array([now - said["sent_ns"][frame.sequence] for frame, now, _ in taken]) * 1e-6,
        cpu=np.diff([spent for _, _, spent in taken]) * 1e-6,
        flagged=len(touched & marked) / len(touched) if touched else math.nan,
        misplaced=misplaced,
    )
