"""Zones: boxes on the floor that say where people can be, where they come in, and where they are counted."""

import re

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from radar_core import ConfigError
from radar_core.config import load
from radar_tracking.people.zones import Zones, ZonesConfig
from radar_tracking.tracks import Track, Tracks, TrackStatus

ROOM = (0.0, 5.0, -2.0, 2.0)
ALCOVE = (5.0, 6.0, 0.0, 1.0)
DOOR = (4.0, 5.0, -2.0, -1.0)

numbers = st.floats(-20, 20, allow_nan=False)
boxes = st.tuples(numbers, numbers, numbers, numbers).filter(lambda b: b[0] < b[1] and b[2] < b[3])


def tracks(*people):
    """Tracks from (x, y, status)."""
    made = tuple(
        Track(i + 1, status, 1.0, 0.0, 5, np.array([x, y, 1.0]), np.zeros(3), np.full(3, np.nan), np.eye(6))
        for i, (x, y, status) in enumerate(people)
    )
    return Tracks(0, 0, "room", made, np.empty(0, np.int32))


@settings(max_examples=60, deadline=None)
@given(st.lists(boxes, max_size=4), hnp.arrays(np.float64, (7, 3), elements=st.floats(-25, 25, width=32)))
def test_inside_is_the_union_of_boxes(given_boxes, points):
    """Equal to the plain loop over boxes and points, edges included; without boxes everything is inside."""
    zones = Zones(ZonesConfig(boundaries=tuple(v for box in given_boxes for v in box)))
    points[0, :2] = given_boxes[0][1::2] if given_boxes else 0.0  # a corner
    expected = [not given_boxes or any(a <= x <= b and c <= y <= d for a, b, c, d in given_boxes) for x, y, _ in points.tolist()]
    np.testing.assert_array_equal(zones.inside(points), expected)
    np.testing.assert_array_equal(zones.inside(points[:, :2]), expected)
    assert [bool(zones.inside(point)) for point in points] == expected


def test_unknown_places_are_inside_no_box():
    """A point without position is nobody's where boundaries are drawn; where none are, zones have no opinion."""
    lost = np.array([[np.nan, 0.0, 1.0], [1.0, np.nan, 1.0], [1.0, 0.0, np.nan], [np.inf, 0.0, 0.0]])
    np.testing.assert_array_equal(Zones(ZonesConfig(boundaries=ROOM)).inside(lost), [False, False, True, False])
    assert Zones().inside(lost).all()


def test_shapes_of_any_kind():
    """No points, one point, and grids of points."""
    zones = Zones(ZonesConfig(boundaries=ROOM + ALCOVE))
    assert zones.inside(np.empty((0, 3))).shape == (0,)
    assert Zones().inside(np.empty((0, 2))).shape == (0,)
    grid = np.stack(np.meshgrid(np.linspace(-1, 7, 9), np.linspace(-3, 3, 7), indexing="ij"), axis=-1)
    assert zones.inside(grid).shape == (9, 7)
    assert zones.inside(np.array([5.5, 0.5, 9.0]))
    assert not zones.inside(np.array([5.5, 1.5, 9.0]))


@pytest.mark.parametrize(
    ("place", "age", "allowed"),
    [
        ((4.5, -1.5), 100.0, True),  # at the door
        ((2.0, 0.0), 100.0, False),  # out of nothing
        ((2.0, 0.0), 1.5, True),  # was there already
        ((2.0, 0.0), 2.0, True),  # to the end of the settling time
        ((9.0, 0.0), 1.5, False),  # outside is outside at all times
        ((9.0, 0.0), 100.0, False),
        ((np.nan, 0.0), 0.0, False),
    ],
)
def test_people_come_in_through_doors(place, age, allowed):
    """After the settling time tracks begin in entries only, and never outside the boundaries."""
    zones = Zones(ZonesConfig(boundaries=ROOM, entries=DOOR, settle=2.0))
    assert zones.may_enter(np.array(place), age) is allowed


def test_without_entries_people_come_from_anywhere_inside():
    """An entry outside the boundaries lets nobody in."""
    assert Zones().may_enter(np.array([99.0, 99.0]), 1e9)
    assert Zones(ZonesConfig(boundaries=ROOM)).may_enter(np.array([1.0, 0.0]), 1e9)
    assert not Zones(ZonesConfig(boundaries=ROOM, entries=(7.0, 8.0, 0.0, 1.0))).may_enter(np.array([7.5, 0.5]), 1e9)


def test_people_are_counted_by_zone():
    """Confirmed and coasting people count, tentative tracks do not; zones may overlap."""
    zones = Zones(ZonesConfig(counted=("room", "door"), counted_boxes=ROOM + DOOR))
    here = tracks(
        (1.0, 0.0, TrackStatus.CONFIRMED),
        (4.5, -1.5, TrackStatus.COASTING),
        (4.4, -1.4, TrackStatus.TENTATIVE),
        (9.0, 0.0, TrackStatus.CONFIRMED),
    )
    assert zones.process(here) == {"room": 2, "door": 1}
    assert zones.process(tracks()) == {"room": 0, "door": 0}
    assert Zones().process(here) == {}


@pytest.mark.parametrize(
    ("knobs", "message"),
    [
        ({"boundaries": (0.0, 1.0, 2.0)}, "ZonesConfig.boundaries has 3 numbers; every box needs four"),
        ({"entries": (0.0, 1.0, 2.0, 3.0, 1.0, 0.0, 0.0, 1.0)}, "ZonesConfig.entries: box 1 is x 1 to 0, y 0 to 1; each low must be below"),
        ({"boundaries": (0.0, 0.0, 0.0, 1.0)}, "ZonesConfig.boundaries: box 0 is x 0 to 0"),
        ({"boundaries": (0.0, 1.0, 0.0, float("nan"))}, "ZonesConfig.boundaries is nan; it must be a finite number"),
        ({"counted": ("sofa", "door"), "counted_boxes": DOOR}, "ZonesConfig.counted_boxes holds 1 boxes for 2 names in counted"),
        ({"counted": ("sofa", "sofa"), "counted_boxes": DOOR + DOOR}, "ZonesConfig.counted has 'sofa' twice"),
        ({"counted": ("",), "counted_boxes": DOOR}, "ZonesConfig.counted has '' as a name"),
        ({"settle": -1.0}, "ZonesConfig.settle is -1"),
    ],
)
def test_boxes_that_make_no_sense(knobs, message):
    """The message names the key, the box and the order of its numbers."""
    with pytest.raises(ConfigError, match=re.escape(message)):
        ZonesConfig(**knobs)


def test_plain_data_makes_zones():
    """As a YAML file or ROS parameters give it: flat lists of numbers."""
    made = load(ZonesConfig, {"boundaries": [0, 5, -2, 2], "counted": ["sofa"], "counted_boxes": [1.0, 2.0, 0.0, 1.0]})
    assert made == ZonesConfig(boundaries=ROOM, counted=("sofa",), counted_boxes=(1.0, 2.0, 0.0, 1.0))
