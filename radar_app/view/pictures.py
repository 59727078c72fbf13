"""What a browser is sent in one piece: all that a moment changes, so that every plot is drawn once, and nothing waits behind it."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

import numpy as np
from bokeh.document import Document
from bokeh.models import ColumnDataSource, CustomJS
from bokeh.models.widgets import Div

from radar_app.view.style import WIDE
from radar_core.types import Float32Array

AHEAD: Final = 2
"""Pictures that may be on their way to the browser; who is slow gets fewer of them, never late ones."""

_SHOW: Final = """
const parts = {}
const put = (key, value) => {
  const [name, column] = key.split("/")
  ;(parts[name] ??= {})[column] = value
}
let at = 0
const columns = sent.data.columns?.[0]
for (const [key, size] of sent.data.sizes?.[0] ?? []) {
  put(key, new Float32Array(columns.buffer, columns.byteOffset + 4 * at, size))
  at += size
}
for (const [name, [value]] of Object.entries(sent.data)) {
  if (name.includes("/")) put(name, value)
  else if (name in places) {
    const view = Bokeh.index.find_one(places[name])
    if (view != null) view.shadow_el.querySelector("[data-text]").innerHTML = value
  }
}
for (const [name, data] of Object.entries(parts)) places[name].data = data
requestAnimationFrame(() => { drawn.data = {n: [sent.data.n[0]]} })
"""


class Pictures:
    """Collects what changes, and sends it when the browser has drawn what it was sent before.

    Data sources and texts that are made here are filled in the browser; on this side they stay as they were made.

    Attributes
    ----------
    asked : int
        How often the user has asked for another picture of the same moment.
    owed : int
        How often a picture has left something of its moment to the next one.
    """

    def __init__(self) -> None:
        self._places: dict[str, ColumnDataSource | Div] = {}
        self._changes: dict[str, list[Any]] = {}
        self._columns: dict[str, Float32Array] = {}
        self._texts: dict[str, str] = {}
        self.asked = self.owed = 0
        self._sent = ColumnDataSource(data={"n": [0]}, name="sent")
        self._drawn = ColumnDataSource(data={"n": [0]}, name="drawn")

    def source(self, name: str, columns: Mapping[str, Any]) -> ColumnDataSource:
        """Make a data source of a name that no other has, with these columns."""
        made = ColumnDataSource(data=dict(columns), name=name, syncable=False)
        self._places[name] = made
        return made

    def div(self, name: str, **options: Any) -> Div:
        """Make a text of a name that no other has."""
        # Its text is changed within, not as a whole: after that Bokeh would lay out the page anew, which takes longer than drawing it.
        inner: dict[str, Any] = {"text": "<div data-text></div>", "stylesheets": [WIDE], "disable_math": True, "syncable": False}
        made = Div(name=name, sizing_mode="stretch_width", **inner, **options)
        self._places[name] = made
        return made

    def put(self, source: ColumnDataSource, data: Mapping[str, Any]) -> None:
        """Change the data of a source that was made here; all columns that are arrays, shape (n,), travel together as float32."""
        for column, values in data.items():
            key = f"{source.name}/{column}"
            self._changes.pop(key, None)
            self._columns.pop(key, None)
            if isinstance(values, np.ndarray) and values.ndim == 1:
                self._columns[key] = np.asarray(values, np.float32)
            else:
                self._changes[key] = [values]

    def write(self, div: Div, text: str) -> None:
        """Change a text that was made here, to HTML, unless it is the same already."""
        if self._texts.get(str(div.name)) != text:
            self._texts[str(div.name)] = text
            self._changes[str(div.name)] = [text]

    def join(self, document: Document) -> None:
        """Become part of a document, once all sources and texts are made."""
        places = {"sent": self._sent, "drawn": self._drawn, "places": self._places}
        self._sent.js_on_change("data", CustomJS(args=places, code=_SHOW))
        document.add_root(self._sent)
        document.add_root(self._drawn)

    def look_again(self, _attr: str, _old: Any, _new: Any) -> None:
        """Ask for another picture of the same moment; for widgets, which also choose while time stands still."""
        self.asked += 1

    def owe(self) -> None:
        """Ask for a picture more, because this one does not show all of its moment."""
        self.owed += 1

    @property
    def ready(self) -> bool:
        """Whether the browser has drawn, but for a few, all that it was sent."""
        return bool(self._sent.data["n"][0] - self._drawn.data["n"][0] < AHEAD)

    def send(self) -> None:
        """Send what has changed, if anything has."""
        if not (self._changes or self._columns):
            return
        packed: dict[str, list[Any]] = {}
        if self._columns:
            sizes = [[key, len(column)] for key, column in self._columns.items()]
            packed = {"sizes": [sizes], "columns": [np.concatenate(list(self._columns.values()))]}
        self._sent.data = {"n": [self._sent.data["n"][0] + 1], **packed, **self._changes}
        self._changes, self._columns = {}, {}
