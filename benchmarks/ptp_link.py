"""linuxptp over a virtual cable: `ptp4l` in two network namespaces, which stand for two computers."""

from __future__ import annotations

import contextlib
import os
import re
import shutil
import subprocess
import tempfile
import threading
import time
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Final

from benchmarks.interfaces import ip
from benchmarks.report import AbsentError
from radar_core import HandwaveError

SETTINGS: Final = {
    "time_stamping": "software",
    "logAnnounceInterval": "-1",
    "logSyncInterval": "-3",
    "logMinDelayReqInterval": "-3",
}
"""What both ends are told: the section [global] of docs/research/ptp.md."""
_LOG: Final = {"freq_est_interval": "0", "summary_interval": "-3"}  # how often they tell: once a second, or with every message
_TOLD: Final = re.compile(r"ptp4l\[(?P<at>[\d.]+)\]: .*master offset +(?P<offset>-?\d+) s(?P<state>\d) .*path delay +(?P<delay>-?\d+)")
_SIDES: Final = {"near": "192.0.2.1/24", "far": "192.0.2.2/24"}  # addresses for documentation: nobody has them
_END: Final = 5.0  # s


@dataclass(frozen=True)
class Offset:
    """One line of `ptp4l`: when (CLOCK_MONOTONIC [s]), how far the clock is ahead of the leading one [s], state of the servo, delay [s]."""

    at: float
    offset: float
    state: int
    delay: float


class Ptp4l:
    """A `ptp4l` that runs, and what it tells."""

    def __init__(self, command: list[str], variables: Mapping[str, str]) -> None:
        self.lines: list[str] = []
        self._process = subprocess.Popen(
            command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, env={**os.environ, **variables}
        )
        self._reader = threading.Thread(target=self._read, daemon=True)
        self._reader.start()

    def _read(self) -> None:
        for line in self._process.stdout or ():
            self.lines.append(line.rstrip())

    def offsets(self, since: float = 0.0) -> list[Offset]:
        """Give the offsets that it told since then (CLOCK_MONOTONIC [s])."""
        found = [
            Offset(float(match["at"]), int(match["offset"]) * 1e-9, int(match["state"]), int(match["delay"]) * 1e-9)
            for match in map(_TOLD.search, tuple(self.lines))
            if match
        ]
        return [one for one in found if one.at >= since]

    def close(self) -> None:
        """End it."""
        self._process.terminate()
        try:
            self._process.wait(_END)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
        self._reader.join(_END)


class Link:
    """A virtual cable between two network namespaces; `near` leads, `far` follows. An `AbsentError` says why there can be none."""

    def __init__(self) -> None:
        for program in ("ptp4l", "ip"):
            if shutil.which(program) is None:
                raise AbsentError(f"{program} is not installed: apt-get install linuxptp iproute2")
        self._running: list[Ptp4l] = []
        self.folder = Path(tempfile.mkdtemp(prefix="handwave_ptp_"))
        self._places = {side: f"{self.folder.name}_{side}" for side in _SIDES}  # names that nobody else has

    def __enter__(self) -> Link:
        try:
            for place in self._places.values():
                ip("netns", "add", place)
            near, far = self._places.values()
            ip("link", "add", "near", "netns", near, "type", "veth", "peer", "name", "far", "netns", far)
            for side, place in self._places.items():
                ip("-n", place, "address", "add", _SIDES[side], "dev", side)
                ip("-n", place, "link", "set", side, "up")
        except HandwaveError as error:
            self.close()
            raise AbsentError(f"this machine gives no network namespaces (they need root): {error}") from error
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
        self.close()

    def start(self, side: str, *, steers: bool = False, variables: Mapping[str, str] | None = None) -> Ptp4l:
        """Start `ptp4l` at an end; one that does not steer its clock only tells the offset."""
        name = f"{side}{len(self._running)}"
        settings = SETTINGS | _LOG | {"uds_address": str(self.folder / name), "free_running": str(int(not steers))}
        file = self.folder / f"{name}.conf"
        file.write_text("[global]\n" + "".join(f"{key} {value}\n" for key, value in settings.items()), encoding="utf-8")
        words = ["ip", "netns", "exec", self._places[side], "ptp4l", "-f", str(file), "-i", side, "-m", *(["-s"] if side == "far" else [])]
        self._running.append(Ptp4l(words, variables or {}))
        return self._running[-1]

    def ask(self, words: str) -> str:
        """Ask the end that follows, the newest there, by `pmc`; returns the whole answer."""
        follower = max(self.folder.glob("far*.conf"), key=lambda file: file.stat().st_mtime_ns).with_suffix("")
        command = ["pmc", "-u", "-b", "0", "-s", str(follower), "-i", str(self.folder / "pmc"), words]
        done = subprocess.run(["ip", "netns", "exec", self._places["far"], *command], capture_output=True, text=True, timeout=_END)
        return done.stdout

    def close(self) -> None:
        """End what runs there, and take the namespaces away."""
        for one in self._running:
            one.close()
        for place in self._places.values():
            with contextlib.suppress(HandwaveError):
                ip("netns", "delete", place)
        shutil.rmtree(self.folder, ignore_errors=True)


def heard(one: Ptp4l, count: int, longest: float) -> list[Offset]:
    """Wait until a `ptp4l` has told so many offsets; a `HandwaveError` says that it did not within `longest` [s]."""
    end = time.monotonic() + longest
    while len(found := one.offsets()) < count:
        if time.monotonic() > end:
            raise HandwaveError(f"ptp4l told {len(found)} offsets within {longest:g} s: " + "; ".join(one.lines[-3:]))
        time.sleep(0.1)
    return found
