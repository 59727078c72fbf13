"""Zones drawn on the plan by clicks or taps, named, and saved to the file that the graph reads."""

from __future__ import annotations

import html
from collections.abc import Callable, Iterable
from typing import Any, Final

from bokeh.layouts import row
from bokeh.models.widgets import Button, Div, Select, TextInput

from radar_app.view.page import Context
from radar_app.view.plan import Plan
from radar_app.view.style import BAD, BUTTON, FAINT, FIELD, FONT, TEXT
from radar_app.view.zones_file import ZonesFile
from radar_core import HandwaveError
from radar_tracking.zones.area import KINDS

_NEW: Final = "a new one"
_NOWHERE: Final = (
    "No zones file is read. Start the page with --zones FILE: the first zone that is saved makes the file, and counts at once."
)
_WRAP: Final = ":host { flex-wrap: wrap; gap: 8px; align-items: end; }"


class ZonesPanel:
    """Buttons and fields for zones, and the clicks on the plan while a zone is drawn.

    Attributes
    ----------
    layout : Column
        What it shows.
    """

    def __init__(self, context: Context) -> None:
        self._context = context
        self._plan: Plan | None = None
        self._corners: list[tuple[float, float]] = []
        self._drawing = False
        self._draw = Button(label="Draw", name="zone_draw", width=80, stylesheets=[BUTTON])
        self._undo = Button(label="Undo corner", name="zone_undo", width=110, disabled=True, stylesheets=[BUTTON])
        self._save = Button(label="Save", name="zone_save", width=80, disabled=True, stylesheets=[BUTTON])
        self._delete = Button(label="Delete", name="zone_delete", width=80, disabled=True, stylesheets=[BUTTON])
        self._which = Select(title="zone", value=_NEW, options=_options([]), name="zone_which", width=130, stylesheets=[FIELD])
        self._name = TextInput(title="name", name="zone_name", width=130, stylesheets=[FIELD])
        self._kind = Select(title="for", value=KINDS[0], options=_plain(KINDS), name="zone_kind", width=120, stylesheets=[FIELD])
        self._said = Div(name="zone_said", sizing_mode="stretch_width")
        for button, does in (
            (self._draw, self._begin_or_stop),
            (self._undo, self._take_back),
            (self._save, self._write),
            (self._delete, self._remove),
        ):
            button.on_click(does)
        self._which.on_change("value", lambda _attr, _old, new: self._choose(new))
        self._told_nowhere = False
        fields = row(self._which, self._name, self._kind, stylesheets=[_WRAP])
        self.parts = (fields, row(self._draw, self._undo, self._save, self._delete, stylesheets=[_WRAP]), self._said)
        self.update()

    def on(self, plan: Plan) -> None:
        """Draw on this plan."""
        self._plan = plan

    @property
    def drawing(self) -> bool:
        """Whether clicks on the plan are corners of a zone."""
        return self._drawing

    def update(self) -> None:
        """Follow the file: which zones there are, and whether there is one at all."""
        file = self._context.source.zones_file
        if file is None and not self._told_nowhere:
            self._say(_NOWHERE)
        elif file is not None and self._told_nowhere:
            self._say("")
        self._told_nowhere = file is None
        self._draw.disabled = file is None

    def look(self) -> None:
        """Read which zones the file has; called when it may have changed."""
        file = self._file()
        if file is None:
            return
        try:
            options = _options([zone.name for zone in file.layout().zones])
        except HandwaveError as error:
            self._say(str(error), bad=True)
            return
        if options != self._which.options:
            self._which.options = options

    def click(self, x: float, y: float) -> None:
        """Add a corner [m]."""
        self._corners.append((round(x, 2), round(y, 2)))
        self._show()

    def _file(self) -> ZonesFile | None:
        file = self._context.source.zones_file
        return None if file is None else ZonesFile(file)

    def _begin_or_stop(self) -> None:
        self._drawing = not self._drawing
        self._draw.label, self._draw.button_type = ("Cancel", "primary") if self._drawing else ("Draw", "default")
        self._corners = []
        self.look()
        self._show()
        self._say("Click the corners on the plan, one after the other, as one walks round the zone; then save." if self._drawing else "")

    def _take_back(self) -> None:
        self._corners = self._corners[:-1]
        self._show()

    def _show(self) -> None:
        """Show what is drawn so far, closed once it has a surface."""
        closed = [*self._corners, self._corners[0]] if len(self._corners) > 2 else self._corners
        if self._plan is not None:
            self._plan.draft.data = {"x": [x for x, _ in closed], "y": [y for _, y in closed]}
        self._undo.disabled = not self._corners
        self._save.disabled = len(self._corners) < 3
        self._delete.disabled = self._which.value == _NEW

    def _choose(self, name: str) -> None:
        """Work on a zone that there is: another shape or kind, or away with it."""
        file = self._file()
        self._delete.disabled = name == _NEW
        if file is None or name == _NEW:
            self._name.value = ""
            return
        try:
            found = next((zone for zone in file.layout().zones if zone.name == name), None)
        except HandwaveError as error:
            self._say(str(error), bad=True)
            return
        if found is not None:
            self._name.value, self._kind.value = found.name, found.kind
            self._corners = list(found.polygon)
            self._show()

    def _write(self) -> None:
        file, name = self._file(), self._name.value.strip()
        if file is None or self._failed(lambda: file.save(name, self._kind.value, self._corners)):
            return
        self._done(f"{name} is saved in {file.path}")

    def _remove(self) -> None:
        file, name = self._file(), self._which.value
        if file is None or self._failed(lambda: file.remove(name)):
            return
        self._done(f"{name} is deleted from {file.path}")

    def _failed(self, change: Callable[[], object]) -> bool:
        try:
            change()
        except HandwaveError as error:
            self._say(str(error), bad=True)
            return True
        return False

    def _done(self, text: str) -> None:
        """Say so, draw no longer, and let the graph read the file."""
        if self._drawing:
            self._begin_or_stop()
        self._corners = []
        self._which.value = _NEW
        self._show()
        self.look()
        self._say(text)
        document = self._context.document

        def told(good: bool, said: str) -> None:
            words = f"{text}; the graph says: {said}" if said else text
            document.add_next_tick_callback(lambda: self._say(words, bad=not good))

        self._context.source.reload_zones(told)

    def _say(self, text: str, *, bad: bool = False) -> None:
        shade = BAD if bad else TEXT if text != _NOWHERE else FAINT
        self._said.text = f'<div role="status" style="color:{shade};font:13px {FONT}">{html.escape(text)}</div>' if text else ""


def _options(names: Iterable[str]) -> Any:
    return [_NEW, *names]


def _plain(names: Iterable[str]) -> Any:
    return list(names)
