"""The thread that reads a device: the newest wins, a lost device is opened again, and nothing survives the end."""

import threading
import time

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from radar_core import DataError, DeviceError, RadarFrame, RadarInfo
from radar_driver.live import Reader
from radar_driver.sources import Reading


def reading(sequence):
    return Reading(RadarFrame(np.zeros((1, 1, 1, 1), np.complex64), sequence, sequence, "radar"))


class Script:
    """A device that does what it is told: numbers are frames, errors are raised, ``wait`` gives nothing for a while, ``block`` waits."""

    def __init__(self, steps=(), power=()):
        self.info = RadarInfo()
        self.steps, self.power = list(steps), list(power)
        self.calls, self.threads = [], set()
        self.more = threading.Event()

    def _call(self, name):
        self.calls.append(name)
        self.threads.add(threading.current_thread().name)

    def power_up(self):
        self._call("power_up")
        if self.power and (error := self.power.pop(0)) is not None:
            raise error

    def resume(self):
        self._call("resume")

    def suspend(self):
        self._call("suspend")

    def power_down(self):
        self._call("power_down")

    def read(self, timeout):
        if not self.steps:
            self.more.wait(timeout)
            return None
        step = self.steps.pop(0)
        if isinstance(step, Exception):
            raise step
        if step == "wait":
            time.sleep(0.01)
            return None
        return reading(step)

    def report(self):
        return {}


def wait(wanted, timeout=5.0):
    end = time.monotonic() + timeout
    while time.monotonic() < end:
        if wanted():
            return True
        time.sleep(0.002)
    return False


@pytest.fixture
def run():
    """Start readers; each is stopped, and no thread may be left."""
    readers, before = [], threading.active_count()

    def make(device, notify=lambda: None, **named):
        readers.append(Reader(device, notify, **{"again": 0.01, **named}))
        readers[-1].start()
        return readers[-1]

    yield make
    for reader in readers:
        reader.stop()
    assert threading.active_count() == before


def test_the_newest_wins(run):
    """Of what nobody took in time only the last stays; the others are counted; nothing is given twice."""
    device = Script([0, 1, 2, 3])
    reader = run(device)
    assert wait(lambda: not device.steps)
    assert wait(lambda: reader.replaced == 3)
    assert reader.take().data.sequence == 3
    assert reader.take() is None


def test_every_reading_is_told(run):
    """Whoever takes at every note misses none."""
    got, device = [], Script()
    holder = {}
    holder["reader"] = reader = run(device, lambda: got.append(holder["reader"].take()))
    device.steps = list(range(50))
    assert wait(lambda: len(got) == 50)
    assert [r.data.sequence for r in got] == list(range(50))
    assert reader.replaced == 0


def test_an_error_that_passes(run):
    """It is counted and told, the device stays open, and the next frame clears the problem."""
    device = Script([0, DeviceError("a frame was broken"), "wait"])
    reader = run(device)
    assert wait(lambda: reader.problem == "a frame was broken")
    assert device.calls == ["resume"]
    device.steps = [1]
    assert wait(lambda: reader.problem == "")
    assert reader.take().data.sequence == 1
    assert reader.counts == {"errors": 1}


def test_a_lost_device_is_opened_again(run):
    """Powered down, tried again and again with the reason of the last failure, and resumed once it is there."""
    device = Script([0, DeviceError("unplugged", gone=True)], power=[DeviceError("not there"), DeviceError("still not there"), None])
    problems, holder = [], []
    reader = run(device, lambda: problems.extend(one.problem for one in holder))
    holder.append(reader)
    assert wait(lambda: reader.counts["reopened"] == 1)
    device.steps = [7]
    assert wait(lambda: (taken := reader.take()) is not None and taken.data.sequence == 7)
    assert reader.problem == ""
    assert reader.counts == {"errors": 3, "reopened": 1}
    assert device.calls == ["resume", *["power_down", "power_up"] * 3, "resume"]
    assert problems[-1] == ""


def test_a_failing_resume_counts_as_lost(run):
    """The device is back but does not start: powered down and tried again."""
    device = Script([DeviceError("gone", gone=True)])
    failures = [DeviceError("no lock")]
    start = device.resume

    def resume():
        start()
        if device.calls.count("resume") > 1 and failures:
            raise failures.pop()

    device.resume = resume
    reader = run(device)
    assert wait(lambda: reader.counts["reopened"] == 1)
    assert device.calls == ["resume", "power_down", "power_up", "resume", "power_down", "power_up", "resume"]


def test_data_that_makes_no_sense_is_an_error_that_passes(run):
    """Any error of the family, not only a device's."""
    device = Script([DataError("a frame with a hole")])
    reader = run(device)
    assert wait(lambda: reader.problem == "a frame with a hole")
    device.steps = [3]
    assert wait(lambda: reader.take() is not None)


@pytest.mark.filterwarnings("ignore::pytest.PytestUnhandledThreadExceptionWarning")
def test_a_fault_of_the_program_is_told(run):
    """The thread ends with its traceback, and the problem says that nothing will come any more."""
    device = Script([ZeroDivisionError("by zero")])
    reader = run(device)
    assert wait(lambda: "fault of this program" in reader.problem)
    assert "ZeroDivisionError" in reader.problem
    reader.stop()
    assert "suspend" in device.calls


def test_stop_while_reading_waits():
    """The thread ends, the device is suspended, in the thread that read; twice is harmless; it can start again."""
    device = Script()
    reader = Reader(device, lambda: None)
    reader.start()
    assert wait(lambda: "device reader" in [t.name for t in threading.enumerate()])
    reader.stop()
    reader.stop()
    assert "device reader" not in [t.name for t in threading.enumerate()]
    assert device.calls == ["resume", "suspend"]
    device.steps = [5]
    reader.start()
    assert wait(lambda: reader.take() is not None)
    reader.stop()
    assert device.calls == ["resume", "suspend"] * 2


def test_stop_while_it_is_lost():
    """It does not wait for the next attempt, and does not suspend what is powered down."""
    device = Script([DeviceError("gone", gone=True)], power=[DeviceError("not there")] * 1000)
    reader = Reader(device, lambda: None, again=30.0)
    reader.start()
    assert wait(lambda: "power_down" in device.calls)
    started = time.monotonic()
    reader.stop()
    assert time.monotonic() - started < 10.0  # far less than the pause
    assert device.calls == ["resume", "power_down"]


def test_a_device_that_does_not_start():
    """The error comes out of `start`, and there is no thread."""
    device, before = Script(), threading.active_count()

    def refuse():
        raise DeviceError("no lock")

    device.resume = refuse
    reader = Reader(device, lambda: None)
    with pytest.raises(DeviceError, match="no lock"):
        reader.start()
    reader.stop()
    assert threading.active_count() == before


def test_a_device_that_cannot_be_suspended(run):
    """Its thread ends all the same, and the problem is told."""
    device = Script()

    def refuse():
        raise DeviceError("it does not stop")

    device.suspend = refuse
    reader = run(device)
    reader.stop()
    assert reader.problem == "it does not stop"


steps = st.lists(st.one_of(st.integers(0, 99), st.sampled_from(["wait", "passing", "gone"])), max_size=12)


@pytest.mark.long
@settings(max_examples=30, deadline=None)
@given(steps=steps)
def test_whatever_happens_it_goes_on_and_ends(steps):
    """Errors of both kinds in any order: all of them are counted, every loss is mended, and the last frame is there at the end."""
    kinds = {"passing": lambda: DeviceError("broken"), "gone": lambda: DeviceError("gone", gone=True)}
    device = Script([kinds[s]() if s in kinds else s for s in steps] + [1234])
    reader = Reader(device, lambda: None, again=0.0)
    reader.start()
    assert wait(lambda: not device.steps)
    reader.stop()
    assert reader.take().data.sequence == 1234
    assert reader.counts["errors"] == sum(s in kinds for s in steps)
    assert reader.counts["reopened"] == steps.count("gone")
    assert reader.problem == ""
    assert device.calls.count("power_up") == device.calls.count("power_down") == steps.count("gone")
    assert device.calls[-1] == "suspend"
