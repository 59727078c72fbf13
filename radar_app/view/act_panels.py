"""What people do: gestures with their probabilities, and the control value of a hand."""

from __future__ import annotations

import html
from collections.abc import Mapping
from typing import Any, Final

import numpy as np
from bokeh.models import FactorRange, Range1d

from radar_app.view.colours import NOBODY, colour
from radar_app.view.feed import Snapshot
from radar_app.view.pictures import Pictures
from radar_app.view.style import ACCENT, FAINT, FONT, LINE, TEXT, plot
from radar_gestures.gesture import Gesture

_SHOWN: Final = 6  # gestures in the list
_TRACE: Final = 10.0  # s: of the control value


class GesturePanel:
    """The last gestures as a list, and how probable each label was for the last of them."""

    def __init__(self, pictures: Pictures) -> None:
        self._pictures = pictures
        self.list = pictures.div("gestures", min_height=126)
        self._labels = FactorRange(factors=[])
        self._source = pictures.source("probabilities", {"label": [], "probability": [], "colour": []})
        self.figure = plot(
            "probabilities_plot", "probability", "", y_range=self._labels, x_range=Range1d(start=0, end=1.02), height=230, tools=""
        )
        self.figure.hbar(y="label", right="probability", height=0.7, source=self._source, fill_color="colour", line_color=None)
        self.figure.ygrid.grid_line_color = None
        self._shown: tuple[int, ...] = (-1,)

    def update(self, now: Snapshot) -> None:
        """Show the gestures up to a moment."""
        found = [entry for entry in now.past("gestures") if entry.value.label][-_SHOWN:]
        latest = now.last("gestures")
        ago = [int((now.stamp_ns - entry.stamp_ns) * 1e-9) for entry in found]
        shown = (latest.stamp_ns if latest is not None else 0, *(entry.number for entry in found), *ago)
        if shown == self._shown:
            return
        self._shown = shown
        self._pictures.write(self.list, _list([entry.value for entry in found], ago, now.history.colours))
        if latest is not None:
            self._show(latest, now.history.colours)
        else:
            self._pictures.put(self._source, {"label": [], "probability": [], "colour": []})

    def _show(self, gesture: Gesture, colours: Mapping[int, int]) -> None:
        names = [label.replace("_", " ") for label in gesture.labels]
        if len(names) != len(gesture.probabilities):
            return
        if self._labels.factors != names[::-1]:
            self._labels.factors = names[::-1]
        shades = [colour(colours, gesture.track_id) if k == gesture.label else NOBODY for k in range(len(names))]
        self._pictures.put(self._source, {"label": names, "probability": gesture.probabilities.tolist(), "colour": shades})


def _list(gestures: list[Gesture], ago: list[int], colours: Mapping[int, int]) -> str:
    """Write the last gestures down, the newest on top."""
    if not gestures:
        return f'<div style="color:{FAINT};font:14px {FONT}">none yet: push, pull, swipe, wave, or rotate an arm</div>'
    rows = []
    for number, (gesture, seconds) in enumerate(zip(reversed(gestures), reversed(ago), strict=True)):
        size = "19px" if number == 0 else "14px"
        zones = f" in {html.escape(', '.join(gesture.zones))}" if gesture.zones else ""
        rows.append(
            f'<div style="display:flex;gap:10px;align-items:baseline;font:{size} {FONT};color:{TEXT};opacity:{1 - 0.11 * number:.2f}">'
            f'<span style="color:{colour(colours, gesture.track_id)}">●</span>'
            f"<b>{html.escape(gesture.name.replace('_', ' '))}</b> {gesture.confidence:.0%}"
            f'<span style="color:{FAINT};font-size:13px">person {gesture.track_id}{zones}, {seconds} s ago</span></div>'
        )
    return "".join(rows)


class ControlPanel:
    """The control value of the hand that is followed, now and in the last ten seconds."""

    def __init__(self, pictures: Pictures) -> None:
        self._pictures = pictures
        self.gauge = pictures.div("control", height=46)
        self._source = pictures.source("control_trace", {"t": [], "value": []})
        self.figure = plot(
            "control_plot", "time [s]", "value", x_range=Range1d(start=-_TRACE, end=0), y_range=Range1d(start=-0.02, end=1.02), height=110,
            tools="",
        )  # fmt: skip
        self.figure.line("t", "value", source=self._source, line_color=ACCENT, line_width=2, level="overlay")
        self._empty = False

    def update(self, now: Snapshot) -> None:
        """Show the value of a moment."""
        hand = now.hand
        text = _gauge(hand.value if hand is not None else None)
        self._pictures.write(self.gauge, text)
        trace = now.past("hand", _TRACE)
        if trace or not self._empty:
            self._pictures.put(self._source, _trace(trace, now.stamp_ns))
        self._empty = not trace


def _trace(entries: Any, now_ns: int) -> dict[str, Any]:
    """Values over time; a hand that was let go of leaves a gap."""
    times = np.array([entry.stamp_ns - now_ns for entry in entries], np.int64) * 1e-9
    return {"t": times, "value": np.array([entry.value.value if entry.value.active else np.nan for entry in entries])}


def _gauge(value: float | None) -> str:
    if value is None:
        return f'<div style="color:{FAINT};font:14px {FONT}">no hand is followed; rotate an arm to start (unless set otherwise)</div>'
    return (
        f'<div style="font:22px {FONT};font-weight:700;color:{TEXT}">{value:.2f}</div>'
        f'<div style="background:{LINE};border-radius:6px;height:12px"><div style="background:{ACCENT};border-radius:6px;height:12px;'
        f'width:{100 * min(max(value, 0), 1):.1f}%"></div></div>'
    )
