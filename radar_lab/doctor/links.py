"""Whether data arrives: losses, late chirps, and clocks that disagree."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np

from radar_driver.health import HealthConfig
from radar_lab.doctor.evidence import STREAMS, Evidence
from radar_lab.doctor.finding import Finding, unknown
from radar_tracking.fusion.clouds import ClockConfig, ClockMonitor, FusionConfig

LOST: Final = HealthConfig().lost_fail
"""Share of messages from which on losses are a fault: that from which on `handwave probe` calls them a failure."""
APART: Final = FusionConfig().max_clock_offset
"""From where on two radars' clocks disagree [s]: where the fusion node begins to warn."""
_OLD: Final = 1.0
"""How late a frame may come [s]: a driver keeps 20 frames for who is slow (`radar_ros.qos.stream_out`), 1 s of 20 Hz; more is no delay."""
_FEWEST: Final = 20  # messages; fewer say nothing about clocks
_PARTS: Final = 0.8  # of the recording that clocks are compared over: the last part is not over yet
_SET_CLOCKS: Final = "set the clocks of both computers by chrony or PTP (docs/explanation/timing.md)"
_REMEDY: Final = {
    "radar/frame": "give the board a port of its own and the machine larger network buffers (sudo sysctl -w net.core.rmem_max=8388608)",
    "radar/points": "let the baseband keep within the frame interval: --param baseband.frame_budget_ms={budget:.0f}",
    "tracks": "let the tracking keep within the frame interval: --param tracking.frame_budget_ms={budget:.0f}",
}


def drops(evidence: Evidence) -> Finding:
    """Look for the stream that loses the largest share: frames of the device, or what a stage of the graph did not get done."""
    chirps, missing = evidence.health.chirps
    told = [(f"messages to {name}", *counts) for name, counts in evidence.stages.items()]
    known = () if evidence.live and evidence.stages else evidence.arrived.items()
    counted = [(f"messages of {name}", stream.came, stream.lost) for name, stream in known if stream.came]
    shares = [(lost / max(came + lost, 1), lost, came + lost, what) for what, came, lost in (*counted, *told)]
    shares += [(missing / chirps, missing, chirps, "chirps")] if chirps else []
    if not shares:
        return unknown("drops", "nothing came whose numbers could be counted")
    first = next((row for row in shares if row[0] > LOST), None)  # what a stage before lost, the next ones lack too
    share, lost, total, what = first or max(shares, key=lambda row: row[0])
    text = f"{lost} of {total} {what} are lost ({share:.1%}); a fault above {LOST:.0%}"
    budget = 500 * evidence.info.waveform.frame_interval  # half of it [ms]
    stage = what.rpartition(" ")[2]
    node = {"baseband": "radar/points", "tracking": "tracks"}.get(stage, stage if stage in STREAMS else "radar/frame")
    remedy = _REMEDY[node].format(budget=max(budget, 1.0))
    return Finding("drops", share > LOST, share, LOST, "", text, remedy if share > LOST else "")


def clock(evidence: Evidence) -> Finding:
    """Compare a radar's stamps with the clock of whoever recorded: nothing arrives before it was measured, nor much later."""
    times = next((s.times for s in (evidence.arrived[name] for name in STREAMS) if len(s.times) >= _FEWEST), [])
    delay = np.array([arrived - stamp for stamp, arrived in times]) * 1e-9
    if not len(delay) or evidence.simulated_time or np.ptp(delay) == 0:
        why = "too few messages" if not len(delay) else "stamps and arrivals are of the same simulated clock"
        return unknown("clock offset", f"clocks cannot be compared: {why}")
    least = float(delay.min())
    wrong = least < -APART or least > _OLD
    side = "ahead of" if least < 0 else "behind"
    text = (
        f"the radar's stamps are at least {abs(least) * 1e3:.0f} ms {side} the clock of the recorder" if wrong else ""
    ) or f"messages come {least * 1e3:.1f} ms or more after their stamps"
    text += f"; a fault from {APART * 1e3:.0f} ms ahead or {_OLD:.0f} s behind on"
    remedy = f"{_SET_CLOCKS}, then check: chronyc tracking"
    return Finding("clock offset", wrong, least * 1e3, -APART * 1e3, "ms", text, remedy if wrong else "")


def clocks(radars: Sequence[Evidence]) -> list[Finding]:
    """Compare the clocks of several radars by the smallest delays of their messages, as the fusion node does."""
    heard = {e.name: next((s.times for s in map(e.arrived.get, STREAMS) if s and len(s.times) >= _FEWEST), []) for e in radars}
    names = [name for name, times in heard.items() if times]
    if len(names) < 2:
        return []
    arrivals = sorted((arrived, stamp, name) for name in names for stamp, arrived in heard[name])
    span = (arrivals[-1][0] - arrivals[0][0]) * 1e-9
    monitor = ClockMonitor(names, ClockConfig(window=max(_PARTS * span, 0.1)))
    for arrived, stamp, name in arrivals:
        monitor.hear(name, stamp, arrived)
    found = []
    for one in monitor.offsets()[1:]:
        far = abs(one.offset) - one.spread > APART
        text = f"the clock of {one.name} is {one.offset * 1e3:+.1f} ms off that of {one.reference} (to {one.spread * 1e3:.1f} ms)"
        text += f"; a fault above {APART * 1e3:.0f} ms"
        remedy = f"{_SET_CLOCKS}; meanwhile: --param fusion.slop={abs(one.offset) + FusionConfig().slop:.3f}"
        found.append(Finding("clock offset", far, one.offset * 1e3, APART * 1e3, "ms", text, remedy if far else "", one.name))
    return found
