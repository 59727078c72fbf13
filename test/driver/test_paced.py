"""Recordings and scenes in their own time: each frame when it has ended, late ones left out, on whatever clock."""

import dataclasses
import time

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from radar_core import ConfigError, DataError, RadarFrame, RadarInfo
from radar_driver.boards import board
from radar_driver.paced import Paced
from radar_driver.sources import Context
from radar_sim import Simulator, load_scene

MS = 1_000_000
SCENE = "duration: 0.2\nseed: 3\npoints: [{position: [2.0, 0.5, 1.4], rcs: 0.1}]\neffects: {noise: {}}\n"


class Clock:
    """Time that stands where the test puts it."""

    def __init__(self, now):
        self.now = now

    def __call__(self):
        return self.now


class Numbers:
    """Frames that say their place; those named in ``broken`` cannot be read."""

    def __init__(self, n_frames=10, *, interval=0.02, delay=0.0, broken=(), takes=0.0):
        self.info = RadarInfo()
        self.n_frames, self.interval, self.delay, self.broken, self.takes = n_frames, interval, delay, broken, takes
        self.made, self.closed = [], 0

    def frame(self, number):
        if number in self.broken:
            raise DataError(f"frame {number} is broken")
        self.made.append(number)
        time.sleep(self.takes)
        return RadarFrame(np.full((1, 1, 1, 1), number, np.complex64), number * 20 * MS, number, "radar"), None

    def close(self):
        self.closed += 1


def paced(frames, start=1000 * MS, **context):
    """A source that runs, and its clock."""
    clock = Clock(start)
    source = Paced(frames, Context(clock=clock, nap=1e-3, **context))
    source.power_up()
    frames.made.clear()
    source.resume()
    return source, clock


def place(reading):
    return int(reading.data.cube.real.item())


def test_each_frame_comes_when_it_has_ended():
    """Not a nanosecond before; stamped with its start; the next one is made in time, the one after it is not."""
    frames = Numbers()
    source, clock = paced(frames)
    for number in range(5):
        clock.now = 1000 * MS + (number + 1) * 20 * MS - 1
        assert source.read(0.0) is None
        assert frames.made == list(range(number + 1))
        clock.now += 1
        reading = source.read(0.0)
        assert (place(reading), reading.data.sequence, reading.data.stamp_ns) == (number, number, 1000 * MS + number * 20 * MS)
        assert frames.made == list(range(number + 1))


def test_the_next_frame_is_made_late():
    """In the last quarter of the interval where it takes no time: until then others work on the one before."""
    frames = Numbers()
    source, clock = paced(frames)
    clock.now += 20 * MS
    assert source.read(0.0) is not None
    frames.made.clear()
    clock.now += 15 * MS - 1
    assert source.read(0.0) is None
    assert frames.made == []
    clock.now += 1
    assert source.read(0.0) is None
    assert frames.made == [1]


@pytest.mark.parametrize(("takes", "latest"), [(0.004, 10 * MS), (0.05, int(2.5 * MS))])
def test_a_frame_that_takes_long_is_made_sooner(takes, latest):
    """So that it is there when it is due; but for an eighth of the interval, in which the last one is published, nothing is made."""
    frames = Numbers(takes=takes)
    source, clock = paced(frames)
    clock.now += 20 * MS
    assert source.read(0.0) is not None
    frames.made.clear()
    clock.now += int(2.5 * MS) - 1
    assert source.read(0.0) is None
    assert frames.made == []
    clock.now += 1 + latest - int(2.5 * MS)
    assert source.read(0.0) is None
    assert frames.made == [1]


def test_late_frames_are_left_out_and_counted():
    """The newest comes; the gap in the sequence is what was skipped."""
    source, clock = paced(Numbers())
    clock.now += 75 * MS
    reading = source.read(0.0)
    assert (place(reading), reading.data.sequence, reading.data.stamp_ns) == (2, 2, 1040 * MS)
    assert source.report()["skipped"] == 2


def test_it_begins_again_where_it_ends():
    """The pace and the sequence go on; the turn says so."""
    source, clock = paced(Numbers(3))
    got = []
    for _ in range(8):
        clock.now += 20 * MS
        got.append(source.read(0.0))
    assert [place(r) for r in got] == [0, 1, 2, 0, 1, 2, 0, 1]
    assert [r.turn for r in got] == [0, 0, 0, 1, 1, 1, 2, 2]
    assert [r.data.sequence for r in got] == list(range(8))
    assert np.all(np.diff([r.data.stamp_ns for r in got]) == 20 * MS)


def test_a_suspended_source_keeps_its_place():
    """Time that passes meanwhile is no loss."""
    source, clock = paced(Numbers())
    clock.now += 20 * MS
    assert place(source.read(0.0)) == 0
    source.suspend()
    clock.now += 5000 * MS
    source.resume()
    assert source.read(0.0) is None
    clock.now += 20 * MS
    reading = source.read(0.0)
    assert (place(reading), reading.data.sequence) == (1, 1)
    assert source.report() == {"state": "running", "skipped": 0}


def test_simulated_time():
    """A clock at 0 is not heard yet; the jump from there, and one back, lose nothing."""
    source, clock = paced(Numbers(), start=0)
    assert source.read(0.0) is None
    clock.now = 777 * MS
    assert source.read(0.0) is None
    clock.now += 20 * MS
    assert source.read(0.0).data.stamp_ns == 777 * MS
    clock.now = 100 * MS
    assert source.read(0.0) is None
    clock.now += 20 * MS
    reading = source.read(0.0)
    assert (place(reading), reading.data.sequence, reading.data.stamp_ns) == (1, 1, 100 * MS)


def test_trigger_offset_drift_and_rate():
    """The first frame is late by the offset, all are apart by the device's own interval; at twice the rate both are half as long."""
    for rate in (1.0, 2.0):
        source, clock = paced(Numbers(interval=0.02002, delay=0.005), rate=rate)
        stamps = []
        while len(stamps) < 5:
            clock.now += MS // 2
            if (reading := source.read(0.0)) is not None:
                stamps.append(reading.data.stamp_ns - 1000 * MS)
        np.testing.assert_allclose(stamps, (5 * MS + np.arange(5) * 20.02 * MS) / rate, atol=1)


def test_a_frame_that_cannot_be_read_is_left_behind():
    """The error is told once, and the next frame comes in its time."""
    frames = Numbers(broken=(6,))
    source, clock = paced(frames)
    clock.now += 6 * 20 * MS
    assert place(source.read(0.0)) == 5
    clock.now += 10 * MS  # it is made beforehand: no reason to say so before its time
    assert source.read(0.0) is None
    assert source.read(0.0) is None
    clock.now += 10 * MS
    with pytest.raises(DataError, match="frame 6"):
        source.read(0.0)
    clock.now += 20 * MS
    assert place(source.read(0.0)) == 7


@given(steps=st.lists(st.integers(0, 90), min_size=1, max_size=40), n_frames=st.integers(1, 7))
def test_whatever_the_reader_does(steps, n_frames):
    """Sequence, place, turn and stamp belong together; what is missing in the sequence was counted."""
    source, clock = paced(Numbers(n_frames))
    got = []
    for step in steps:
        clock.now += step * MS
        if (reading := source.read(0.0)) is not None:
            assert reading.data.stamp_ns + 20 * MS <= clock.now < reading.data.stamp_ns + 40 * MS
            got.append(reading)
    for reading in got:
        turn, number = divmod(reading.data.sequence, n_frames)
        assert (reading.turn, place(reading)) == (turn, number)
        assert reading.data.stamp_ns == 1000 * MS + reading.data.sequence * 20 * MS
    if got:
        assert source.report()["skipped"] == got[-1].data.sequence + 1 - len(got)


def test_a_simulated_radar_is_its_simulator(tmp_path):
    """The samples bit for bit; truth in the middle of the frame on the same clock; power down closes."""
    path = tmp_path / "brief.yaml"
    path.write_text(SCENE)
    sim, clock = board("sim"), Clock(1000 * MS)
    source = sim.source(sim.config(scene=str(path)), Context(clock=clock))
    source.power_up()
    source.resume()
    simulator = Simulator(load_scene(path))
    for number in range(3):
        clock.now += 20 * MS
        reading, expected = source.read(0.0), simulator.process(number)
        assert reading.data.cube.tobytes() == expected.frame.cube.tobytes()
        assert reading.truth.sequence == number
        assert reading.truth.stamp_ns - reading.data.stamp_ns == source.info.waveform.acquisition_ns // 2
        assert dataclasses.replace(expected.frame, stamp_ns=reading.data.stamp_ns).sequence == reading.data.sequence
    source.power_down()
    assert source.report()["state"] == "off"


def test_nothing_to_give():
    """A scene shorter than a frame is refused where it is opened."""
    with pytest.raises(ConfigError, match="shorter than one frame interval"):
        Paced(Numbers(0), Context())
