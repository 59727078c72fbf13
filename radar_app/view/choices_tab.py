"""The second tab: accuracy against time, as `handwave tradeoff` measured it, and what a choice changes."""

from __future__ import annotations

import html
import math
from pathlib import Path
from typing import Any, Final

from bokeh.core.properties import value
from bokeh.models import ColumnDataSource, DataRange1d
from bokeh.models.widgets import Div, Select
from bokeh.plotting import figure

from radar_app.view.choices import Choice, default_folder, load_choices, on_front
from radar_app.view.colours import NOBODY
from radar_app.view.feed import Snapshot
from radar_app.view.page import Context
from radar_app.view.style import ACCENT, DOUBTFUL, FAINT, FIELD, FONT, GROUND, TEXT, WIDE, card, grid, plot, stack
from radar_app.view.table_panels import table
from radar_core import HandwaveError

_COLUMNS: Final = ("time", "accuracy", "name", "colour", "line", "size")
_FIRST: Final = "tracker"


class ChoicesTab:
    """See `radar_app.view.page.Tab`.

    Parameters
    ----------
    context : Context
        The browser's page.
    folder : Path or None
        What `handwave tradeoff -o` made; None: what comes with Handwave.
    """

    title = "Accuracy against time"

    def __init__(self, context: Context, folder: Path | None = None) -> None:
        self._said = Div(name="choice_said", sizing_mode="stretch_width")
        self._about = Div(name="choice_about", sizing_mode="stretch_width")
        self._table = Div(name="choice_table", sizing_mode="stretch_width", stylesheets=[WIDE])
        self._source = ColumnDataSource(data={name: [] for name in _COLUMNS}, name="choices")
        self._figure = _plot(self._source)
        self._panels: dict[str, list[Choice]] = {}
        self._shown: list[Choice] = []
        try:
            self._panels = load_choices(folder or default_folder())
        except HandwaveError as error:
            self._said.text = f'<div style="color:{DOUBTFUL};font:14px {FONT}">{html.escape(str(error))}</div>'
        names: Any = list(self._panels)
        first = _FIRST if _FIRST in self._panels else (names[0] if names else "")
        self._which = Select(title="choices of", value=first, options=names, name="choice_panel", width=330, stylesheets=[FIELD])
        self._which.on_change("value", lambda _attr, _old, new: self._show(new))
        self._source.selected.on_change("indices", lambda _attr, _old, new: self._pick(new))
        self.layout = stack(
            grid(
                card("What a choice costs, and what it gives", self._which, self._figure, span=2),
                card("The choice", self._about, self._said),
                columns=3,
            ),
            card("All of them", self._table),
        )
        if names:
            self._show(first)

    def _show(self, panel: str) -> None:
        """Show the choices of one knob, the default picked."""
        self._shown = sorted(self._panels[panel], key=lambda choice: choice.time)
        front = [on_front(choice, self._shown) for choice in self._shown]
        first = self._shown[0]
        self._figure.yaxis.axis_label = f"{first.figure}{f' [{first.unit}]' if first.unit else ''}, {first.better} is better"
        self._source.data = {
            "time": [choice.time for choice in self._shown],
            "accuracy": [choice.accuracy for choice in self._shown],
            "name": [choice.name for choice in self._shown],
            "colour": [ACCENT if good else NOBODY for good in front],
            "line": [DOUBTFUL if choice.default else GROUND for choice in self._shown],
            "size": [17 if choice.default else 12 for choice in self._shown],
        }
        self._table.text = _rows(self._shown, front)
        default = next((k for k, choice in enumerate(self._shown) if choice.default), 0)
        self._source.selected.indices = [default]
        self._pick([default])

    def _pick(self, indices: list[int]) -> None:
        """Tell all about the choice that was clicked."""
        if indices and indices[0] < len(self._shown):
            choice = self._shown[indices[0]]
            default = next((other for other in self._shown if other.default), choice)
            self._about.text = _about(choice, default)

    def update(self, now: Snapshot) -> None:
        """Nothing here depends on the moment."""

    def close(self) -> None:
        """There is nothing to let go of."""


def _plot(source: ColumnDataSource) -> figure:
    made = plot(
        "choices_plot", "time [ms]", "accuracy", x_axis_type="log", height=460, tools="tap,hover",
        tooltips=[("", "@name"), ("accuracy", "@accuracy{0.0000}"), ("time", "@time{0.000} ms")],
        x_range=DataRange1d(range_padding=0.6), y_range=DataRange1d(range_padding=0.15),
    )  # fmt: skip
    made.scatter(
        "time", "accuracy", source=source, size="size", fill_color="colour", line_color="line", line_width=3, nonselection_fill_alpha=0.75,
        nonselection_line_alpha=0.9, selection_line_color=TEXT,
    )  # fmt: skip
    made.text(
        "time", "accuracy", "name", source=source, x_offset=14, y_offset=5, text_color=TEXT, text_font_size="12px", text_font=value(FONT),
        nonselection_text_alpha=0.75,
    )  # fmt: skip
    return made


def _about(choice: Choice, default: Choice) -> str:
    """Say what a choice achieves, costs and changes."""
    unit = f" {choice.unit}" if choice.unit else ""
    lines = [f'<b style="font-size:18px">{html.escape(choice.name)}</b>{" (the default)" if choice.default else ""}']
    chance = f" ± {choice.margin:.2g}" if choice.margin else ""
    lines.append(f"{html.escape(choice.figure)}: <b>{choice.accuracy:.4g}{html.escape(unit)}</b>{chance} ({choice.better} is better)")
    beside = f"{choice.ratio:.3g} times {html.escape(choice.reference)}"
    lines.append(f"time: <b>{choice.time:.3g} ms</b>, 95th percentile {choice.slow:.3g} ms; {beside}")
    if not choice.default and default.time > 0 and math.isfinite(default.time):
        lines.append(f"{choice.time / default.time:.2g} times the time of the default, {html.escape(default.name)}")
    if choice.settings is None:
        lines.append(f'<span style="color:{FAINT}">This is no matter of one parameter; see the page on accuracy and time.</span>')
    elif not choice.settings:
        lines.append(f'<span style="color:{FAINT}">It sets nothing: this is what runs unless it is told otherwise.</span>')
    else:
        words = " ".join(f"--param {name}={value}" for name, value in choice.settings.items())
        lines.append("It sets:")
        lines += [f"<code>{html.escape(name)} = {html.escape(str(value))}</code>" for name, value in choice.settings.items()]
        lines.append(f'<span style="color:{FAINT}">handwave up {html.escape(words)}</span>')
    return "".join(f'<div style="font:14px {FONT};color:{TEXT};margin-bottom:8px;overflow-wrap:anywhere">{line}</div>' for line in lines)


def _rows(choices: list[Choice], front: list[bool]) -> str:
    rows = []
    for choice, good in zip(choices, front, strict=True):
        name = html.escape(choice.name)
        values = (f"{choice.accuracy:.4g}", f"{choice.time:.3g}", f"{choice.slow:.3g}", f"{choice.ratio:.3g}")
        rows.append([f"<b>{name}</b>" if choice.default else name, *values, "no other beats it in both" if good else ""])
    first = choices[0]
    figure_name = f"{first.figure}{f' [{first.unit}]' if first.unit else ''}"
    return table(("choice", html.escape(figure_name), "time [ms]", "95 % within [ms]", "of reference", ""), rows, "")
