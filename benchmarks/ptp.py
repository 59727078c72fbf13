"""The clocks of two computers: what PTP gives over a link, what the fusion node tells of clocks that are apart, and both at once.

Two radars, the fusion node and whoever listens are processes of their own over real DDS. The second computer's clock is a `MovedClock`: its
radar reads it, and `ptp4l` in a network namespace of its own steers it. What it really is ahead is known at every moment.
"""

from __future__ import annotations

import contextlib
import os
import tempfile
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Any, Final

import handwave.msg
import numpy as np
from diagnostic_msgs.msg import DiagnosticArray
from numpy.typing import NDArray

from benchmarks.moved_clock import MovedClock
from benchmarks.ptp_link import SETTINGS, Link, Offset, heard
from benchmarks.report import AbsentError
from radar_app.graph import NodeSpec
from radar_app.supervisor import Supervisor, environment
from radar_core import HandwaveError
from radar_ros import qos
from radar_ros.interrupts import Visitor, ros
from radar_tracking.fusion.clouds import FusionConfig

DOMAIN: Final = 150 + (os.getpid() + 40) % 80
SHIFTS: Final = (0.0, 0.002, 0.02, -0.02, 0.08, 0.7)
"""How far the clock of the right radar is ahead [s]: about the limit, a frame, more than `slop`, more than `solo_after`."""
QUICK: Final[Mapping[str, Any]] = {"clocks.window": 1.0, "clocks.parts": 2, "clocks.least": 2}
"""Settings of the fusion node with which it tells offsets after two seconds."""
_AHEAD, _DRIFT = 0.02, 30.0  # s, ppm: the clock that PTP sets right; crystals are good for 20 to 50 ppm
_LONGEST: Final = 60.0  # s
_LOOK: Final = 0.05  # s


@dataclass(frozen=True)
class Reading:
    """What the fusion node told in one of its diagnostics: when (CLOCK_MONOTONIC [s]), offset [s], its spread [s], the message."""

    at: float
    offset: float
    spread: float
    text: str

    @property
    def warned(self) -> bool:
        """Whether it said that the clocks are apart."""
        return "the clock of right is" in self.text


class Computers:
    """Two computers with a radar each, the second one's clock apart; the fusion node runs on the first."""

    def __init__(self, clock: MovedClock, parameters: Mapping[str, Any], domain: int = DOMAIN) -> None:
        self.clock, self.lines = clock, list[str]()
        self.readings: list[Reading] = []
        self.truth: list[tuple[float, float]] = []  # on CLOCK_MONOTONIC [s], how far the clock is ahead [s]
        self.fused: list[tuple[float, int, int]] = []  # when, how many radars, how many frames apart
        self._held = contextlib.ExitStack()
        self._parameters, self._domain = parameters, domain

    def __enter__(self) -> Computers:
        os.environ.update(environment(self._domain))
        left, right = (NodeSpec("radar", "benchmarks.ptp_radar", namespace=name, place=name) for name in ("left", "right"))
        fusion = NodeSpec("fusion", "radar_ros.nodes.fusion", self._parameters)
        with contextlib.ExitStack() as held:
            held.enter_context(ros())
            self._visitor = Visitor("handwave_ptp")
            held.callback(self._visitor.close)
            self._visitor.node.create_subscription(DiagnosticArray, "/diagnostics", self._diagnosed, 50)
            self._visitor.node.create_subscription(handwave.msg.PointCloud, "radar/points", self._fused, qos.sensor(depth=50))
            with self.clock.here():
                held.enter_context(Supervisor((right,), domain=self._domain, log=self._log))
            held.enter_context(Supervisor((left, fusion), domain=self._domain, log=self._log))
            self._held = held.pop_all()
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
        self._held.close()

    def _log(self, name: str, line: str) -> None:
        self.lines.append(f"{name}: {line}")

    def _diagnosed(self, msg: Any) -> None:
        for status in msg.status:
            if status.name == "fusion: processing":
                told = {value.key: value.value for value in status.values}
                if "unknown" not in (offset := told["right.clock_offset_ms"]):
                    spread = float(told["right.clock_spread_ms"])
                    self.readings.append(Reading(time.monotonic(), float(offset) * 1e-3, spread * 1e-3, status.message))

    def _fused(self, msg: Any) -> None:
        frames = [source.sequence for source in msg.sources]
        self.fused.append((time.monotonic(), len(frames), max(frames) - min(frames)))

    def live(self, seconds: float, until: Callable[[], bool] = lambda: False) -> bool:
        """Listen for so long, or until something is so; returns whether it is."""
        end = time.monotonic() + seconds
        while not until():
            if time.monotonic() > end:
                return False
            self.truth.append((time.monotonic(), self.clock.ahead()))
            self._visitor.spin(_LOOK)
        return True

    def told(self, count: int) -> list[Reading]:
        """Wait for so many further readings; a `HandwaveError` says that the fusion node tells none."""
        first = len(self.readings)
        if not self.live(_LONGEST, lambda: len(self.readings) >= first + count):
            raise HandwaveError("the fusion node told no clock offset: " + "; ".join(self.lines[-3:]))
        return self.readings[first:]

    def at(self, times: list[float]) -> NDArray[np.float64]:
        """How far the clock was ahead at those times [s]."""
        known, ahead = np.array(self.truth).T
        return np.asarray(np.interp(times, known, ahead), np.float64)


def fused(shift: float, parameters: Mapping[str, Any], count: int, domain: int = DOMAIN) -> dict[str, Any]:
    """Let the right radar's clock be so far ahead [s]: what the fusion node tells, and what it fuses, of so many diagnostics."""
    with tempfile.TemporaryDirectory() as folder, Computers(MovedClock(Path(folder), shift), parameters, domain) as both:
        both.told(1)
        since = time.monotonic()
        readings = both.told(count)
        clouds = [one for one in both.fused if one[0] >= since]
    errors = [1e3 * abs(one.offset - shift) for one in readings]
    return {
        "truth_ms": 1e3 * shift,
        "told_ms": 1e3 * float(np.median([one.offset for one in readings])),
        "error_ms_median": float(np.median(errors)),
        "error_ms_worst": max(errors),
        "spread_ms": 1e3 * float(np.median([one.spread for one in readings])),
        "warned": sum(one.warned for one in readings),
        "diagnostics": len(readings),
        "fused": len(clouds),
        "of_one_radar": sum(radars < 2 for _, radars, _ in clouds),
        "of_different_frames": sum(apart > 0 for *_, apart in clouds),
        "frames_apart": max((apart for *_, apart in clouds), default=0),
        "message": readings[-1].text,
    }


def link(count: int) -> dict[str, Any]:
    """Measure the link: `ptp4l` at both ends of one clock, so that every offset that it tells is its error."""
    with Link() as cable:
        cable.start("near")
        follower = cable.start("far")
        offsets = heard(follower, count, _LONGEST + count)[:count]
        answer = cable.ask("GET TIME_STATUS_NP")
    errors = [1e6 * abs(one.offset) for one in offsets]
    return {
        "ptp_offset_us_median": float(np.median(errors)),
        "ptp_offset_us_p95": float(np.percentile(errors, 95)),
        "ptp_offset_us_worst": max(errors),
        "ptp_delay_us_median": 1e6 * float(np.median([one.delay for one in offsets])),
        "ptp_offsets": len(offsets),
        "pmc_answers": "gmPresent                  true" in answer,
    }


def steered(parameters: Mapping[str, Any], count: int, domain: int = DOMAIN) -> dict[str, Any]:
    """Start `ptp4l` where a clock is apart and drifts: both offsets beside the truth before it acts, and so many seconds of them after."""
    with (
        tempfile.TemporaryDirectory() as folder,
        Link() as cable,
        Computers(MovedClock(Path(folder), _AHEAD, _DRIFT), parameters, domain) as both,
    ):
        cable.start("near")
        first = both.told(1)[0]
        began = time.monotonic()
        follower = cable.start("far", steers=True, variables=both.clock.variables)
        if not both.live(_LONGEST, lambda: any(one.state == 2 for one in follower.offsets())):
            raise HandwaveError("ptp4l did not lock: " + "; ".join(follower.lines[-3:]))
        locked = time.monotonic()
        both.live(_LONGEST, lambda: bool(both.readings) and both.readings[-1].at > locked and not both.readings[-1].warned)
        quiet = time.monotonic()
        both.live(2 * (parameters.get("clocks.window") or FusionConfig().clocks.window))
        both.told(count)
    return {
        "steered_first_told_ms": 1e3 * first.offset,
        "steered_locked_after_s": locked - began,
        "steered_quiet_after_s": quiet - locked,
        **_compared("before", both, [one for one in follower.offsets() if one.state == 0 and one.at < locked]),
        **_compared("after", both, follower.offsets(both.readings[-count].at)),
    }


def _compared(when: str, both: Computers, offsets: list[Offset]) -> dict[str, Any]:
    """Put what ptp4l and the fusion node told meanwhile beside the truth; ptp4l's own time is CLOCK_MONOTONIC, as that of the truth."""
    span = (offsets[0].at, offsets[-1].at)
    readings = [one for one in both.readings if span[0] <= one.at <= span[1]]
    truth = both.at([one.at for one in offsets])
    errors = 1e6 * np.abs(np.array([one.offset for one in offsets]) - truth)
    fusion = 1e3 * np.abs(np.array([one.offset for one in readings]) - both.at([one.at for one in readings]))
    return {
        f"{when}_seconds": span[1] - span[0],
        f"{when}_truth_ms_median": 1e3 * float(np.median(truth)),
        f"{when}_truth_us_p95": 1e6 * float(np.percentile(np.abs(truth), 95)),
        f"{when}_ptp_error_us_p95": float(np.percentile(errors, 95)),
        f"{when}_ptp_told_us_p95": 1e6 * float(np.percentile(np.abs([one.offset for one in offsets]), 95)),
        f"{when}_ptp_offsets": len(offsets),
        f"{when}_fusion_error_ms_median": float(np.median(fusion)),
        f"{when}_fusion_error_ms_worst": float(np.max(fusion)),
        f"{when}_fusion_told_ms_median": 1e3 * float(np.median([one.offset for one in readings])),
        f"{when}_fusion_readings": len(readings),
        f"{when}_warned": sum(one.warned for one in readings),
    }


def run(quick: bool) -> dict[str, Any]:
    """Measure the fusion node, and PTP where linuxptp and network namespaces are."""
    parameters: Mapping[str, Any] = QUICK if quick else {}
    rows = [fused(shift, parameters, 2 if quick else 10) for shift in (SHIFTS[:4:2] if quick else SHIFTS)]
    limit = 1e3 * FusionConfig().max_clock_offset
    apart = [row for row in rows if abs(row["truth_ms"]) > limit]
    together = [row for row in rows if abs(row["truth_ms"]) < limit]
    result: dict[str, Any] = {
        "fusion_offset_error_ms": max(row["error_ms_worst"] for row in rows),
        "fusion_offset_error_ms_median": float(np.median([row["error_ms_median"] for row in rows])),
        "limit_ms": limit,
        "warned_when_apart": sum(row["warned"] for row in apart),
        "diagnostics_when_apart": sum(row["diagnostics"] for row in apart),
        "warned_when_together": sum(row["warned"] for row in together),
        "diagnostics_when_together": sum(row["diagnostics"] for row in together),
        "shifts": rows,
    }
    try:
        result |= {"available": True, **link(5 if quick else 60)}
        result |= {} if quick else steered(parameters, 10)
    except AbsentError as error:
        result |= {"available": False, "unavailable_because": str(error)}
    return {**result, "ptp_settings": dict(SETTINGS), "choices": []}
