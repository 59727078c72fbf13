"""One body with two tracks in the Poisson tracker: a limb that goes along, and two people of whom one follows the other's body."""

import numpy as np
import pytest

from radar_tracking import TrackerConfig
from radar_tracking.people.zones import View, Zones
from radar_tracking.poisson.existence import Decisions
from radar_tracking.poisson.table import N_STATES, RECORD, Table
from radar_tracking.tracks import Reason

NOW = 10.0  # s
CONFIG = TrackerConfig()


def table_of(*tracks: dict) -> Table:
    """Make a table of tracks that walk and have just been seen; ``place`` and ``began`` are theirs, other entries columns."""
    table = Table()
    for number, given in enumerate(tracks, 1):
        row, columns = np.zeros(1, RECORD), dict(given)
        place = np.array(columns.pop("place"))
        row["id"], row["birthplace"], row["seen"] = number, columns.pop("began", place), NOW
        for name, value in columns.items():
            row[name] = value
        table.add(row, np.concatenate([place, np.zeros(N_STATES - 2)]), 0.01 * np.eye(N_STATES))
    return table


def decisions() -> Decisions:
    """Those of the default configuration."""
    return Decisions(CONFIG.poisson, View(None), Zones(CONFIG.zones))


@pytest.mark.parametrize(
    ("rate", "age", "stands", "way", "limb"),
    [
        (4.0, 1.0, False, 1.5, True),  # fewer points than two thirds of the walker's
        (8.0, 1.0, False, 1.5, False),  # as many as of a second body
        (4.0, CONFIG.poisson.arm_time + 0.1, False, 1.5, False),  # has stayed
        (8.0, 1.0, False, 0.5, True),  # has not yet gone along for a metre
        (8.0, 1.0, True, 1.5, True),  # beside somebody who stands only time tells
    ],
)
def test_what_goes_along_is_a_limb_at_first(rate, age, stands, way, limb):
    walker = {"place": (3.0, 0.0), "confirmed": True, "rate": 10.0, "stands": stands}
    table = table_of(walker, {"place": (3.0, 0.6), "began": (3.4, 0.5), "rate": rate, "born": NOW - age, "stands": stands})
    near = decisions()._near(table, table.gaps(), np.array([5.0, way]), NOW)
    assert near.tolist() == [[False, False], [limb, False]]


@pytest.mark.parametrize(
    ("gap", "began", "met", "whose"),
    [
        (0.4, 1.0, True, 2),  # the nearer one of two on one body
        (0.6, 1.0, True, 3),  # two bodies
        (0.4, 1.0, False, 3),  # never seen apart: one of the two is no person
        (0.4, 1.4, True, 3),  # began too far away to be one of them
    ],
)
def test_who_begins_beside_two_on_one_body_is_one_of_them(gap, began, met, whose):
    people = {"confirmed": True, "rate": 6.0}
    table = table_of({"place": (3.0, gap), **people}, {"place": (3.0, 0.0), **people}, {"place": (3.0, -1.6), "began": (3.0, -began)})
    if met:
        table.note_apart(np.array([0]), np.array([1]))
    ends: dict[int, Reason] = {}
    decisions()._recover(table, table.gaps(), 2, NOW, ends)
    assert table.rows["id"][2] == whose
    assert ends == ({1: Reason.DUPLICATE} if whose == 2 else {})
    assert table.rows["id"][0] == 1
