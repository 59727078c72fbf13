"""Zones that act in the trackers: where nothing starts, where people enter, and where nobody is; polygons, for both trackers."""

import dataclasses

import numpy as np
import pytest
from blobs import Blobs, Person, empty, walking

from radar_core import ConfigError
from radar_core.config import load
from radar_tracking import TrackerConfig, TrackStatus, make_tracker
from radar_tracking.people.zones import Zones, ZonesConfig

SECOND = 10  # clouds
PACING = Person(walking((3.0, 0.7), (3.0, 1.3), 0.6))  # within the exclusion zone
AROUND = "exclusion 3 -0.4, 4.4 1, 3 2.4, 1.6 1"  # a square on its corner
TRACKERS = pytest.mark.parametrize("tracker", ["group_clustering", "poisson_bernoulli"])


def config_of(tracker, *areas, settle=0.0):
    return load(TrackerConfig, {"tracker": tracker, "zones": {"areas": list(areas), "settle": settle}})


def follow(made, blobs, n, begin=0):
    """People after each cloud, as (id, x, y)."""
    found = []
    for k in range(begin, begin + n):
        tracks = made.process(blobs.cloud(k))
        found.append([(t.id, *t.position[:2]) for t in tracks.tracks if t.status is not TrackStatus.TENTATIVE])
    return found


def scene(*people):
    return Blobs(list(people), frame_ns=100_000_000, clutter=0.2)


@TRACKERS
def test_nothing_starts_where_it_is_excluded(tracker):
    """Whatever moves there is nobody; without the zone it is somebody within seconds."""
    free = follow(make_tracker(config_of(tracker)), scene(PACING), 10 * SECOND)
    assert len(free[-1]) == 1
    assert not any(follow(make_tracker(config_of(tracker, AROUND)), scene(PACING), 10 * SECOND))


@pytest.mark.parametrize("seed", range(4))
def test_echoes_that_scatter_over_the_side_of_a_zone_are_nobody(seed):
    """A curtain at the side of its zone: the middle of its echoes is outside now and then."""
    blobs = Blobs([Person(walking((2.95, 2.2), (3.05, 2.05), 0.5))], seed=seed, frame_ns=100_000_000, clutter=0.2)
    assert not any(follow(make_tracker(config_of("poisson_bernoulli", AROUND)), blobs, 20 * SECOND))


@TRACKERS
def test_who_walks_through_is_kept(tracker):
    """One identity from before the zone to behind it, to and fro."""
    found = follow(make_tracker(config_of(tracker, AROUND)), scene(Person(walking((3.0, -2.0), (3.0, 3.2), 1.0))), 15 * SECOND)
    people = [person for now in found[3 * SECOND :] for person in now]
    assert len(people) > 0.95 * 12 * SECOND
    assert len({number for number, _, _ in people}) == 1
    zones = Zones(ZonesConfig(areas=(AROUND,)))
    assert sum(zones.excluded(np.array([x, y])) for _, x, y in people) > 2 * SECOND


@TRACKERS
def test_a_zone_above_heads_is_for_nobody(tracker):
    """A fan at the ceiling excludes what begins up there, not who stands below."""
    found = follow(make_tracker(config_of(tracker, AROUND + "; 1.9 3")), scene(PACING), 10 * SECOND)
    assert len(found[-1]) == 1
    assert not any(follow(make_tracker(config_of(tracker, AROUND + "; 0 1.9")), scene(PACING), 10 * SECOND))


@TRACKERS
def test_people_come_through_entrances(tracker):
    """Who is first seen at the door is followed into the room; who appears in the middle of it is not."""
    door = "entrance 2 -2.6, 4 -2.6, 4 -1.2, 2 -1.2"
    assert len(follow(make_tracker(config_of(tracker, door)), scene(Person(walking((3.0, -2.0), (3.0, 1.5), 0.8))), 6 * SECOND)[-1]) == 1
    made = make_tracker(config_of(tracker, door))
    made.process(empty(0))  # with the first cloud people may be anywhere
    assert not any(follow(made, scene(PACING), 6 * SECOND, 1))
    assert len(follow(make_tracker(config_of(tracker, door, settle=5.0)), scene(PACING), 6 * SECOND)[-1]) == 1


@TRACKERS
def test_nobody_is_outside_the_boundary(tracker):
    """A room of two polygons; who moves in the next room is not in either."""
    rooms = ("boundary 0 -3, 6 -3, 6 0, 0 0", "boundary 0 0, 2 0, 0 2")
    both = scene(Person(walking((2.5, -1.5), (3.5, -1.0), 0.6)), PACING)
    found = follow(make_tracker(config_of(tracker, *rooms)), both, 8 * SECOND)
    assert all(y < 0.2 for now in found for _, _, y in now)
    assert len(found[-1]) == 1


@TRACKERS
def test_zones_can_change_while_people_are_tracked(tracker):
    """Who is there stays; after the change nothing new starts, and once the zone is gone it does."""
    free, excluded = config_of(tracker), config_of(tracker, AROUND)
    made, blobs = make_tracker(free), scene(PACING)
    before = follow(made, blobs, 5 * SECOND)[-1]
    made.change(excluded)
    kept = follow(made, blobs, 5 * SECOND, 5 * SECOND)
    assert [number for number, _, _ in before] == [number for number, _, _ in kept[-1]]
    again = make_tracker(excluded)
    assert not any(follow(again, scene(PACING), 5 * SECOND))
    again.change(free)
    assert len(follow(again, scene(PACING), 5 * SECOND, 5 * SECOND)[-1]) == 1
    with pytest.raises(ConfigError, match=r"zones\.areas"):
        made.change(dataclasses.replace(excluded, zones=dataclasses.replace(excluded.zones, settle=9.0)))


def test_areas_that_make_no_sense_are_refused():
    """With the text that is wrong."""
    with pytest.raises(ConfigError, match="'exclusion 1 1, 2 2'"):
        ZonesConfig(areas=("exclusion 1 1, 2 2",))
