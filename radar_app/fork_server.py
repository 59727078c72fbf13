"""Nodes as forks of one process that has loaded what they need: their imports take longer than anything else when a graph starts.

Half of a node's first seconds go to loading the same libraries as its neighbours. Here one process loads them, and every node begins as a
copy of it: still a process of its own, with its own memory, log and end. For Linux; where a fork is not to be had, `Supervisor` starts
nodes one by one.
"""

from __future__ import annotations

import ctypes
import importlib
import json
import os
import select
import signal
import socket
import subprocess
import sys
import traceback
from collections.abc import Mapping, Sequence
from contextlib import AbstractContextManager, nullcontext, suppress
from typing import IO, Any

from radar_app.graph import NODES, VARIANTS
from radar_core import ConfigError

_MESSAGE = 1 << 20  # bytes of the longest request
_LOOK = 0.1  # s: how often it looks which nodes have ended
_PR_SET_PDEATHSIG, _PR_SET_NAME = 1, 15
_BEGUN = 120.0  # s: for a node to be forked, which waits until everything is loaded; a busy machine is slow


def fork_server_of(variant: str) -> AbstractContextManager[ForkServer | None]:
    """Begin to load what the nodes of a graph need; None where nodes cannot be forked."""
    if sys.platform != "linux":
        return nullcontext()
    return ForkServer(sorted({NODES[label.rpartition("/")[2]].module for label in VARIANTS[variant].nodes}))


class Forked:
    """A node that was forked, as `subprocess.Popen` shows one."""

    def __init__(self, fork_server: ForkServer, pid: int, stdout: IO[str]) -> None:
        self.pid, self.stdout = pid, stdout
        self._fork_server = fork_server

    def poll(self) -> int | None:
        """Exit status, negative for a signal; None: it lives."""
        return self._fork_server.status(self.pid)

    def send_signal(self, number: int) -> None:
        """Send a signal, unless it has ended."""
        if self.poll() is None:
            with suppress(ProcessLookupError):  # it ended this moment
                os.kill(self.pid, number)


class ForkServer:
    """The process that loads ``modules`` and forks nodes; begins at once, and ends with the block that it is used in."""

    def __init__(self, modules: Sequence[str]) -> None:
        self._ended: dict[int, int] = {}
        self._begun: list[int] = []
        self._socket, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        command = [sys.executable, "-m", "radar_app.fork_server", str(theirs.fileno()), *modules]
        pools = {f"{pool}_NUM_THREADS": "1" for pool in ("OMP", "OPENBLAS", "MKL", "NUMBA")}  # a fork takes no threads along
        self._process = subprocess.Popen(
            command, pass_fds=(theirs.fileno(),), env={**os.environ, **pools}, stdin=subprocess.DEVNULL, start_new_session=True
        )
        theirs.close()

    def __enter__(self) -> ForkServer:
        return self

    def __exit__(self, *_: Any) -> None:
        self._socket.close()  # which tells it to end
        self._process.wait()

    def start(self, name: str, module: str, arguments: Sequence[str], environment: Mapping[str, str]) -> Forked:
        """Fork a node."""
        reading, writing = os.pipe()
        request = {"name": name, "module": module, "arguments": list(arguments), "environment": dict(environment)}
        try:
            socket.send_fds(self._socket, [json.dumps(request).encode()], [writing])
        except OSError:
            raise ConfigError("the process that loads the nodes has ended; what it printed stands above") from None
        finally:
            os.close(writing)
        while not self._begun:
            if not self._hear(_BEGUN):
                os.close(reading)
                raise ConfigError("the process that loads the nodes does not answer; what it printed stands above")
        return Forked(self, self._begun.pop(), os.fdopen(reading, encoding="utf-8", errors="replace"))

    def status(self, pid: int) -> int | None:
        """Exit status of a node; None: it lives."""
        while pid not in self._ended and self._hear(0.0):
            pass
        if pid not in self._ended and self._process.poll() is not None:
            return -signal.SIGTERM  # nodes do not outlive it
        return self._ended.get(pid)

    def _hear(self, timeout: float) -> bool:
        """Take in one message; returns whether one came."""
        if not select.select([self._socket], [], [], timeout)[0]:
            return False
        try:
            data = self._socket.recv(_MESSAGE)
        except ConnectionResetError:
            data = b""
        if not data:
            return False
        message = json.loads(data)
        if "status" in message:
            self._ended[message["pid"]] = message["status"]
        else:
            self._begun.append(message["pid"])
        return True


def main() -> None:
    """Load, then fork what is asked for, and tell what has ended, until nobody asks any more."""
    libc, parent = ctypes.CDLL(None), os.getppid()
    libc.prctl(_PR_SET_PDEATHSIG, signal.SIGTERM)
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    asked = socket.socket(fileno=int(sys.argv[1]))
    _load(sys.argv[2:])
    while os.getppid() == parent:
        if select.select([asked], [], [], _LOOK)[0]:
            data, files, _, _ = socket.recv_fds(asked, _MESSAGE, 1)
            if not data:
                return
            own = os.getpid()
            pid = os.fork()
            if not pid:
                asked.close()
                _be(json.loads(data), files[0], libc, own)
            os.close(files[0])
            asked.send(json.dumps({"pid": pid}).encode())
        _tell_ended(asked)


def _load(modules: Sequence[str]) -> None:
    """Import the nodes and what compiled code needs.

    Nothing here may start a thread, which a fork would lose; those of LTTng, which come with rclpy, only tracing needs.
    """
    for module in modules:
        importlib.import_module(module)
    if "numba" in sys.modules:
        from numba.core.registry import cpu_target

        cpu_target.typing_context.refresh()
        cpu_target.target_context.refresh()


def _be(request: dict[str, Any], out: int, libc: ctypes.CDLL, fork_server: int) -> None:
    """Become the node; does not return."""
    status = 1
    try:
        libc.prctl(_PR_SET_PDEATHSIG, signal.SIGTERM)
        if os.getppid() != fork_server:  # it ended before we asked to be told
            os._exit(1)
        libc.prctl(_PR_SET_NAME, request["name"].encode()[:15])
        os.setsid()
        os.dup2(out, 1)
        os.dup2(out, 2)
        os.close(out)
        sys.stdout.reconfigure(line_buffering=True)  # type: ignore[union-attr]
        os.environ.clear()
        os.environ.update(request["environment"])
        sys.argv = [request["module"], *request["arguments"]]
        from radar_ros.stage import run

        status = run(importlib.import_module(request["module"]).make_node)
    except SystemExit as end:
        status = end.code if isinstance(end.code, int) else int(end.code is not None)
    except BaseException:
        traceback.print_exc()
    finally:
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(status)


def _tell_ended(asked: socket.socket) -> None:
    """Tell which nodes have ended, and how."""
    while True:
        try:
            pid, status = os.waitpid(-1, os.WNOHANG)
        except ChildProcessError:
            return
        if not pid:
            return
        asked.send(json.dumps({"pid": pid, "status": os.waitstatus_to_exitcode(status)}).encode())


if __name__ == "__main__":
    main()
