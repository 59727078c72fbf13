"""Who goes off in the Poisson tracker: the identity goes along, and nobody is believed for long at the side of the view."""

import math
from types import SimpleNamespace

import numpy as np
import pytest

from radar_core import RadarInfo
from radar_tracking import TrackerConfig
from radar_tracking.people.zones import View, Zones
from radar_tracking.poisson.existence import CONFIRM_ODDS, MOST_ODDS, Decisions, weigh
from radar_tracking.poisson.sums import SUMS
from radar_tracking.poisson.table import N_STATES, RECORD, Table
from radar_tracking.tracks import Reason

NOW = 20.0  # s
CONFIG = TrackerConfig()
KNOBS = CONFIG.poisson


def table_of(*tracks: dict) -> Table:
    """Make a table of tracks; ``place`` and ``began`` are theirs, other entries columns."""
    table = Table()
    for number, given in enumerate(tracks, 1):
        row, columns = np.zeros(1, RECORD), dict(given)
        place = np.array(columns.pop("place"))
        row["id"], row["birthplace"] = number, columns.pop("began", place)
        for name, value in columns.items():
            row[name] = value
        table.add(row, np.concatenate([place, np.zeros(N_STATES - 2)]), 0.01 * np.eye(N_STATES))
    return table


def believed_for(table: Table, view: View, dt: float = 0.05) -> float:
    """How long clouds without points take to end the belief in the first track [s]: from the highest odds to the lowest."""
    nothing = SimpleNamespace(sums=np.zeros(1, SUMS), evidence=-np.ones(1), count=np.zeros(1), support=np.zeros(1))
    before = float(table.rows["odds"][0])
    weigh(table, nothing, dt, NOW, KNOBS, view)
    return (MOST_ODDS + CONFIRM_ODDS) * dt / (before - float(table.rows["odds"][0]))


@pytest.mark.parametrize(
    ("seen", "born", "began", "whose"),
    [
        (5.0, 5.5, 0.7, 1),  # vanished as the other began beside
        (5.0, 5.5, 1.3, 2),  # began too far away
        (0.2, 5.5, 0.7, 2),  # is still there
        (5.0, 9.0, 0.7, 2),  # stayed for seconds after the other had begun: two people
    ],
)
def test_who_vanishes_as_somebody_begins_beside_them_went_off(seen, born, began, whose):
    """A person who stood turns and walks off; the points that walk started a track of their own."""
    stood = {"place": (1.5, 0.0), "confirmed": True, "rate": 0.5, "stands": True, "seen": NOW - seen}
    walks = {"place": (3.5, 0.0), "began": (1.5 + began, 0.0), "rate": 6.0, "born": NOW - born, "seen": NOW}
    table = table_of(stood, walks)
    ends: dict[int, Reason] = {}
    Decisions(KNOBS, View(None), Zones(CONFIG.zones))._recover(table, table.gaps(), 1, NOW, ends)
    assert table.rows["id"][1] == whose
    assert ends == ({0: Reason.DUPLICATE} if whose == 1 else {})


def test_nobody_is_believed_for_long_at_the_side_of_the_view():
    """Who stood in sight for long and has no points any more: in the middle of the view hidden or at rest, at its side probably gone."""
    info = RadarInfo()
    view, half = View(info), info.array.fov_azimuth / 2
    stood = {"confirmed": True, "stands": True, "presence": 1.0, "person": 5.0, "rate": 0.5, "seen": NOW - 2.0}
    azimuths = np.array([0.0, half - 0.5 / 2.0, half - 0.1 / 2.0, -half + 0.1 / 2.0])
    places = [(2.0 * math.cos(azimuth), 2.0 * math.sin(azimuth)) for azimuth in azimuths]
    alone = [believed_for(table_of({"place": place, **stood}), view) for place in places]
    assert alone[:2] == pytest.approx([8.0 * KNOBS.stay_time] * 2)
    assert alone[2:] == pytest.approx([KNOBS.stay_time] * 2)
    at = np.array([(*place, view.origin[2]) for place in places])
    assert View(info).margin(at) == pytest.approx([2.0 * half, 0.5, 0.1, 0.1])
    assert np.isinf(View(None).margin(np.vstack([at, np.zeros(3)]))).all()
