"""The offset between the clocks of radars, from stamps and arrivals alone, against known offsets."""

import re

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from radar_core import ConfigError
from radar_tracking.fusion.clouds import ClockConfig, ClockMonitor

MS = 1_000_000
FRAME = 20 * MS
START = 1_700_000_000 * 10**9  # stamps count from 1970: a double has a resolution of 0.2 us there


def arrivals(offset_ns, n=600, *, seed=0, delay_ns=5 * MS, jitter_ns=2 * MS, begin_ns=0, drift=0.0, tick_ns=1):
    """(stamp, arrival) of one radar [ns]: its clock is ahead by ``offset_ns`` and runs fast by ``drift``; the delay only ever adds."""
    rng = np.random.default_rng(seed)
    true = START + begin_ns + FRAME * np.arange(n)
    arrival = true + delay_ns + np.round(rng.exponential(jitter_ns, n)).astype(np.int64)
    stamp = true + offset_ns + np.round(drift * (true - START)).astype(np.int64)
    return list(zip(stamp.tolist(), (arrival // tick_ns * tick_ns).tolist(), strict=True))


def listen(monitor, **radars):
    """Tell the monitor of all clouds in the order in which they arrive."""
    for arrival, stamp, name in sorted((arrival, stamp, name) for name, series in radars.items() for stamp, arrival in series):
        monitor.hear(name, stamp, arrival)
    return {found.name: found for found in monitor.offsets()}


def two():
    return ClockMonitor(("left", "right"))


@pytest.mark.parametrize("offset_ms", [-1000.0, -20.0, -1.0, 0.0, 0.3, 7.0, 20.0, 3_600_000.0])
@pytest.mark.parametrize("begin_ms", [0, 7], ids=["at once", "7 ms later"])
def test_a_known_offset(offset_ms, begin_ms):
    """Also of a whole frame, and of an hour; frames that begin 7 ms later are no offset."""
    found = listen(two(), left=arrivals(0, seed=1), right=arrivals(round(offset_ms * MS), seed=2, begin_ns=begin_ms * MS))
    assert (found["left"].offset, found["left"].reference, found["right"].reference) == (0.0, "left", "left")
    # the smallest of 500 delays that scatter by 2 ms (exponential) is above the least by 2 ms / 500 = 4 us on average; 40 us: e^-10
    assert found["right"].offset == pytest.approx(offset_ms * 1e-3, abs=40e-6)
    # of 100 clouds: by 20 us, and the median of five such a part of that; 0.1 ms has the probability e^-5 per part, below 1e-6 for three
    assert abs(found["right"].offset - offset_ms * 1e-3) <= found["right"].spread < 0.2e-3


@settings(max_examples=40, deadline=None)
@given(st.integers(-50 * MS, 50 * MS), st.integers(0, 30 * MS), st.integers(0, 10**6))
def test_delays_do_not_look_like_an_offset(offset, jitter, seed):
    """However much clouds are delayed now and then: the error stays below what is said of it."""
    rng = np.random.default_rng(seed)
    delayed = [(s, a + round(float(rng.pareto(1.5)) * jitter)) for s, a in arrivals(offset, seed=seed)]  # heavy tails: some come late by s
    found = listen(two(), left=arrivals(0, seed=seed + 1), right=delayed)
    if "right" in found:
        # the smallest of five parts is above the least by the same amount as the others are above it, within a factor of a few
        assert abs(found["right"].offset - offset * 1e-9) < 0.2e-3 + 3 * found["right"].spread


def test_a_load_of_seconds_is_no_offset():
    """One radar's clouds come 40 ms later for four of ten seconds: the others tell; for all ten it cannot be known, for it is a delay."""
    right = [(s, a + (40 * MS if 200 <= k < 400 else 0)) for k, (s, a) in enumerate(arrivals(0, seed=4))]
    found = listen(two(), left=arrivals(0, seed=3), right=right)
    assert abs(found["right"].offset) < 40e-6
    assert found["right"].spread < 0.3e-3


def test_a_difference_of_delays_is_part_of_the_offset():
    """What is told is the offset up to the difference of the smallest delays: nothing in stamps and arrivals tells these apart."""
    found = listen(two(), left=arrivals(0, seed=1), right=arrivals(0, seed=2, delay_ns=8 * MS))
    assert found["right"].offset == pytest.approx(-3e-3, abs=40e-6)


def test_a_clock_that_drifts():
    """Fast by 100 ppm: the offset is followed within what it drifts in a window, 1 ms, and the spread says about half of that."""
    monitor, right = two(), arrivals(0, n=3000, seed=2, drift=1e-4)
    found = listen(monitor, left=arrivals(0, n=3000, seed=1), right=right)["right"]
    # the smallest delay is that of the newest full part, which is at most two parts (4 s) behind the end of the 60 s
    assert 60e-3 * 0.1 - 4 * 1e-4 - 0.1e-3 < found.offset < 60e-3 * 0.1 + 0.1e-3
    assert 0.2e-3 < found.spread < 0.8e-3  # median of five parts of 2 s: two parts, 0.4 ms


def test_a_clock_that_is_set_right():
    """Ahead by 20 ms for 30 s, then right: while the window holds both, the old offset is told or the spread is as large."""
    monitor = two()
    left, right = arrivals(0, n=3000, seed=1), arrivals(20 * MS, n=3000, seed=2)
    right = [(s - (20 * MS if k >= 1500 else 0), a) for k, (s, a) in enumerate(right)]
    said = []
    for k, ((s1, a1), (s2, a2)) in enumerate(zip(left, right, strict=True)):
        monitor.hear("left", s1, a1)
        monitor.hear("right", s2, a2)
        found = {f.name: f for f in monitor.offsets()} if k % 50 == 49 else {}
        if "right" in found:
            said.append((k, found["right"].offset, found["right"].spread))
    for k, offset, spread in said:
        true = 0.0 if k >= 1500 + 350 else 20e-3  # 7 s later at most: three of five parts of 2 s, and the one that is not over
        assert abs(offset - true) <= spread + 0.1e-3
    assert said[-1][1] == pytest.approx(0.0, abs=40e-6)
    assert any(spread > 15e-3 for *_, spread in said)


def test_a_step_of_the_clock_of_arrival_cancels():
    """The computer's own clock is set forward by 3 s or back by 30 ms: both radars seem so much later, their difference stays."""
    for step in (3000 * MS, -30 * MS):
        left, right = ([(s, a + (step if k >= 700 else 0)) for k, (s, a) in enumerate(arrivals(o, n=1400, seed=o))] for o in (0, 9 * MS))
        monitor = two()
        for one, other in zip(left, right, strict=True):
            monitor.hear("left", *one)
            monitor.hear("right", *other)
        assert {f.name: f.offset for f in monitor.offsets()}["right"] == pytest.approx(9e-3, abs=40e-6)


def test_a_radar_that_starts_again():
    """Silent for 30 s: nothing is said of it, nor, with two radars, of anybody; back, it is known again after a window."""
    monitor = two()
    left = arrivals(0, n=4000, seed=1)
    right = [*arrivals(6 * MS, n=1000, seed=2), *arrivals(6 * MS, n=1500, seed=3, begin_ns=50_000 * MS)]
    known = []
    events = sorted((a, s, name) for name, series in (("left", left), ("right", right)) for s, a in series)
    for k, (arrival, stamp, name) in enumerate(events):
        monitor.hear(name, stamp, arrival)
        if k % 100 == 0:
            known.append(((arrival - START) * 1e-9, {f.name: f.offset for f in monitor.offsets()}))
    assert not any(found for t, found in known if t < 9.9 or 24.0 < t < 59.9)  # parts of 2 s: the gap empties one of five at once
    told = [found["right"] for t, found in known if 12.1 < t < 20.0 or t > 62.1]
    assert len(told) > 20
    np.testing.assert_allclose(told, 6e-3, atol=40e-6)


def test_one_of_three_is_silent():
    """The others are compared all the same, with the first that is known."""
    monitor = ClockMonitor(("left", "middle", "right"))
    found = listen(monitor, middle=arrivals(2 * MS, seed=1), right=arrivals(-3 * MS, seed=2))
    assert list(found) == ["middle", "right"]
    assert found["right"].reference == "middle"
    assert found["right"].offset == pytest.approx(-5e-3, abs=40e-6)


@pytest.mark.parametrize("tick_ms", [10, 20, 100])
def test_a_coarse_clock_of_arrival_is_unsure(tick_ms):
    """Simulated time that ticks: an offset within a tick is never told with certainty."""
    left, right = (arrivals(0, seed=k, begin_ns=k * 7 * MS, tick_ns=tick_ms * MS) for k in (0, 1))
    found = listen(two(), left=left, right=right)
    assert all(abs(f.offset) <= f.spread for f in found.values())
    assert all(f.spread >= tick_ms * 1e-3 for f in found.values())


def test_a_clock_that_ticks_with_the_clouds_says_nothing():
    """Arrivals as regular as never by themselves: what would be told is the clock's, not the radars'."""
    left = [(START + FRAME * k, START + FRAME * k) for k in range(600)]
    right = [(START + FRAME * k + 9 * MS, START + FRAME * k + FRAME // 2) for k in range(600)]
    assert listen(two(), left=left, right=right) == {}


def test_too_little_says_nothing():
    """Nobody, one radar, less than a window, two clouds in a part."""
    assert two().offsets() == ()
    assert listen(two(), left=arrivals(0)) == {}
    assert listen(two(), left=arrivals(0, n=450, seed=1), right=arrivals(0, n=450, seed=2)) == {}
    assert listen(two(), left=arrivals(0, seed=1), right=arrivals(0, seed=2)[::50]) == {}
    monitor = two()
    assert listen(monitor, left=arrivals(0, seed=1), right=arrivals(0, seed=2))
    monitor.forget()
    assert monitor.offsets() == ()


@pytest.mark.parametrize(
    ("knobs", "message"),
    [
        ({"window": 0.0}, "ClockConfig.window is 0; it must be between 0.1 and 3600 s"),
        ({"window": float("nan")}, "ClockConfig.window is nan"),
        ({"parts": 1}, "ClockConfig.parts is 1"),
        ({"least": 0}, "ClockConfig.least is 0"),
    ],
)
def test_settings_that_make_no_sense(knobs, message):
    """The message names the knob."""
    with pytest.raises(ConfigError, match=re.escape(message)):
        ClockConfig(**knobs)
