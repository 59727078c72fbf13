"""Who is in a zone and when that counts as presence, against plain loops over the truth."""

import dataclasses

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from radar_core import DataError
from radar_core.config import load
from radar_tracking.tracks import Track, Tracks, TrackStatus
from radar_tracking.zones import LayoutConfig, Presence, ZoneMonitor

S = 10**9
SQUARE = [[1, -1], [3, -1], [3, 1], [1, 1]]


def track(number, x, y, z=1.0, status=TrackStatus.CONFIRMED, std=0.01):
    covariance = np.diag([std**2, std**2, 0.04, 1.0, 1.0, 1.0])
    return Track(number, status, 1.0, 0.0, 5, np.array([x, y, z]), np.zeros(3), np.full(3, np.nan), covariance)


def tracks(stamp_ns, *people):
    return Tracks(stamp_ns, stamp_ns // 10**8, "room", tuple(people), np.empty(0, np.int32))


def monitor(on=0.5, off=2.0, **more):
    zone = {"name": "sofa", "polygon": SQUARE, "on_delay": on, "off_delay": off}
    return ZoneMonitor(load(LayoutConfig, {"zones": [zone], "on_delay": on, "off_delay": off, **more}))


@settings(max_examples=80, deadline=None)
@given(st.lists(st.booleans(), min_size=1, max_size=60), st.integers(0, 12), st.integers(0, 20))
def test_presence_is_what_the_delays_make_of_it(there, on, off):
    """At ten sets of tracks a second: on `on` steps after somebody came, off `off` steps after the last one left; unknown before."""
    zones = monitor(on / 10, off / 10)
    expected, run, before = Presence.UNKNOWN, 0, None
    for step, somebody in enumerate(there):
        run = run + 1 if somebody == before else 0
        before = somebody
        if run >= (on if somebody else off):
            expected = Presence.OCCUPIED if somebody else Presence.EMPTY
        people = [track(4, 2.0, 0.0)] if somebody else []
        state = zones.process(tracks(step * S // 10, *people)).zones[0]
        assert state.presence is expected
        assert state.count == int(somebody)


@settings(max_examples=60, deadline=None)
@given(st.lists(st.lists(st.tuples(st.floats(0, 4), st.floats(-2, 2)), max_size=4), max_size=8))
def test_counts_are_those_of_a_plain_loop_without_a_border(frames):
    """Everybody inside the square counts, wherever they were before."""
    zones = monitor(border=0.0, border_sigmas=0.0)
    for step, places in enumerate(frames):
        people = [track(i + 1, x, y) for i, (x, y) in enumerate(places)]
        states = zones.process(tracks(step * S, *people))
        inside = [i + 1 for i, (x, y) in enumerate(places) if 1 < x < 3 and -1 < y < 1]
        edge = [i + 1 for i, (x, y) in enumerate(places) if (x in (1, 3) and -1 <= y <= 1) or (y in (-1, 1) and 1 <= x <= 3)]
        found = [person.track_id for person in states.zones[0].people]
        assert set(inside) <= set(found) <= {*inside, *edge}
        assert [person.track_id for person in states.room.people] == [i + 1 for i in range(len(places))]


def test_who_stands_on_a_side_is_not_counted_in_and_out():
    """In from the side on, out only a border beyond it; the border grows with how unsure the place is, up to half a metre."""
    zones = monitor(border=0.15, border_sigmas=1.0)

    def count(x, std=0.01):
        count.now += S
        return zones.process(tracks(count.now, track(1, x, 0.0, std=std))).zones[0].count

    count.now = 0
    assert [count(x) for x in (0.9, 1.01, 0.99, 0.86, 0.84, 0.9, 0.99, 1.01)] == [0, 1, 1, 1, 0, 0, 0, 1]
    assert [count(0.7, 0.35), count(0.4, 3.0)] == [1, 0]  # 0.35 m; not more than 0.5 m
    assert count(0.55, 3.0) == 0  # out is out


def test_dwell_counts_from_coming_in():
    """For each person, and for the zone from when it was occupied; leaving ends it."""
    zones = monitor(on=1.0, off=1.0)
    for step in range(30):
        states = zones.process(tracks(step * S // 10, track(1, 2.0, 0.0), *([track(2, 2.0, 0.5)] if step >= 12 else [])))
    (zone,) = states.zones
    assert [(p.track_id, round(p.dwell, 6)) for p in zone.people] == [(1, 2.9), (2, 1.7)]
    assert (zone.presence, zone.since_ns, round(zone.dwell, 6)) == (Presence.OCCUPIED, S, 1.9)
    for step in range(30, 45):
        states = zones.process(tracks(step * S // 10, track(1, 5.0, 0.0)))
    assert (states.zones[0].presence, states.zones[0].since_ns, states.zones[0].dwell) == (Presence.EMPTY, 4 * S, 0.0)
    assert states.room.presence is Presence.OCCUPIED


def test_who_counts():
    """Confirmed and coasting tracks; tentative ones do not, nor who is above or below the zone or nowhere."""
    zone = {"name": "floor", "polygon": SQUARE, "z_low": 0.5, "z_high": 1.5}
    zones = ZoneMonitor(load(LayoutConfig, {"zones": [zone]}))
    people = [
        track(1, 2.0, 0.0), track(2, 2.0, 0.2, status=TrackStatus.COASTING), track(3, 2.0, 0.4, status=TrackStatus.TENTATIVE),
        track(4, 2.0, 0.6, z=1.7), track(5, 2.0, 0.8, z=0.2), track(6, np.nan, 0.0),
    ]  # fmt: skip
    states = zones.process(tracks(0, *people))
    assert [person.track_id for person in states.zones[0].people] == [1, 2]
    assert [person.track_id for person in states.room.people] == [1, 2, 4, 5, 6]


def test_the_room_is_its_boundary():
    """Who is beyond it is not in the room; several boundaries are one room."""
    bounds = [
        {"name": "hall", "kind": "boundary", "polygon": SQUARE},
        {"name": "nook", "kind": "boundary", "polygon": [[3, 0], [4, 0], [4, 1], [3, 1]]},
    ]
    one, both = (ZoneMonitor(load(LayoutConfig, {"zones": bounds[:n]})) for n in (1, 2))
    people = tracks(0, track(1, 2.0, 0.0), track(2, 3.5, 0.5), track(3, 3.5, -0.5))
    assert one.process(people).room.count == 1
    assert one.process(people).room.name == "hall"
    assert both.process(people).room.count == 2
    assert [zone.count for zone in both.process(people).zones] == [1, 1]


def test_tracks_that_stop():
    """Nobody knows anything until tracks come again, and then the delays count from there."""
    zones = monitor(on=0.5, off=2.0)
    for step in range(10):
        zones.process(tracks(step * S // 10, track(1, 2.0, 0.0)))
    stale = zones.stale()
    assert (stale.stale, stale.stamp_ns, stale.room.presence, stale.zones[0].presence) == (
        True,
        9 * S // 10,
        Presence.UNKNOWN,
        Presence.UNKNOWN,
    )
    assert (stale.room.count, stale.zones[0].count, stale.zones[0].dwell) == (0, 0, 0.0)
    again = [zones.process(tracks(10 * S + step * S // 10)) for step in range(25)]
    assert not any(states.stale for states in again)
    assert [states.zones[0].presence for states in again] == [Presence.UNKNOWN] * 20 + [Presence.EMPTY] * 5
    assert ZoneMonitor().stale().stale


def test_other_zones_while_it_runs():
    """A zone that stays as it is keeps who is in it and since when; another of the same name does not."""
    zones = monitor(on=0.0)
    for step in range(5):
        zones.process(tracks(step * S, track(1, 2.0, 0.0)))
    same = {"name": "sofa", "polygon": SQUARE, "on_delay": 0.0, "off_delay": 2.0}
    wider = {"name": "rug", "polygon": [[0, -2], [4, -2], [4, 2], [0, 2]]}
    zones.change(load(LayoutConfig, {"zones": [wider, same], "on_delay": 0.0, "off_delay": 2.0}))
    rug, sofa = zones.process(tracks(5 * S, track(1, 2.0, 0.0))).zones
    assert (sofa.dwell, sofa.people[0].dwell, rug.people[0].dwell) == (5.0, 5.0, 0.0)
    assert zones.states().room.dwell == 5.0
    zones.change(load(LayoutConfig, {"zones": [{**same, "polygon": wider["polygon"]}]}))
    assert zones.process(tracks(6 * S, track(1, 2.0, 0.0))).zones[0].people[0].dwell == 0.0


def test_tracks_from_before_are_refused():
    """A recording that starts again needs a reset."""
    zones = monitor()
    zones.process(tracks(5 * S, track(1, 2.0, 0.0)))
    with pytest.raises(DataError, match="1 s older"):
        zones.process(tracks(4 * S))
    zones.reset()
    assert zones.process(tracks(4 * S)).room.count == 0


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf, 1e300, 0.0, -1.0])
def test_places_and_covariances_that_are_no_numbers(bad):
    """Such a place is in no zone; such a covariance leaves the border between 0.15 m and 0.5 m."""
    zones = monitor(border=0.15)

    def count(now, x, scale=1e-4):
        one = dataclasses.replace(track(1, x, 0.0), covariance=np.full((6, 6), scale))
        return zones.process(tracks(now * S, one)).zones[0].count

    assert [count(0, 2.0), count(1, bad), count(2, 2.0)] == [1, 0, 1]
    assert [count(3, 0.9, bad), count(4, 0.45, bad)] == [1, 0]
