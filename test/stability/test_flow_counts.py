"""Counts and clocks by which `radar_app.flow` finds nodes that hear nothing: of any size, falling, standing still, and for long."""

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from radar_app.flow import Flows

LABELS = ("driver", "baseband", "tracking")
STEP = 0.2  # s: between two looks
LIFE = 30.0  # s


def look(flows, now, *counts, pid=1):
    """One look at all nodes, which have processed ``counts`` messages and dropped none."""
    return flows.look({label: (pid, (count, 0)) for label, count in zip(LABELS, counts, strict=True)}, now)


def fresh():
    """Flows whose time begins at 0."""
    flows = Flows(LABELS)
    flows.look({}, 0.0)
    return flows


def begin():
    """Nodes of one life that all have worked for long; gives the flows, the time, and how many messages they have had."""
    flows, now, most = fresh(), 0.0, round(LIFE / STEP)
    for count in range(most + 1):
        now += STEP
        assert look(flows, now, count, count, count) == {}
    return flows, now, most


def test_messages_that_were_there_at_once_count():
    """Whoever has worked before the first look is found, too."""
    flows, now = fresh(), 0.0
    look(flows, now, 100, 100, 100)
    found = {}
    for count in range(101, 101 + round(2 * LIFE / STEP)):
        now += STEP
        found |= look(flows, now, count, 100, 100)
    assert list(found) == ["baseband"]


@pytest.mark.parametrize("jump", [0.0, 1e-9, 3600.0, 1e9])
def test_a_clock_that_stands_still_or_jumps_accuses_nobody(jump):
    """A machine that slept, told or not: nobody could have heard anything meanwhile."""
    for told in (False, True):
        flows, now, count = begin()
        if told:
            flows.rest(jump)
        for k in range(100):
            now += jump if k == 0 else 0.0
            assert look(flows, now, count, count, count) == {}
        for more in range(count + 1, count + 1 + round(LIFE / STEP)):
            now += STEP
            assert look(flows, now, more, more, more) == {}


def test_counts_near_the_end_of_64_bits():
    """Counts of years: who hears nothing is found, who goes on is not."""
    flows, now, most = fresh(), 0.0, 2**64 - 200
    found = {}
    for k in range(round(LIFE / STEP)):
        now += STEP
        found |= look(flows, now, most + k, most + k, most + k)
    assert found == {}
    for k in range(round(LIFE / STEP), 2 * round(LIFE / STEP)):
        now += STEP
        found |= look(flows, now, most + k, most + k, most)
    assert list(found) == ["tracking"]


def test_a_hundred_thousand_looks_leave_nothing_behind():
    """Five and a half hours: nobody is accused, nothing is kept for each look, and the mean interval is that of the messages."""
    flows, now = fresh(), 0.0
    for count in range(100_000):
        now += STEP
        assert not look(flows, now, count, count, count)
    assert len(flows._flows) == len(LABELS)
    for flow in flows._flows.values():
        assert flow.interval == pytest.approx(STEP, rel=1e-4)


numbers = st.integers(0, 2**70) | st.integers(0, 20)
looks = st.lists(st.tuples(st.sampled_from((0.0, 1e-9, STEP, 11.0, 1e9)), numbers, numbers, numbers, st.integers(1, 2)), max_size=40)


@settings(max_examples=200, deadline=None, derandomize=True)
@given(looks)
def test_whatever_is_told(told):
    """Counts that fall, processes that change: no error, and whoever has nobody before them is never accused."""
    flows, now = fresh(), 0.0
    for step, *counts, pid in told:
        now += step
        found = look(flows, now, *counts, pid=pid)
        assert "driver" not in found
        assert all("heard nothing" in why for why in found.values())


def test_each_is_found_three_times_at_most_however_long_it_lasts():
    """Ten hours of silence: what does not help is not done for ever."""
    flows, now, count = begin()
    found = []
    for k in range(1, 36_001):  # s: messages come without a pause as they do with `STEP`
        found += look(flows, now + k, count + k, count, count)
    assert found == ["baseband"] * 3
