"""Hazards of comparing clocks: long runs, stamps at the ends of time, bursts, arrivals out of order, clocks that jump about."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from radar_tracking.fusion.clouds import ClockConfig, ClockMonitor

MS = 1_000_000
LARGEST = (2**31) * 10**9 - 1  # the largest stamp of a message


def feed(monitor, offset_ns, frames, *, start_ns=0, seed=0, interval_ns=20 * MS):
    """Two radars, the second one's clock ahead; delays of 5 ms and more."""
    rng = np.random.default_rng(seed)
    wait = rng.exponential(2 * MS, (frames, 2)).astype(np.int64).tolist()
    for k in range(frames):
        true = start_ns + k * interval_ns
        monitor.hear("left", true, true + 5 * MS + wait[k][0])
        monitor.hear("right", true + offset_ns, true + 5 * MS + wait[k][1])


def test_half_an_hour_does_not_grow():
    """90 000 clouds of each radar leave one window behind, and the answer is as good as after ten seconds."""
    monitor = ClockMonitor(("left", "right"))
    feed(monitor, 3 * MS, 90_000, start_ns=10**18)
    assert len(monitor._parts) <= monitor.config.parts + 1
    assert sum(len(part.arrivals) for part in monitor._parts.values()) <= 64 * (monitor.config.parts + 1)
    assert abs(monitor.offsets()[1].offset - 3e-3) < 40e-6


def test_a_burst_of_a_hundred_thousand_clouds():
    """All within a second: nothing is known of the window, and nothing piles up."""
    monitor = ClockMonitor(("left", "right"))
    feed(monitor, 0, 100_000, interval_ns=10_000)
    assert monitor.offsets() == ()
    assert len(monitor._parts) <= 2


def test_offsets_of_any_size_keep_their_microseconds():
    """From nothing to the whole of time: the difference is of integers, not of floats of 1e18."""
    for start, offset in ((0, 0), (0, LARGEST - 20 * 10**9), (LARGEST - 20 * 10**9, -(LARGEST - 20 * 10**9)), (10**18, 1000)):
        monitor = ClockMonitor(("left", "right"))
        feed(monitor, offset, 600, start_ns=start)
        (_, found) = monitor.offsets()
        # a double of 2e9 s has a resolution of 0.24 us, the smallest delays differ by up to 40 us
        assert abs(found.offset - offset * 1e-9) < 41e-6


@pytest.mark.parametrize("offset_ns", [0, 1, 1000])
def test_small_offsets_beside_large_ones_keep_every_digit(offset_ns):
    """Radars whose clouds wait alike, but 50 years behind the clock of arrival: a nanosecond is a nanosecond, not the 240 of a double."""
    monitor, behind = ClockMonitor(("left", "right")), 16 * 10**17 + 123_456_789
    waits = np.random.default_rng(4).exponential(2 * MS, 600).astype(np.int64).tolist()
    for k, wait in enumerate(waits):
        monitor.hear("left", k * 20 * MS, behind + k * 20 * MS + wait)
        monitor.hear("right", k * 20 * MS + offset_ns, behind + k * 20 * MS + wait)
    assert monitor.offsets()[1].offset == pytest.approx(offset_ns * 1e-9, abs=1e-15)


def test_arrivals_out_of_order_and_a_clock_that_goes_back():
    """Neighbours in the wrong order change nothing; a clock of arrival that starts again begins anew."""
    monitor, ordered = ClockMonitor(("left", "right")), ClockMonitor(("left", "right"))
    rng = np.random.default_rng(3)
    events = [
        (name, k * 20 * MS + ahead, k * 20 * MS + 5 * MS + int(rng.exponential(2 * MS)))
        for k in range(600)
        for name, ahead in (("left", 0), ("right", 7 * MS))
    ]
    for event in events:
        ordered.hear(*event)
    for i in range(0, len(events), 8):
        for j in rng.permutation(min(8, len(events) - i)):
            monitor.hear(*events[i + j])
    assert [(f.name, f.offset) for f in monitor.offsets()] == [(f.name, f.offset) for f in ordered.offsets()]
    monitor.hear("left", 0, 0)
    assert monitor.offsets() == ()
    assert list(monitor._parts) == [0]


@settings(max_examples=80, deadline=None)
@given(
    st.lists(st.tuples(st.sampled_from("abc"), st.integers(0, LARGEST), st.integers(0, LARGEST)), max_size=80),
    st.sampled_from([0.1, 1.0, 3600.0]),
    st.integers(2, 7),
)
def test_whatever_comes(events, window, parts):
    """Any stamps and arrivals: what is told is finite, never surer than sure, and the reference is off itself by nothing."""
    monitor = ClockMonitor("abc", ClockConfig(window=window, parts=parts, least=1))
    for event in events:
        monitor.hear(*event)
        told = monitor.offsets()
        assert len(told) != 1
        assert all(np.isfinite([f.offset, f.spread]).all() and f.spread >= 0 for f in told)
        assert all(f.offset == 0 for f in told if f.name == f.reference)
        assert len(monitor._parts) <= parts + 2


@settings(max_examples=40, deadline=None)
@given(st.lists(st.integers(0, 40), min_size=50, max_size=400), st.integers(-30, 30))
def test_dense_arrivals_of_few_distinct_times(delays, offset_ms):
    """Delays of whole milliseconds: a clock that coarse is told as such, and no offset is surer than its tick."""
    monitor = ClockMonitor(("left", "right"), ClockConfig(window=0.5, parts=2, least=1))
    for k, delay in enumerate(delays):
        monitor.hear("left", 20 * k * MS, (20 * k + delay) * MS)
        monitor.hear("right", (20 * k + offset_ms) * MS, (20 * k + delays[-k]) * MS)
        assert all(f.spread >= 1e-3 for f in monitor.offsets())
