"""The report: every choice of every stage, which are worth their time, and why the defaults are what they are."""

from __future__ import annotations

import os
import platform
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any, Final

from benchmarks.plot import markdown
from benchmarks.report import Row, beaten_by, kept, panels
from benchmarks.tradeoff.stages import STAGES, Stage

REASONS: Final[dict[str, str]] = {
    "simulator fidelity": (
        "auto looks at every frame's echoes before it chooses, which a fixed model saves; one that is quicker on this frame is too "
        "slow for a crowd, or wrong for fast people."
    ),
    "sample type": "complex64 is what boards give, and half the memory.",
    "FFT back end and word length": (
        "fftw is an extra: its licence is the GPL's, it plans at its first start, and its last digits differ from "
        "machine to machine; scipy is there anyway. Install handwave[fftw] and set spectrum.fft where the time counts."
    ),
    "CFAR, a weak echo alone": (
        "In noise alone averages do as well or better than an ordered statistic. A room is never noise alone: the panel "
        "of an echo beside a strong one shows what averages lose there."
    ),
    "CFAR, a weak echo beside a strong one": (
        "so (smaller of) is as good beside one strong echo, but where clutter begins its threshold is that of the "
        "quieter side, and false alarms stand along the edge."
    ),
    "detections kept": "The cap bounds the time of frames that are full of interference; usual frames never reach it.",
    "grouping of cells": (
        "One point for every speed at which a body moves is what gestures are read from; fewer lose the arm, more tell the same echo again."
    ),
    "DoA grid and refinement": "StudyConfig beside the default differ by less than errors of a real array's calibration.",
    "DoA method, two echoes in one cell": (
        "One direction is enough for one person, and among mirroring walls the second is a reflection more often than "
        "somebody; for people beside each other take the preset people."
    ),
    "refinement of range, speed and direction": "Unrefined points are far better than bodies are wide.",
    "clustering": "On clouds of the size of a frame's DBSCAN is the simplest that has no number of clusters to guess.",
    "tracker": (
        "In these scenes, without walls and furniture, the thesis's trackers find people sooner, who stand still at first, and are nearer "
        "to the truth. In random rooms they count furniture, fans and reflections (docs/research/tracking.md)."
    ),
    "estimator": (
        "Of the thesis's trackers. The linear filter costs least and needs no range rate; what the others gain is one or two centimetres."
    ),
    "clustering within the tracker": (
        "Of the thesis's trackers. On points of one person's gate the methods give nearly the same clusters; DBSCAN has no grid whose "
        "cells could split a body."
    ),
    "frame rate": "People are followed as well at a lower rate; fewer gestures are found and recognised (docs/explanation/gestures.md).",
    "number of transmitters": (
        "People are followed as well with one transmitter; with both, bounds of the azimuth are a third (0.20 instead of 0.58 degrees at "
        "20 dB), which the hand and people beside each other need."
    ),
    "number of radars": "One radar is what most rooms have; a second one is the user's to buy.",
    "hand filter": ("Only mm_vel_est takes the velocities that two radars measure; in a short scene with a slow hand that gains little."),
    "feature source": (
        "On 1,500 strokes of ten simulated people 50 Hz and both transmitters recognise most, and people beside each other are told "
        "apart by the default's angles and medians (docs/explanation/gestures.md); these strokes are far fewer."
    ),
    "classifier": "A smaller or larger network changes microseconds of an event, not of a frame; accuracy: docs/explanation/gestures.md.",
    "levels of the baseband": (
        "People are followed as well at a lower rate, which this figure is about; gestures are not. Two echoes in a cell: see the panel "
        "of the DoA method."
    ),
    "levels of the tracking": ("People are followed as well at a lower rate; gestures and the hand are not."),
    "processes": (
        "A process of its own for every node keeps the others alive when one dies, and uses all cores; composed is for "
        "small machines. The library gives the same results where no graph is wanted."
    ),
    "whole chain": "The default is for one person and for several; presets gain or save on one of them.",
}
"""Panel to reason; it is shown only where the figures call for one."""


NO_REASON: Final = "**no reason is given**"
_HEAD: Final = """# Accuracy against time

Made by `{command}` on {machine}. Every table is one knob: what each choice achieves, what it takes,
and how that compares with a bare reference measured in the same run, in turn with it. Times are medians, with the 95th percentile in
brackets; one thread. A choice on the front (●) is one that no other beats in both time and accuracy; the others are grey in the pictures.
The default is in bold.

A default counts as beaten when another choice is no worse in both, and clearly better in one: quicker by more than a tenth, or more
accurate by more than ±, two standard errors of the figure (of GOSPA: of its difference from the default's on the same seconds). Where the
frame rate is a choice, and for the whole chain, times are those that one second of radar takes. Figures in this page are of
{amount}.
{notes}
"""


@dataclass(frozen=True)
class Verdict:
    """Whether a panel's default is worth its time."""

    panel: str
    default: str
    text: str  # the verdict in words
    unexplained: bool = False  # it is clearly beaten, and nobody has said why it is the default


def verdicts(rows: Sequence[Row]) -> Iterator[Verdict]:
    """Judge the default of every panel that has one."""
    for name, own in panels(rows):
        for row, on_front in zip(own, kept(own), strict=True):
            if not row["default"]:
                continue
            beaten = beaten_by(row, own)
            if on_front:
                yield Verdict(name, row["choice"], "on the front")
            elif not beaten:
                yield Verdict(name, row["choice"], "as good as on the front: what is better is so by chance, or by less than a tenth")
            else:
                reason = REASONS.get(name, "").strip()
                others = "; ".join(other["choice"] for other in beaten)  # names hold commas
                yield Verdict(name, row["choice"], f"not on the front ({others}). {reason or NO_REASON}", not reason)


def report(results: Sequence[dict[str, Any]], *, command: str, quick: bool, factor: float, pictures: str = "", note: str = "") -> str:
    """Write the report of the stages' results for a command; ``quick``: small amounts; ``factor``: what times were multiplied by.

    ``pictures``: their folder as seen from the report, with a slash at its end; ``note``: one more sentence at the head.
    """
    amount = "a quick run: few scenes and repetitions, to see that it runs, not for quoting" if quick else "a full run"
    notes = [note] if note else []
    if factor != 1.0:
        notes.append(f"All times are multiplied by {factor:g}: those of a device so much slower than the machine that was measured.")
    head = _HEAD.format(command=command, machine=machine(), amount=amount, notes="\n" + "\n\n".join(notes) + "\n" if notes else "")
    rows = [row for result in results for row in result["rows"]]
    told = [(found.panel, found.default, found.text) for found in verdicts(rows)]
    parts = [head.rstrip(), "", "## The defaults", "", *markdown(("knob", "default", ""), told), ""]
    for result in results:
        parts += _section(STAGES[result["stage"]], result, pictures)
    return "\n".join(parts).rstrip() + "\n"


def machine() -> str:
    """Describe what was measured on, without its name."""
    return f"{platform.system()} {platform.machine()}, {os.cpu_count()} cores, Python {platform.python_version()}"


def _section(stage: Stage, result: dict[str, Any], pictures: str) -> list[str]:
    lines = [f"## {stage.title}", ""]
    for name, own in panels(result["rows"]):
        figure = own[0]["accuracy"]
        unit = f" [{figure['unit']}]" if figure["unit"] else ""
        lines += [
            f"### {name[0].upper()}{name[1:]}",
            "",
            f"Accuracy: {figure['name']}, {own[0]['better']} is better. The reference is {own[0]['reference']}.",
            "",
            *markdown(
                ("", "choice", f"{figure['name']}{unit}", "±", "time [ms]", "x reference"),
                (_cells(row, bool(on_front)) for row, on_front in zip(own, kept(own), strict=True)),
            ),
            "",
        ]
    lines += [f"Left out: {one['choice']} ({one['stage']}): {one['why']}." for one in result["left_out"]]
    lines += [""] if result["left_out"] else []
    if result["rows"]:
        lines += [f"![{stage.title}]({pictures}{stage.name}.png)", ""]
    return lines


def _cells(row: Row, on_front: bool) -> tuple[str, ...]:
    name = f"**{row['choice']}**" if row["default"] else row["choice"]
    median, p95, margin = row["time_ms"]["median"], row["time_ms"]["p95"], f"{row['margin']:.2g}" if row["margin"] else ""
    return ("●" if on_front else "", name, f"{row['accuracy']['value']:.4g}", margin, f"{median:.3g} ({p95:.3g})", f"{row['ratio']:.3g}")
