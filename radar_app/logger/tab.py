"""The logger's tab: the maps of the event that waits longest, and what it was, by mouse or by keyboard alone."""

from __future__ import annotations

import html
from typing import Any, Final

from bokeh.layouts import column, row
from bokeh.models import ColumnDataSource, CustomJS, Range1d
from bokeh.models.ui import UIElement
from bokeh.models.widgets import Button, Div, TextInput

from radar_app.logger.event import LoggedEvent
from radar_app.logger.logger import Logger, LoggerState
from radar_app.view.feed import Snapshot
from radar_app.view.map_panels import MapFigures
from radar_app.view.page import Context
from radar_app.view.style import BAD, BUTTON, FAINT, FIELD, FONT, GOOD, TEXT, card, grid
from radar_core import GESTURES

DISCARD, UNDO, TYPE = "x", "u", "t"
"""Keys that discard the event, take the last decision back, and go to the field for a new name."""
OWN_KEYS: Final = "abcdefghijklmnopqrsvwyz"
"""Keys of gestures of one's own, in their order; the ten have the digits of their numbers."""
_LOOK_MS: Final = 100

# What the operator does is sent along with the number of the event that was on the screen: when another one comes up in that moment, the
# label does not go to the wrong one.
_SEND: Final = "sent.data = {key: [key], event: [shown.data.event[0]], count: [sent.data.count[0] + 1]}"
_BUTTON: Final = f"const key = button.tags[0]; {_SEND}"
_NAME: Final = f"""
const key = "=" + field.value_input
Bokeh.index.find_one(field).input_el.blur()  // so that the next key is a label again
if (key != "=") {{ {_SEND} }}
field.value = field.value_input = ""
"""
_KEYS: Final = f"""
document.addEventListener("keydown", (event) => {{
  const tabs = [...root.document._all_models.values()].find((model) => model.type == "Tabs")
  if (tabs != null && tabs.tabs[tabs.active].child.id != root.id) return
  const origin = event.composedPath()[0]
  if (["INPUT", "TEXTAREA", "SELECT"].includes(origin.tagName)) {{
    if (event.key == "Escape") origin.blur()
    return
  }}
  if (event.ctrlKey || event.altKey || event.metaKey || event.repeat) return
  const key = event.key.toLowerCase()
  if (key == "{TYPE}") {{
    event.preventDefault()
    Bokeh.index.find_one(field).input_el.focus()
  }} else if (key.length == 1 && /[a-z0-9]/.test(key)) {{ {_SEND} }}
}})
"""


class LoggerTab:
    """Shows what waits for a label, and takes it.

    Parameters
    ----------
    context : Context
        The browser's page.
    logger : Logger
        Keeps events and labels; the same for all browsers.
    """

    title = "Log"

    def __init__(self, context: Context, logger: Logger) -> None:
        self._logger, self._document = logger, context.document
        self._version = -1
        self._labels: tuple[str, ...] = ()
        self._shown = ColumnDataSource(data={"event": [-1]}, name="logger_event")
        self._sent = ColumnDataSource(data={"key": [""], "event": [-1], "count": [0]}, name="logger_sent")
        self._sent.on_change("data", self._take)
        self._args: dict[str, Any] = {"shown": self._shown, "sent": self._sent}
        self._about = Div(name="logger_about", sizing_mode="stretch_width")
        self._said = Div(name="logger_said", sizing_mode="stretch_width")
        self._across = Range1d(start=-0.1, end=1.0)
        self._maps = MapFigures("logger_", self._across)
        self._buttons = row(name="logger_buttons", sizing_mode="stretch_width", stylesheets=[_WRAP])
        self._field = TextInput(placeholder=f"{TYPE}: a new name, then Enter", name="logger_name", width=220, stylesheets=[FIELD])
        self._field.js_on_event("value_submit", CustomJS(args={**self._args, "field": self._field}, code=_NAME))
        deciding = row(
            self._button(f"{DISCARD}  discard", DISCARD), self._button(f"{UNDO}  undo", UNDO), self._field, stylesheets=[_WRAP]
        )  # fmt: skip
        self.layout: UIElement = column(
            card("what was it?", self._about, self._buttons, deciding, self._said),
            grid(*map(card, ("micro-Doppler", "azimuth", "elevation"), self._maps.figures), columns=3),
            sizing_mode="stretch_width", name="logger", stylesheets=[_GAP],
        )  # fmt: skip
        self._document.js_on_event("document_ready", CustomJS(args={**self._args, "root": self.layout, "field": self._field}, code=_KEYS))
        for source in (self._shown, self._sent):
            self._document.add_root(source)
        self._periodic = self._document.add_periodic_callback(self._show, _LOOK_MS)
        self._show()

    def _button(self, label: str, key: str) -> Button:
        made = Button(label=label, tags=[key], name=f"logger_key_{key}", stylesheets=[BUTTON])
        made.js_on_event("button_click", CustomJS(args={**self._args, "button": made}, code=_BUTTON))
        return made

    def update(self, now: Snapshot) -> None:
        """Show what waits, whatever moment the page shows."""
        self._show()

    def _take(self, _attr: str, _old: Any, new: Any) -> None:
        """Do what a key, a button or the field says."""
        key, number = str(new["key"][0]), int(new["event"][0])
        if key == UNDO:
            self._logger.undo()
        elif number < 0:
            return
        elif key == DISCARD:
            self._logger.discard(number)
        elif key.startswith("="):
            self._logger.label(number, key.removeprefix("=").strip())
        elif key in (keys := dict(keys_of(self._labels))):
            self._logger.label(number, keys[key])

    def _show(self) -> None:
        """Bring the tab up to date, if there is something new."""
        state = self._logger.state
        if state.version == self._version:
            return
        self._version = state.version
        if state.labels != self._labels:
            self._labels = state.labels
            self._buttons.children = [self._button(f"{key}  {name.replace('_', ' ')}", key) for key, name in keys_of(state.labels)]
        number = state.waiting[0] if state.waiting else -1
        if self._shown.data["event"][0] != number:
            if state.current is None:
                self._maps.clear()
            else:
                self._show_maps(state.current)
            self._shown.data = {"event": [number]}
        self._about.text = _about(state, self._logger.store.subject)
        self._said.text = _said(state)

    def _show_maps(self, event: LoggedEvent) -> None:
        first, last = ((int(event.maps.stamp_ns[k]) - event.start_ns) * 1e-9 for k in (0, -1))
        self._across.update(start=first, end=max(last, first + 0.1))
        self._maps.show(event.maps, event.start_ns)

    def close(self) -> None:
        """Look no more: the browser has left. The logger goes on."""
        self._document.remove_periodic_callback(self._periodic)


_GAP: Final = ":host { gap: 12px; }"
_WRAP: Final = ":host { flex-wrap: wrap; gap: 8px; align-items: center; }"


def keys_of(labels: tuple[str, ...]) -> list[tuple[str, str]]:
    """Give every label its key: the ten their numbers, those of one's own letters, as far as there are some; the others are typed."""
    own = [name for name in labels if name not in GESTURES]
    return [*((str(number), name) for number, name in enumerate(GESTURES)), *zip(OWN_KEYS, own, strict=False)]


def _about(state: LoggerState, subject: str) -> str:
    """Say which event is shown, and how many wait."""
    who = f"subject {html.escape(subject)}, " if subject else ""
    counts = ", ".join(f"{html.escape(name.replace('_', ' '))} {count}" for name, count in state.counts.items()) or "none yet"
    lost = f', <b style="color:{BAD}">{state.lost} not kept</b>' if state.lost else ""
    small = f'<div style="font:13px {FONT};color:{FAINT}">{who}{len(state.waiting)} waiting, labelled: {counts}{lost}</div>'
    return f'<div style="font:600 19px {FONT};color:{TEXT}">{_headline(state)}</div>{small}'


def _headline(state: LoggerState) -> str:
    if not state.waiting:
        return "waiting for a gesture"
    event = state.current
    return f"event {state.waiting[0]}" + ("" if event is None else _described(event))


def _described(event: LoggedEvent) -> str:
    seconds = (event.end_ns - event.start_ns) * 1e-9
    guess = f": the graph says {html.escape(event.guess.replace('_', ' '))}, {event.confidence:.0%}" if event.guess else ""
    return f", person {event.track_id}, {seconds:.2f} s{guess}"


def _said(state: LoggerState) -> str:
    """Write the last messages down, the newest on top; it says what was saved only when it is on the disk."""
    lines = [html.escape(line) for line in reversed(state.said)]
    shade = BAD if state.wrong else GOOD
    rows = [f'<div style="font:15px {FONT};color:{shade if k == 0 else FAINT}">{line}</div>' for k, line in enumerate(lines)]
    return "".join(rows)
