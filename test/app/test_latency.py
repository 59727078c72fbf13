"""How long results take, from reports of stages: of one radar, of several that are fused, and of several rooms."""

import pytest

from radar_app.watching.latency import latencies
from radar_app.watching.reports import StageReport

MS = 1_000_000


def done(stage, sequence, stamp_ns, monotonic_ns, stale=False):
    """A report that holds nothing else."""
    return StageReport(stage, sequence, 1, 0, 0.0, monotonic_ns, stale, stamp_ns)


def reports_of(place, sequence, stamp, published, took):
    """A radar's frame and its cloud, whose stamp is 7 ms later [ms]."""
    space = f"{place}/" if place else ""
    driver = done(f"{space}driver", sequence, stamp * MS, published * MS)
    return [driver, done(f"{space}baseband", sequence, (stamp + 7) * MS, (published + took) * MS)]


def test_one_radar():
    """By sequence, also where the report of the driver comes last; a stale report says nothing."""
    made = [done("tracking", 5, 107 * MS, 140 * MS), *reports_of("", 5, 100, 120, 4), done("tracking", 6, 0, 0, True)]
    found = latencies(made)
    assert found["tracking"] == [(107 * MS, 20 * MS)]
    assert found["baseband"] == [(107 * MS, 4 * MS)]
    assert found["driver"] == [(100 * MS, 0)]
    assert latencies([done("tracking", 5, 107 * MS, 140 * MS)]) == {}


@pytest.mark.parametrize("place", ["", "hall"])
def test_fused_radars(place):
    """Fused clouds are counted anew: the latency counts from the frame of the two that came first; one that is silent is left out."""
    space = f"{place}/" if place else ""
    made = []
    for k in range(10):
        made += reports_of(f"{space}left", 100 + k, 50 * k, 50 * k + 20, 4)
        if k < 8:
            made += reports_of(f"{space}right", 700 + k, 50 * k + 8, 50 * k + 30, 4)
        made.append(done(f"{space}tracking", k, (50 * k + 11) * MS, (50 * k + 45) * MS))
    made.append(done(f"{space}tracking", 10, 2000 * MS, 2100 * MS))  # of a moment from which no frame is known
    found = latencies(made)
    assert [each.late_ns for each in found[f"{space}tracking"]] == [25 * MS] * 10
    assert [each.late_ns for each in found[f"{space}right/baseband"]] == [4 * MS] * 8


def test_fused_boards_that_give_clouds():
    """There is no baseband: the clouds are those of the drivers."""
    made = [done("left/driver", 3, 100 * MS, 110 * MS), done("right/driver", 9, 104 * MS, 113 * MS)]
    assert latencies([*made, done("fusion", 0, 102 * MS, 115 * MS)])["fusion"] == [(102 * MS, 5 * MS)]


def test_two_rooms():
    """What is made in one room is not of the other's frames."""
    made = [*reports_of("hall", 1, 100, 120, 4), *reports_of("kitchen", 1, 100, 100, 4), done("hall/tracking", 1, 107 * MS, 130 * MS)]
    assert latencies(made)["hall/tracking"] == [(107 * MS, 10 * MS)]
