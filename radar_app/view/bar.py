"""The bar above the tabs: what is shown, whether it is live, and the time, which can be stopped and moved through the last minute."""

from __future__ import annotations

import html
from typing import Any, Final

from bokeh.layouts import row
from bokeh.models.widgets import Button, Slider

from radar_app.view.feed import Feed, History, Snapshot
from radar_app.view.pictures import Pictures
from radar_app.view.style import BAD, BUTTON, DOUBTFUL, FAINT, FIELD, FONT, GOOD, TEXT

_SILENT: Final = 2.0  # s: without clouds or tracks the page says so
_STEP: Final = 0.05  # s

_LAYOUT: Final = ":host { flex-wrap: wrap; gap: 10px 18px; align-items: center; margin-bottom: 6px; }"


class TimeBar:
    """Chooses the moment that a page shows: the newest, or one of the minute before it was paused.

    Attributes
    ----------
    layout : Row
        What it shows.
    """

    def __init__(self, feed: Feed, title: str, goes: str, pictures: Pictures) -> None:
        self._feed, self._title, self._goes, self._pictures = feed, title, goes, pictures
        self._frozen: History | None = None
        self._moving = False  # whether this program moves the slider, not the user
        self._head = pictures.div("head", styles={"flex": "1 1 320px"})
        self._button = Button(label="Pause", name="pause", width=96, stylesheets=[BUTTON])
        self._button.on_click(self._pause_or_go)
        self._slider = Slider(
            start=-feed.keep, end=0.0, value=0.0, step=_STEP, title="seconds ago", name="scrub", sizing_mode="stretch_width",
            stylesheets=[FIELD], styles={"flex": "2 1 260px"}, show_value=True,
        )  # fmt: skip
        self._slider.on_change("value", self._scrub)
        self.layout = row(self._head, self._button, self._slider, sizing_mode="stretch_width", stylesheets=[_LAYOUT])

    @property
    def paused(self) -> bool:
        """Whether time stands still."""
        return self._frozen is not None

    def moment(self) -> Snapshot:
        """Give the moment that is to be shown."""
        if self._frozen is None:
            return self._feed.history().at()
        if self._slider.value >= 0:
            return self._frozen.at()
        return self._frozen.at(max(self._frozen.start_ns, self._frozen.end_ns + round(self._slider.value * 1e9)))

    def update(self, moment: Snapshot, note: str) -> None:
        """Say what is shown; ``note`` is what the source has to say."""
        people = moment.people
        count = "-" if people is None else str(people.people_count)
        word, shade = self._state(moment)
        aside = f'<span style="color:{DOUBTFUL}">{html.escape(note)}</span>' if note else ""
        text = (
            f'<div style="font:15px {FONT};color:{TEXT};display:flex;flex-wrap:wrap;gap:4px 16px;align-items:baseline">'
            f'<b style="font-size:19px">Handwave</b><span style="color:{FAINT}">{html.escape(self._title)}</span>'
            f'<span style="color:{shade};font-weight:600">● {word}</span>'
            f"<span><b>{count}</b> {'person' if count == '1' else 'people'}</span>{aside}</div>"
        )
        self._pictures.write(self._head, text)

    def _state(self, moment: Snapshot) -> tuple[str, str]:
        if self._frozen is not None:
            ago = (self._frozen.end_ns - moment.stamp_ns) * 1e-9
            return (f"paused, {ago:.1f} s back" if ago > _STEP / 2 else "paused"), DOUBTFUL
        if not moment.history.end_ns:
            return "waiting for the first data", FAINT
        if moment.history.silent > _SILENT:
            return f"nothing for {moment.history.silent:.0f} s", BAD
        return self._goes, GOOD

    def _pause_or_go(self, _: Any = None) -> None:
        if self._frozen is None:
            self._freeze()
        else:
            self._frozen = None
            self._button.label, self._button.button_type = "Pause", "default"
            self._move(0.0)

    def _freeze(self) -> None:
        """Stop time; what is kept now stays within reach of the slider."""
        self._frozen = self._feed.history()
        self._button.label, self._button.button_type = "Go on", "primary"

    def _scrub(self, _attr: str, _old: float, new: float) -> None:
        """Move through the last minute, which stops time first."""
        if not self._moving and self._frozen is None and new < 0:
            self._freeze()

    def _move(self, value: float) -> None:
        self._moving = True
        self._slider.value = value
        self._moving = False
