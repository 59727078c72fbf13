"""What a machine does to `handwave up`: terminals that close, suspends, outputs nobody reads, clocks, disks and interfaces."""

from __future__ import annotations

import contextlib
import os
import shutil
import signal
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any, Final

import handwave.msg
import psutil

from benchmarks.faults_graph import DOMAIN
from benchmarks.faults_rows import Fault, Seen
from benchmarks.moved_clock import MovedClock
from radar_app.supervisor import environment
from radar_core import HandwaveError
from radar_ros import qos
from radar_ros.interrupts import Visitor, ros

_DOMAIN: Final = 150 + (DOMAIN + 7 - 150) % 80
_UP: Final = (sys.executable, "-m", "radar_app", "up", "--respawn")
_SCENE: Final = ("--scene", "single_target", "--param", "driver.at_end=loop")
_UP_DOMAIN: Final = ("--domain", str(_DOMAIN))
_START, _LONGEST = 90.0, 40.0  # s


class Up:
    """A `handwave up` of its own, what it prints, and the tracks that come of it."""

    def __init__(self, process: subprocess.Popen[str], visitor: Visitor) -> None:
        self.process, self._visitor = process, visitor
        self.lines: list[str] = []
        self.tracks: list[float] = []  # when they came, on CLOCK_MONOTONIC [s]
        visitor.node.create_subscription(handwave.msg.TrackArray, "tracks", lambda _: self.tracks.append(time.monotonic()), qos.RESULT)
        if process.stdout is not None:
            threading.Thread(target=lambda: self.lines.extend(process.stdout or ()), daemon=True).start()

    def live(self, seconds: float, until: Callable[[], bool] = lambda: False) -> bool:
        """Wait so long, or until something is so; returns whether it is."""
        end = time.monotonic() + seconds
        while not until():
            if time.monotonic() > end:
                return False
            self._visitor.spin(0.05)
        return True

    def family(self) -> list[psutil.Process]:
        """Give the processes of the command and its nodes."""
        return [psutil.Process(self.process.pid), *psutil.Process(self.process.pid).children(recursive=True)]

    def after(self, harm: Callable[[Up], Any]) -> Seen:
        """Do something to it, and wait until tracks come again."""
        first = len(self.lines)
        said = harm(self) or []
        began, count = time.monotonic(), len(self.tracks)
        well = self.live(_LONGEST, lambda: len(self.tracks) > count + 20)
        recovered = self.tracks[count] - began if well else _LONGEST
        self.live(2.0)
        return Seen(well, [*said, *self.lines[first:]], 0, recovered, "" if well else "no tracks came again")


@contextlib.contextmanager
def up(
    before: Sequence[str] = (), variables: dict[str, str] | None = None, stdout: int = subprocess.PIPE, source: Sequence[str] = _SCENE
) -> Iterator[Up]:
    """Start the command, wait until tracks come, and end it."""
    os.environ.update(environment(_DOMAIN))
    command = [*before, *_UP, *source, *_UP_DOMAIN]
    with (
        ros(),
        contextlib.closing(Visitor("handwave_faults_machine")) as visitor,
        subprocess.Popen(command, stdout=stdout, stderr=subprocess.STDOUT, text=True, env={**os.environ, **(variables or {})}) as process,
    ):
        one = Up(process, visitor)
        try:
            if not one.live(_START, lambda: len(one.tracks) > 20):
                raise HandwaveError("handwave up gave no tracks: " + " ".join(one.lines[-5:]))
            yield one
        finally:
            process.send_signal(signal.SIGINT)
            with contextlib.suppress(subprocess.TimeoutExpired):
                process.wait(15.0)
            process.kill()


def _stopped(one: Up) -> None:
    """Ctrl-Z, and fg."""
    one.process.send_signal(signal.SIGTSTP)
    one.live(4.0)
    one.process.send_signal(signal.SIGCONT)


def _suspended(one: Up) -> None:
    """All processes stop and continue, as with a suspended machine."""
    family = one.family()
    for member in family:
        member.suspend()
    one.live(5.0)
    for member in reversed(family):
        member.resume()


def _second(one: Up) -> list[str]:
    """Start a second graph in the same domain."""
    done = subprocess.run([*_UP, *_SCENE, *_UP_DOMAIN], capture_output=True, text=True, timeout=120)
    return done.stderr.splitlines() if done.returncode == 2 else ["it started"]


def _in_turn(harms: Sequence[Callable[[Up], Any]]) -> Callable[[], list[Seen]]:
    def inject() -> list[Seen]:
        with up() as one:
            return [one.after(harm) for harm in harms]

    return inject


def _once(harm: Callable[[Up], Any]) -> Callable[[], Seen]:
    return lambda: _in_turn((harm,))()[0]


def _hung_up() -> Seen:
    """Close the terminal: everything ends in order."""
    with up() as one:
        family = one.family()
        began = time.monotonic()
        one.process.send_signal(signal.SIGHUP)
        ended = one.live(10.0, lambda: one.process.poll() is not None)
        one.live(1.0)
        left = [member for member in family[1:] if member.is_running() and member.status() != psutil.STATUS_ZOMBIE]
        good = ended and one.process.returncode == 129 and not left
        return Seen(good, [*one.lines, f"status {one.process.returncode}"], 0, time.monotonic() - began, "" if good else "not in order")


def _unread() -> Seen:
    """Let nobody read what it prints, and kill a node meanwhile; then read it."""
    reading, writing = os.pipe()
    os.set_blocking(writing, False)
    with contextlib.suppress(BlockingIOError):
        while True:
            os.write(writing, 4096 * b"x")
    os.set_blocking(writing, True)
    try:
        with up(stdout=writing) as one:
            seen = one.after(lambda up: next(p for p in up.family() if "radar_ros.nodes.tracking" in p.cmdline()).kill())
            os.set_blocking(reading, False)
            text = b""
            for _ in range(100):
                one.live(0.02)
                with contextlib.suppress(BlockingIOError):
                    text += os.read(reading, 1 << 20)
            seen.lines = text.decode(errors="replace").splitlines()
            return seen
    finally:
        os.close(reading)
        os.close(writing)


def _read_only() -> Seen:
    """Make all disks read-only but memory."""
    mount = 'mount --make-rprivate / && mount -o remount,ro,bind / && exec "$@"'
    began = time.monotonic()
    with up(before=("unshare", "-m", "sh", "-c", mount, "sh")) as one:
        return Seen(True, one.lines, 0, time.monotonic() - began)


def _clock(seconds: int) -> Callable[[], Seen]:
    """Let the clock jump, for the nodes alone."""

    def inject() -> Seen:
        with tempfile.TemporaryDirectory() as folder:
            clock = MovedClock(Path(folder), 7200.0)
            with up(variables=clock.variables) as one:
                return one.after(lambda _: clock.step(seconds))

    return inject


def _may(*words: str) -> bool:
    return bool(shutil.which(words[0])) and subprocess.run([*words, "true"], capture_output=True).returncode == 0


def faults() -> tuple[Fault, ...]:
    """List the rows; those that need rights or a compiler only where there are."""
    rows = [
        Fault("the terminal is closed", "SIGHUP", "because its terminal was closed", _hung_up),
        Fault("Ctrl-Z, and fg", "SIGTSTP and SIGCONT", "stopped by Ctrl-Z", _once(_stopped)),
        Fault("the machine is suspended", "SIGSTOP and SIGCONT of all", "stood still for", _once(_suspended)),
        Fault("nobody reads the output", "full pipe", "lines are missing here|ended with status -9", _unread),
        Fault("a second graph in the domain", "real graph", "another Handwave runs there", _once(_second)),
    ]
    if shutil.which("cc"):
        means = "clock_gettime replaced (LD_PRELOAD)"
        rows += [
            Fault("the clock jumps an hour back", means, "went back in time", _clock(-3600)),
            Fault("the clock jumps an hour ahead", means, "stamps jumped 36.. s ahead", _clock(3600)),
        ]
    if sys.platform == "linux" and _may("unshare", "-m"):
        rows.append(Fault("all disks are read-only", "mount namespace", "Read-only file system", _read_only))
    return tuple(rows)
