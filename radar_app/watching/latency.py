"""How long results take, from the publication of a radar's frame to what a stage made of it; also where several radars are fused."""

from __future__ import annotations

from bisect import bisect_left
from collections import defaultdict
from collections.abc import Iterable, Mapping, Sequence
from typing import Final, NamedTuple

from radar_app.watching.reports import StageReport

_APART_NS: Final = 30_000_000  # a cloud whose stamp is farther from that of the fused one is no part of it


class Latency(NamedTuple):
    """How long one result took."""

    stamp_ns: int  # of the result
    late_ns: int  # from the publication of the frame on CLOCK_MONOTONIC


def latencies(reports: Iterable[StageReport]) -> dict[str, list[Latency]]:
    """Say how long the results of every stage took, in the order of the reports.

    A frame and what is made of it have one sequence. Fused clouds are counted anew: what they were made of is, of every radar, the cloud
    that is nearest in time, and their latency counts from the frame that was published first.
    """
    good = [report for report in reports if not report.stale]
    sent = {(_place(report), report.sequence): report.monotonic_ns for report in good if _name(report) == "driver"}
    radars = {place for place, _ in sent}
    clouds = _clouds(good, sent)
    found: dict[str, list[Latency]] = defaultdict(list)
    for report in good:
        place = _place(report)
        if place in radars:
            began = sent.get((place, report.sequence))
        else:
            began = _first(report.stamp_ns, [clouds[each] for each in radars if each.startswith(f"{place}/" if place else "")])
        if began is not None and report.monotonic_ns >= began:
            found[report.stage].append(Latency(report.stamp_ns, report.monotonic_ns - began))
    return dict(found)


def _place(report: StageReport) -> str:
    return report.stage.rpartition("/")[0]


def _name(report: StageReport) -> str:
    return report.stage.rpartition("/")[2]


def _clouds(reports: Sequence[StageReport], sent: Mapping[tuple[str, int], int]) -> dict[str, list[tuple[int, int]]]:
    """List the stamps of every radar's clouds, with when their frames were published; of a radar that gives clouds, its own."""
    made: dict[tuple[str, str], list[tuple[int, int]]] = defaultdict(list)
    for report in reports:
        key = _place(report), report.sequence
        if key in sent:
            made[key[0], _name(report)].append((report.stamp_ns, sent[key]))
    return {place: sorted(made.get((place, "baseband"), made[place, "driver"])) for place in {place for place, _ in sent}}


def _first(stamp_ns: int, radars: Iterable[Sequence[tuple[int, int]]]) -> int | None:
    """When the first of the frames behind a fused result was published; None: not known."""
    began = []
    for clouds in radars:
        at = bisect_left(clouds, (stamp_ns, 0))
        near = min(clouds[max(at - 1, 0) : at + 1], key=lambda cloud: abs(cloud[0] - stamp_ns), default=None)
        if near is not None and abs(near[0] - stamp_ns) <= _APART_NS:
            began.append(near[1])
    return min(began, default=None)
