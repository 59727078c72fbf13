"""The page of one browser: a bar with the time, and tabs below it; ten times a second it shows what is new, and only what is seen."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final, Protocol

from bokeh.document import Document
from bokeh.models import CustomJS
from bokeh.models.layouts import TabPanel, Tabs
from bokeh.models.ui import UIElement

from radar_app.view.bar import TimeBar
from radar_app.view.feed import Feed, Snapshot
from radar_app.view.pictures import Pictures
from radar_app.view.style import PAGE, TABS, stack

PERIOD_MS: Final = 88
"""How often a page looks whether it has something new to show."""

_AGAIN: Final = """
const note = document.createElement("div")
note.textContent = "The server of this page has gone; it opens again when the server is back."
note.style.cssText = "position:fixed;inset:auto 0 0 0;padding:12px;background:#D55E00;color:#fff;font:600 15px sans-serif;text-align:center"
document.body.append(note)
setInterval(() => fetch(location.pathname).then(answer => { if (answer.ok) location.reload() }, () => {}), 2000)
"""


class Source(Protocol):
    """Where the data of a page comes from: a running graph, or a recording.

    Attributes
    ----------
    title : str
        For people: what is shown.
    goes : str
        One word for people while it gives something: live, or playing.
    feed : Feed
        What it gives.
    """

    title: str
    goes: str
    feed: Feed

    @property
    def note(self) -> str:
        """What people should know besides: that a recording is over, that messages make no sense; empty: nothing."""
        ...

    @property
    def zones_file(self) -> Path | None:
        """Where zones are kept; None: nowhere."""
        ...

    def reload_zones(self, told: Callable[[bool, str], None]) -> None:
        """Let the zones file take effect; ``told``, called from any thread, hears whether it did, and what there is to say."""
        ...

    def close(self) -> None:
        """Stop; when it returns no thread of it is left."""
        ...


@dataclass(frozen=True)
class Context:
    """What a tab may use.

    Attributes
    ----------
    source : Source
        Where the data comes from; the same for all browsers.
    document : Document
        Of this browser. Its models are changed only in `Tab.update`, in callbacks of its own models, and in what
        ``document.add_next_tick_callback`` calls, which any thread may.
    pictures : Pictures
        Makes data sources and texts that `Tab.update` changes many times a second. What seldom changes may be changed in the usual way.
    """

    source: Source
    document: Document
    pictures: Pictures = field(default_factory=Pictures)

    @property
    def feed(self) -> Feed:
        """What the source gives."""
        return self.source.feed


class Tab(Protocol):
    """One tab of one browser's page; ``title`` and ``layout`` may be plain attributes."""

    @property
    def title(self) -> str:
        """What stands on its handle."""
        ...

    @property
    def layout(self) -> UIElement:
        """What it shows, ``sizing_mode="stretch_width"``; made once."""
        ...

    def update(self, now: Snapshot) -> None:
        """Show a moment; called some ten times a second while the tab is seen and there is something new, also while the user scrubs.

        It runs in the server's thread, so it must be quick (milliseconds): what takes longer goes to a thread of its own.
        """
        ...

    def close(self) -> None:
        """Let go of everything: the browser has left. Called once; nothing is called afterwards."""
        ...


TabMaker = Callable[[Context], Tab]
"""Makes a tab for one browser; ``functools.partial`` gives it settings of its own."""


class Page:
    """The page of one browser.

    It shows a moment when something new has come, or the user has chosen another one, and the browser has drawn what it was sent before:
    who is slow gets fewer pictures, never late ones.

    Parameters
    ----------
    context : Context
        What it shows, and where.
    makers : sequence of TabMaker
        Its tabs, in order.
    """

    def __init__(self, context: Context, makers: Sequence[TabMaker]) -> None:
        self._source = context.source
        self.bar = TimeBar(context.feed, context.source.title, context.source.goes, context.pictures)
        self.tabs = [make(context) for make in makers]
        self._pictures = context.pictures
        self._seen: tuple[object, ...] = ()
        self._panels = Tabs(
            tabs=[TabPanel(title=tab.title, child=tab.layout) for tab in self.tabs], sizing_mode="stretch_width", stylesheets=[TABS]
        )
        self._document = document = context.document
        document.title = "Handwave"
        document.template = PAGE  # type: ignore[assignment]  # text is as good as a template there
        document.js_on_event("connection_lost", CustomJS(code=_AGAIN))
        document.add_root(stack(self.bar.layout, self._panels))
        self._pictures.join(document)
        document.on_event("document_ready", self._begin)

    def _begin(self, _: object) -> None:
        """Start to show: the browser is there, and answers what it is sent from now on."""
        self._document.add_periodic_callback(self.tick, PERIOD_MS)

    def tick(self) -> None:
        """Show what is new, if the browser is ready for it."""
        if not self._pictures.ready:
            return
        moment = self.bar.moment()
        seen = (moment.history.number, moment.stamp_ns, self._panels.active, self._pictures.asked, self._pictures.owed)
        self.bar.update(moment, self._source.note)
        if seen != self._seen:
            self._seen = seen
            self.tabs[self._panels.active].update(moment)
        self._pictures.send()

    def close(self) -> None:
        """Let go of everything: the browser has left."""
        for tab in self.tabs:
            tab.close()
