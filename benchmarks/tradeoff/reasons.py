"""Why a default is what it is where another choice is better by the figures of its panel."""

from __future__ import annotations

from typing import Final

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
        "On people who stay apart trackers hardly differ; where two meet the default keeps identities that the others "
        "swap (docs/tracking.md)."
    ),
    "estimator": "The linear filter costs least and needs no range rate; what the others gain is one or two centimetres.",
    "clustering within the tracker": (
        "On points of one person's gate the methods give nearly the same clusters; DBSCAN has no grid whose cells could split a body."
    ),
    "frame rate": "People are followed as well at a lower rate; fewer gestures are found and recognised (docs/gestures.md).",
    "number of transmitters": (
        "People are followed as well with one transmitter; with both, bounds of the azimuth are a third (0.20 instead of 0.58 degrees at "
        "20 dB), which the hand and people beside each other need."
    ),
    "number of radars": "One radar is what most rooms have; a second one is the user's to buy.",
    "hand filter": ("Only mm_vel_est takes the velocities that two radars measure; in a short scene with a slow hand that gains little."),
    "feature source": (
        "On 1,500 strokes of ten simulated people 50 Hz and both transmitters recognise most, and people beside each other are told "
        "apart by the default's angles and medians (docs/gestures.md); these strokes are far fewer."
    ),
    "classifier": "A smaller or larger network changes microseconds of an event, not of a frame; see docs/gestures.md for its accuracy.",
    "levels of the baseband": (
        "People are followed as well at a lower rate, which this figure is about; gestures are not. Two echoes in a cell: see the panel "
        "of the DoA method."
    ),
    "levels of the tracking": (
        "People are followed as well at a lower rate; gestures and the hand are not. What the group tracker saves it pays for where "
        "people meet (docs/tracking.md)."
    ),
    "processes": (
        "A process of its own for every node keeps the others alive when one dies, and uses all cores; composed is for "
        "small machines. The library gives the same results where no graph is wanted."
    ),
    "whole chain": "The default is for one person and for several; presets gain or save on one of them.",
}
"""Panel to reason; it is shown only where the figures call for one."""
