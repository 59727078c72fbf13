"""Start the nodes of a graph as processes, show their logs, keep them running, and stop them all."""

from __future__ import annotations

import ctypes
import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import psutil

from radar_core import ConfigError
from radar_ros.graph import NodeSpec, arguments

_GRACE = (1.5, 0.7)  # s: after SIGINT, after SIGTERM; then SIGKILL. Together below the 3 s that a user waits.
_PR_SET_PDEATHSIG = 1

LogSink = Callable[[str, str], None]


def environment(domain: int | None = None) -> dict[str, str]:
    """Environment for nodes: one thread per pool, discovery on this machine only, ROS's index found.

    Parameters
    ----------
    domain : int or None
        ROS domain; None: as in the environment.

    Raises
    ------
    ConfigError
        When ROS would have no place for its logs.
    """
    env = dict(os.environ)
    for pool in ("OMP", "OPENBLAS", "MKL"):
        env.setdefault(f"{pool}_NUM_THREADS", "1")
    env.setdefault("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
    env.setdefault("RCUTILS_COLORIZED_OUTPUT", "0")
    env.setdefault("PYTHONUNBUFFERED", "1")
    if not env.get("AMENT_PREFIX_PATH"):
        env["AMENT_PREFIX_PATH"] = sys.prefix
    if domain is not None:
        env["ROS_DOMAIN_ID"] = str(domain)
    if not env.get("HOME") and not env.get("ROS_LOG_DIR"):
        raise ConfigError("neither HOME nor ROS_LOG_DIR is set; ROS 2 writes its logs there: export one of them")
    return env


def _die_with_parent() -> None:
    """In the child, before it becomes a node: end when whoever started us ends, however that happens (Linux)."""
    ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGTERM)


@dataclass
class _Child:
    spec: NodeSpec
    process: subprocess.Popen[str]
    reader: threading.Thread
    restarts: int = 0


class Supervisor:
    """Runs nodes as processes of their own.

    Parameters
    ----------
    specs : sequence of NodeSpec
        What to run.
    domain : int or None
        ROS domain; None: as in the environment.
    respawn : bool
        Restart a node that died.
    log : callable
        Called with node name and line for every line that a node prints.
    """

    def __init__(self, specs: Sequence[NodeSpec], *, domain: int | None = None, respawn: bool = False, log: LogSink | None = None) -> None:
        self.specs = tuple(specs)
        self.respawn = respawn
        self.crashes: list[tuple[str, int]] = []
        self._log = log or (lambda name, line: print(f"[{name}] {line}", flush=True))
        self._environment = environment(domain)
        self._children: dict[str, _Child] = {}
        self._stopping = False

    def __enter__(self) -> Supervisor:
        self.start()
        return self

    def __exit__(self, *_: Any) -> None:
        self.stop()

    def start(self, *, without: Sequence[str] = ()) -> None:
        """Start all nodes that do not run yet, except ``without``: a source may start when its readers wait."""
        for spec in self.specs:
            if spec.name not in self._children and spec.name not in without:
                self._children[spec.name] = self._start(spec)

    def _start(self, spec: NodeSpec) -> _Child:
        process = subprocess.Popen(
            [sys.executable, "-m", spec.module, *arguments(spec)],
            env=self._environment,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            errors="replace",
            start_new_session=True,  # a Ctrl-C reaches only us; we stop the nodes in order
            preexec_fn=_die_with_parent if sys.platform == "linux" else None,
        )
        reader = threading.Thread(target=self._read, args=(spec.name, process), daemon=True)
        reader.start()
        return _Child(spec, process, reader)

    def _read(self, name: str, process: subprocess.Popen[str]) -> None:
        assert process.stdout is not None
        for line in process.stdout:
            self._log(name, line.rstrip())

    def pid(self, name: str) -> int:
        """Process id of a node."""
        return self._children[name].process.pid

    def cpu_seconds(self) -> dict[str, float]:
        """CPU time that each living node has used [s]."""
        used = {}
        for name, child in self._children.items():
            try:
                times = psutil.Process(child.process.pid).cpu_times()
            except psutil.Error:
                continue
            used[name] = times.user + times.system
        return used

    def poll(self) -> list[tuple[str, int]]:
        """Look for nodes that ended by themselves; restart those that crashed if asked to.

        Returns
        -------
        list of (str, int)
            Name and exit status (negative: signal) of every node that has ended since the last look.
        """
        ended = []
        for name, child in list(self._children.items()):
            status = child.process.poll()
            if status is None or self._stopping:
                continue
            child.reader.join(timeout=1.0)
            ended.append((name, status))
            del self._children[name]
            if status != 0:
                self.crashes.append((name, status))
                if self.respawn and status != 2:  # 2: its configuration makes no sense, and will not the next time
                    self._log(name, f"ended with status {status}; starting it again")
                    self._children[name] = self._start(child.spec)
        return ended

    @property
    def running(self) -> list[str]:
        """Names of the nodes that live."""
        return [name for name, child in self._children.items() if child.process.poll() is None]

    def stop(self) -> None:
        """Stop all nodes within 3 s: SIGINT, then SIGTERM, then SIGKILL."""
        self._stopping = True
        waiting = [child.process for child in self._children.values()]
        for number, grace in ((signal.SIGINT, _GRACE[0]), (signal.SIGTERM, _GRACE[1]), (signal.SIGKILL, 0.5)):
            waiting = [process for process in waiting if process.poll() is None]
            for process in waiting:
                process.send_signal(number)
            deadline = time.monotonic() + grace
            while time.monotonic() < deadline and any(process.poll() is None for process in waiting):
                time.sleep(0.01)
        for child in self._children.values():
            child.reader.join(timeout=0.5)


def refuse_busy_domain(names: Sequence[str], namespace: str, domain: int | None, wait: float = 1.0) -> None:
    """Raise `ConfigError` when nodes of ours already run in this ROS domain: two graphs on the same topics disturb each other.

    Parameters
    ----------
    names : sequence of str
        Nodes that are about to start.
    namespace : str
        Their namespace.
    domain : int or None
        ROS domain.
    wait : float
        Time given to discovery [s].
    """
    code = "import sys, time, rclpy; rclpy.init(args=[]); n = rclpy.create_node('handwave_look', start_parameter_services=False)\n"
    code += f"time.sleep({wait}); print(*(f'{{s}}|{{m}}' for m, s in n.get_node_names_and_namespaces()), sep='\\n'); rclpy.shutdown()"
    done = subprocess.run([sys.executable, "-c", code], env=environment(domain), capture_output=True, text=True, timeout=30)
    space = f"/{namespace.strip('/')}"
    busy = sorted(name for name in names if f"{space}|{name}" in done.stdout.split())
    if busy:
        number = domain if domain is not None else int(os.environ.get("ROS_DOMAIN_ID", "0"))
        raise ConfigError(
            f"ROS domain {number} already has {', '.join(busy)} in namespace {space}: another Handwave runs there (or was killed "
            f"less than 20 s ago). Stop it, or choose another domain (--domain {(number + 1) % 100}) or namespace (--namespace left)"
        )


def run_composed(specs: Sequence[NodeSpec], domain: int | None = None) -> int:
    """Run all nodes in this process, on one executor, until interrupted.

    Returns
    -------
    int
        Exit status.
    """
    os.environ.update(environment(domain))
    import importlib

    from radar_ros.stage import run_many

    def maker(spec: NodeSpec) -> Callable[[], Any]:
        return lambda: importlib.import_module(spec.module).make_node(cli_args=arguments(spec), use_global_arguments=False)

    return run_many([maker(spec) for spec in specs])


def default_log_sink(width: int) -> LogSink:
    """Print lines with the node's name in a colour of its own."""
    from rich.console import Console
    from rich.text import Text

    console = Console()
    colours = ("cyan", "green", "magenta", "yellow", "blue", "bright_cyan", "bright_green", "bright_magenta")
    known: dict[str, str] = {}

    def sink(name: str, line: str) -> None:
        colour = known.setdefault(name, colours[len(known) % len(colours)])
        console.print(Text.assemble((f"{name:>{width}} ", colour), Text.from_ansi(line)), soft_wrap=True)

    return sink
