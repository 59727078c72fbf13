"""The page of one browser: a bar with the time, and tabs below it; ten times a second it shows what is new, and only what is seen."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Protocol

from bokeh.document import Document
from bokeh.models.ui import UIElement

from radar_app.view.feed import Feed, Snapshot


class Source(Protocol):
    """Where the data of a page comes from: a running graph, or a recording.

    Attributes
    ----------
    title : str
        For people: what is shown.
    feed : Feed
        What it gives.
    """

    title: str
    feed: Feed

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
    """

    source: Source
    document: Document

    @property
    def feed(self) -> Feed:
        """What the source gives."""
        return self.source.feed


class Tab(Protocol):
    """One tab of one browser's page.

    Attributes
    ----------
    title : str
        On its handle.
    layout : UIElement
        What it shows, ``sizing_mode="stretch_width"``; made once.
    """

    title: str
    layout: UIElement

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
    """The page of one browser; see the package's docstring."""

    def __init__(self, context: Context, makers: Sequence[TabMaker]) -> None:
        self.context = context
        self.tabs = [make(context) for make in makers]
