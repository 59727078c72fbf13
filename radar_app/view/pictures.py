"""What a browser is sent in one piece: all that a moment changes, so that every plot is drawn once, and nothing waits behind it."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

from bokeh.document import Document
from bokeh.models import ColumnDataSource, CustomJS
from bokeh.models.widgets import Div

from radar_app.view.style import WIDE

AHEAD: Final = 2
"""Pictures that may be on their way to the browser; who is slow gets fewer of them, never late ones."""

_SHOW: Final = """
const parts = {}
for (const [key, [value]] of Object.entries(sent.data)) {
  const [name, column] = key.split("/")
  if (column != null) (parts[name] ??= {})[column] = value
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
    """

    def __init__(self) -> None:
        self._places: dict[str, ColumnDataSource | Div] = {}
        self._changes: dict[str, list[Any]] = {}
        self._texts: dict[str, str] = {}
        self.asked = 0
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
        """Change the data of a source that was made here."""
        self._changes.update({f"{source.name}/{column}": [values] for column, values in data.items()})

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

    @property
    def ready(self) -> bool:
        """Whether the browser has drawn, but for a few, all that it was sent."""
        return bool(self._sent.data["n"][0] - self._drawn.data["n"][0] < AHEAD)

    def send(self) -> None:
        """Send what has changed, if anything has."""
        if self._changes:
            self._sent.data = {"n": [self._sent.data["n"][0] + 1], **self._changes}
            self._changes = {}
