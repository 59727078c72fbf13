"""The first tab: the room, the people in it, what they do, and how the graph is doing."""

from __future__ import annotations

from radar_app.view.act_panels import ControlPanel, GesturePanel
from radar_app.view.feed import Snapshot
from radar_app.view.map_panels import PersonPanel, RangeDopplerPanel
from radar_app.view.page import Context
from radar_app.view.plan import Plan
from radar_app.view.style import card, grid, stack
from radar_app.view.table_panels import Tables
from radar_app.view.zones_panel import ZonesPanel


class RoomTab:
    """See `radar_app.view.page.Tab`."""

    title = "Room"

    def __init__(self, context: Context) -> None:
        self._pictures = pictures = context.pictures
        self._plan = Plan(pictures, self._clicked)
        self._gestures, self._control = GesturePanel(pictures), ControlPanel(pictures)
        self._range_doppler, self._person = RangeDopplerPanel(context.feed, pictures), PersonPanel(pictures)
        self._tables, self._zones = Tables(pictures), ZonesPanel(context)
        self._zones.on(self._plan)
        self._zones.look()
        self._now: Snapshot | None = None
        self._halves = ((self._control, self._range_doppler), (self._person, self._tables))
        self._half, self._left, self._moment = 0, {0, 1}, (-1, -1, -1)
        micro_doppler, azimuth, elevation = self._person.figures
        acts = stack(
            card("Gestures", self._gestures.list, self._gestures.figure),
            card("Control value", self._control.gauge, self._control.figure),
        )
        top = grid(card("Room from above", self._plan.figure, span=2), acts, columns=3)
        maps = grid(
            card("Distance and speed", self._range_doppler.figure, self._range_doppler.choice),
            card("One person: micro-Doppler", micro_doppler),
            card("One person: azimuth", azimuth),
            card("One person: elevation", elevation),
            columns=4,
        )
        tables = grid(
            card("People", self._tables.people, self._person.choice),
            card("Zones", self._tables.zones, *self._zones.parts),
            card("Latency", self._tables.latency_note, self._tables.latency),
            columns=3,
        )
        nodes = card("Nodes", self._tables.nodes)
        self.layout = stack(top, maps, tables, nodes)

    def _clicked(self, x: float, y: float) -> None:
        """Take a click on the plan: a corner of a zone, or the choice of a person."""
        if self._zones.drawing:
            self._zones.click(x, y)
            return
        people = self._now.people if self._now is not None else None
        near = sorted(((p.position[0] - x) ** 2 + (p.position[1] - y) ** 2, p.id) for p in (people.tracks if people is not None else ()))
        if near and near[0][0] < 0.7**2:
            self._person.choose(near[0][1])

    def update(self, now: Snapshot) -> None:
        """Show a moment: of plots that are large, one half with this picture, and the other half with the next."""
        self._now = now
        moment = (now.history.number, now.stamp_ns, self._pictures.asked)
        if moment != self._moment:
            self._moment, self._left = moment, {0, 1}
            self._plan.update(now)
            self._gestures.update(now)
            self._zones.update()
        self._half = 1 - self._half
        if self._half in self._left:
            self._left.remove(self._half)
            for panel in self._halves[self._half]:
                panel.update(now)
        if self._left:
            self._pictures.owe()

    def close(self) -> None:
        """Want no more raw frames."""
        self._range_doppler.close()
