"""Start the nodes of a graph as processes, show their logs, keep them running, and stop them all."""

from __future__ import annotations

import ctypes
import math
import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import closing, contextmanager, suppress
from dataclasses import dataclass
from functools import partial
from typing import Any

import psutil

from radar_app.composed import composed_spec
from radar_app.exits import CLOSED, USAGE, pipe_closed, say
from radar_app.fork_server import Forked, ForkServer
from radar_app.graph import NodeSpec, arguments
from radar_app.places import writable
from radar_app.printing import Printer
from radar_app.segments import SETTLED, sweep
from radar_app.watchdog import Watchdog
from radar_core import ConfigError
from radar_core.paths import share_dir
from radar_ros import heartbeat
from radar_ros.signals import interruptible, stopped, told

_GRACE = (1.5, 0.7)  # s: after SIGINT, after SIGTERM; then SIGKILL. Together below the 3 s that a user waits.
_STOOD_STILL = 3.0  # s: a machine that is only busy is not worth a line
_LAST_DOMAIN = 232  # a higher number's ports lie above 65535
_AGAIN = 0.2  # s: between two SIGINTs, which a node that is still being imported ignores
_PR_SET_PDEATHSIG = 1
_STABLE = 10.0  # s: a node that lived that long is started again at once; one that dies sooner, after a growing pause
_LONGEST_PAUSE = 10.0  # s
_BEGINS = 10.0  # s: who takes longer to begin keeps nobody waiting
_CONFIGURATION = 2  # exit status of a node whose configuration makes no sense, now and the next time
_LOOK_TIMEOUT = 120.0  # s: to start an interpreter and to look; a busy machine is slow
LOOK = 1.0
"""How long discovery needs to find nodes that run already [s]."""
_PULSE = 0.2  # s: how often it is looked for nodes that ended
OURS = "handwave"
"""Who tells what no node does."""
_LIBC = ctypes.CDLL(None) if sys.platform == "linux" else None  # loaded here: between fork and exec nothing may be loaded

LogSink = Callable[[str, str], None]
Process = subprocess.Popen[str] | Forked


def environment(domain: int | None = None) -> dict[str, str]:
    """Environment for nodes in a ROS domain: one thread per pool, discovery on this machine only and quick, ROS's index found.

    A `ConfigError` says that ROS would have no place for its logs, or that the domain is none.
    """
    env = dict(os.environ)
    for pool in ("OMP", "OPENBLAS", "MKL"):
        env.setdefault(f"{pool}_NUM_THREADS", "1")
    env.setdefault("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
    if not any(env.get(f"{library}_DEFAULT_PROFILES_FILE") for library in ("FASTDDS", "FASTRTPS")):
        env["FASTRTPS_DEFAULT_PROFILES_FILE"] = str(share_dir() / "config" / "dds" / "discovery.xml")
    env.setdefault("RCUTILS_COLORIZED_OUTPUT", "0")
    env.setdefault("PYTHONUNBUFFERED", "1")
    if not env.get("AMENT_PREFIX_PATH"):
        env["AMENT_PREFIX_PATH"] = sys.prefix
    if domain is not None:
        env["ROS_DOMAIN_ID"] = str(domain)
    number = env.get("ROS_DOMAIN_ID") or "0"
    if not number.isdecimal() or int(number) > _LAST_DOMAIN:
        raise ConfigError(f"ROS_DOMAIN_ID is {number!r}; it must be a number from 0 to {_LAST_DOMAIN}: export ROS_DOMAIN_ID=0")
    if not env.get("HOME") and not env.get("ROS_LOG_DIR"):
        raise ConfigError("neither HOME nor ROS_LOG_DIR is set; ROS 2 writes its logs there: export one of them")
    return writable(env)


def _in_child(parent: int) -> None:
    """Prepare the child before it becomes a node: on Linux it ends when its parent ends, however that happens."""
    # A node takes a second to import; until it can tidy up, Python's answer to SIGINT would be a traceback.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    if _LIBC is not None:
        _LIBC.prctl(_PR_SET_PDEATHSIG, signal.SIGTERM)
        if os.getppid() != parent:  # it ended before we asked to be told
            os._exit(1)


@dataclass
class _Child:
    spec: NodeSpec
    process: Process
    reader: threading.Thread
    started: float
    deaths: int = 0


class Supervisor:
    """Runs nodes as processes of their own, in a ROS domain (None: as in the environment).

    ``respawn`` starts a node again that died; ``log`` is called with node name and line for every line that a node prints. With a
    ``fork_server`` nodes are forks of it, which start in half the time.
    """

    def __init__(
        self,
        specs: Sequence[NodeSpec],
        *,
        domain: int | None = None,
        respawn: bool = False,
        log: LogSink | None = None,
        fork_server: ForkServer | None = None,
    ) -> None:
        self.specs = tuple(specs)
        self._fork_server = fork_server
        self.respawn = respawn
        self.crashes: list[tuple[str, int]] = []
        self.hangs: list[tuple[str, str]] = []
        self.log = log or (lambda name, line: print(f"[{name}] {line}", flush=True))
        self._watchdog = Watchdog([spec.label for spec in self.specs])
        self._environment = environment(domain) | self._watchdog.variables
        self._children: dict[str, _Child] = {}
        self._used: dict[str, float] = {}
        self._due: dict[str, tuple[float, NodeSpec, int]] = {}
        self._stopping, self._sweep_at = False, math.inf

    def __enter__(self) -> Supervisor:
        try:
            self.start()
        except BaseException:
            self.stop()
            raise
        return self

    def __exit__(self, *_: Any) -> None:
        self.stop()

    def start(self, *, without: Sequence[str] = ()) -> None:
        """Start all nodes that do not run yet, except ``without``: a source may start when its readers wait."""
        for spec in self.specs:
            if spec.label not in self._children and spec.label not in without:
                self._children[spec.label] = self._start(spec)

    def _start(self, spec: NodeSpec, deaths: int = 0) -> _Child:
        self._environment = writable(self._environment)  # a disk may be read-only by now
        process = self._fork(spec) if self._fork_server is not None else self._spawn(spec)
        reader = threading.Thread(target=self._read, args=(spec.label, process), daemon=True)
        reader.start()
        return _Child(spec, process, reader, time.monotonic(), deaths)

    def _fork(self, spec: NodeSpec) -> Forked:
        assert self._fork_server is not None
        return self._fork_server.start(spec.label, spec.module, arguments(spec), self._environment)

    def _spawn(self, spec: NodeSpec) -> subprocess.Popen[str]:
        return subprocess.Popen(
            [sys.executable, "-m", spec.module, *arguments(spec)],
            env=self._environment,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            errors="replace",
            start_new_session=True,  # a Ctrl-C reaches only us; we stop the nodes in order
            preexec_fn=partial(_in_child, os.getpid()),
        )

    def _read(self, name: str, process: Process) -> None:
        assert process.stdout is not None
        for line in process.stdout:
            self.log(name, line.rstrip())

    def pid(self, name: str) -> int:
        """Process id of a node."""
        return self._children[name].process.pid

    def cpu_seconds(self) -> dict[str, float]:
        """CPU time that each node has used [s]; of one that has ended, what it had used when this was asked last."""
        for name, child in self._children.items():
            with suppress(psutil.Error):
                times = psutil.Process(child.process.pid).cpu_times()
                self._used[name] = times.user + times.system
        return dict(self._used)

    def poll(self) -> list[tuple[str, int]]:
        """Look for nodes that ended by themselves; restart those that crashed if asked to.

        Returns name and exit status (negative: signal) of every node that has ended since the last look.
        """
        ended = []
        self._look_for_hangs()
        for name, child in list(self._children.items()):
            status = child.process.poll()
            if status is None or self._stopping:
                continue
            child.reader.join(timeout=1.0)
            ended.append((name, status))
            del self._children[name]
            if status != 0:
                self.crashes.append((name, status))
                self._sweep_at = time.monotonic() + SETTLED
                if self.respawn and status != _CONFIGURATION:
                    self._plan_restart(name, status, child)
        if time.monotonic() >= self._sweep_at:
            self._sweep_at = math.inf
            sweep()
        for name, (due, spec, deaths) in list(self._due.items()):
            if time.monotonic() >= due and not self._one_begins():
                del self._due[name]
                self._children[name] = self._start(spec, deaths)
        return ended

    def _one_begins(self) -> bool:
        """Whether a node was started and does not work yet: two that died and come back at once may hear nothing for ever (Fast DDS)."""
        new = [child.process.pid for child in self._children.values() if time.monotonic() - child.started < _BEGINS]
        return not all(map(self._watchdog.alive, new))

    def _look_for_hangs(self) -> None:
        """Tell of nodes that hang, and end them where they are started again."""
        names = {child.process.pid: name for name, child in self._children.items()}
        begun, again, late = self._watchdog.look(names)
        if late > _STOOD_STILL:
            self.log(OURS, f"this machine or this command stood still for {late:.0f} s; everything goes on")
        for pid, seconds in again:
            self.log(names[pid], f"goes on, after {seconds:.1f} s")
        for pid, why in begun:
            self.hangs.append((names[pid], why))
            remedy = "it is ended" if self.respawn else "the others go on, --respawn would start it again"
            self.log(names[pid], f"hangs: {why}; {remedy}")
            heartbeat.notify(f"STATUS={names[pid]} hangs")
            if self.respawn:
                self._children[names[pid]].process.send_signal(signal.SIGKILL)

    @property
    def healthy(self) -> bool:
        """Whether all nodes have begun to work, live and do not hang."""
        pids = [child.process.pid for child in self._children.values()]
        return len(pids) == len(self.specs) and all(map(self._watchdog.alive, pids))

    def send(self, number: signal.Signals) -> None:
        """Send a signal to all nodes: SIGSTOP and SIGCONT let them rest."""
        for child in self._children.values():
            child.process.send_signal(number)

    def _plan_restart(self, name: str, status: int, child: _Child) -> None:
        """Start it again: at once the first time, ever later when it dies again and again."""
        now = time.monotonic()
        deaths = 1 if now - child.started > _STABLE else child.deaths + 1
        pause = 0.0 if deaths == 1 else min(0.25 * 2.0**deaths, _LONGEST_PAUSE)
        self.log(name, f"ended with status {status}; starting it again" + (f" in {pause:g} s" if pause else ""))
        self._due[name] = (now + pause, child.spec, deaths)

    @property
    def active(self) -> bool:
        """Whether any node lives or will be started again."""
        return bool(self.running or self._due)

    @property
    def running(self) -> list[str]:
        """Names of the nodes that live."""
        return [name for name, child in self._children.items() if child.process.poll() is None]

    def stop(self) -> None:
        """Stop all nodes within 3 s: SIGINT, then SIGTERM, then SIGKILL."""
        self._stopping = True
        heartbeat.notify("STOPPING=1")
        self._due.clear()
        waiting = [child.process for child in self._children.values()]
        for number, grace in ((signal.SIGINT, _GRACE[0]), (signal.SIGTERM, _GRACE[1]), (signal.SIGKILL, 0.5)):
            waiting = _end(waiting, number, grace)
        for child in self._children.values():
            child.reader.join(timeout=0.5)
        self._watchdog.close()


@contextmanager
def _resting(supervisor: Supervisor) -> Iterator[None]:
    """Let Ctrl-Z stop the nodes too: they are in sessions of their own, where a terminal does not reach them."""

    def rest(*_: Any) -> None:
        supervisor.log(OURS, "stopped by Ctrl-Z, and all nodes with it; fg continues them")
        supervisor.send(signal.SIGSTOP)
        os.kill(os.getpid(), signal.SIGSTOP)
        supervisor.send(signal.SIGCONT)

    before = signal.signal(signal.SIGTSTP, rest)
    try:
        yield
    finally:
        signal.signal(signal.SIGTSTP, before)


def supervise(supervisor: Supervisor, wait: Callable[[float], None] = time.sleep) -> int:
    """Run nodes until interrupted or until none is left; a node that dies leaves the others running.

    ``wait`` passes a time [s], and may do something meanwhile. Returns 0 when no node died, 1 when one did, 2 when a node refused its
    configuration (which ends all), 129 when the terminal was closed, 141 when nobody reads the output any more.
    """
    status = 0
    try:
        with interruptible(), _resting(supervisor), supervisor:
            status = _oversee(supervisor, wait)
    except KeyboardInterrupt:  # that is how it ends
        status = stopped() if told() == signal.SIGHUP else 0
        if status:
            say("stopped because its terminal was closed")
    return status or int(bool(supervisor.crashes) and not supervisor.respawn)


def _oversee(supervisor: Supervisor, wait: Callable[[float], None]) -> int:
    while True:
        wait(_PULSE)
        if pipe_closed():
            return CLOSED
        if supervisor.healthy:
            heartbeat.beat()  # for systemd, which starts everything again when it does not come
        for name, code in supervisor.poll():
            if code == _CONFIGURATION:
                say(f"node {name} refused its configuration, see above; everything is stopped")
                return USAGE
            if not supervisor.respawn:
                advice = "" if code == 0 else "; the others go on, --respawn would start it again"
                say(f"node {name} ended with status {code}{advice}")
        if not supervisor.active:
            return 0


def _end(processes: Sequence[Process], number: signal.Signals, grace: float) -> list[Process]:
    """Send a signal and wait; return the processes that live all the same."""
    now = time.monotonic()
    deadline, again = now + grace, now
    while True:
        processes = [process for process in processes if process.poll() is None]
        now = time.monotonic()
        if not processes or now > deadline:
            return list(processes)
        if now >= again:
            for process in processes:
                process.send_signal(number)
            again = now + _AGAIN
        time.sleep(0.01)


def refuse_busy_domain(names: Sequence[str], namespace: str, domain: int | None, wait: float = LOOK) -> None:
    """Raise `ConfigError` when nodes of these labels already run in this ROS domain: two graphs on the same topics disturb each other.

    ``wait`` is the time given to discovery [s].
    """
    code = "import sys, time, rclpy; rclpy.init(args=[]); n = rclpy.create_node('handwave_look', start_parameter_services=False)\n"
    code += f"time.sleep({wait}); print(*(f'{{s}}|{{m}}' for m, s in n.get_node_names_and_namespaces()), sep='\\n'); rclpy.shutdown()"
    done = subprocess.run([sys.executable, "-c", code], env=environment(domain), capture_output=True, text=True, timeout=_LOOK_TIMEOUT)
    found = [tuple(reversed(line.split("|"))) for line in done.stdout.split()]
    refuse_running([(name, space) for name, space in found], names, namespace, domain)


def refuse_running(found: Iterable[tuple[str, str]], names: Sequence[str], namespace: str, domain: int | None) -> None:
    """Raise `ConfigError` when nodes of these labels are among those found: pairs of name and namespace, as ROS gives them."""
    space = f"/{namespace.strip('/')}"
    running = {f"{where.rstrip('/')}/{name}" for name, where in found}
    busy = sorted(name for name in names if f"{space.rstrip('/')}/{name}" in running)
    if busy:
        number = domain if domain is not None else int(os.environ.get("ROS_DOMAIN_ID", "0"))
        raise ConfigError(
            f"ROS domain {number} already has {', '.join(busy)} in namespace {space}: another Handwave runs there (or was killed "
            f"less than 20 s ago). Stop it, or choose another domain (--domain {(number + 1) % 100}) or namespace (--namespace left)"
        )


def start_graph(specs: Sequence[NodeSpec], domain: int | None, *, composed: bool, respawn: bool) -> int:
    """Run the nodes, all in one process or each in its own, until interrupted; returns the exit status.

    A `ConfigError` says that nodes of these names run already.
    """
    os.environ.update(environment(domain))
    refuse_busy_domain([spec.path for spec in specs], "", domain)
    sweep()  # of graphs that were killed
    with closing(Printer(max(len(s.label) for s in specs))) as sink:
        if composed:
            return supervise(Supervisor([composed_spec(specs)], domain=domain, respawn=respawn, log=sink))
        return _told(specs, domain, sink, respawn=respawn)


def _told(specs: Sequence[NodeSpec], domain: int | None, sink: Printer, *, respawn: bool) -> int:
    """Run each node in a process of its own, and tell what happens in the graph."""
    from radar_app.watching.listener import Listener
    from radar_app.watching.teller import Teller
    from radar_ros.interrupts import ros

    with ros(), Listener("up") as listener:
        teller = Teller(listener, [spec.path for spec in specs], partial(sink, OURS))

        def wait(seconds: float) -> None:
            listener.spin(seconds)
            teller.look()

        return supervise(Supervisor(specs, domain=domain, respawn=respawn, log=sink), wait)
