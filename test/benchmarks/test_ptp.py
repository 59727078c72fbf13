"""Clocks of two computers: the moved clock itself, the fusion node between two clocks, and linuxptp where it is installed."""

import configparser
import os
import re
import shutil
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from ros_domains import next_domain

from benchmarks.moved_clock import MovedClock
from benchmarks.ptp import QUICK, fused, steered
from benchmarks.ptp_link import SETTINGS, Link, heard
from benchmarks.report import AbsentError

pytestmark = pytest.mark.skipif(sys.platform != "linux" or shutil.which("cc") is None, reason="needs Linux and a C compiler (cc)")
FRAMES = 20e-3  # s
PAGE = Path(__file__).resolve().parents[2] / "docs" / "research" / "ptp.md"


@pytest.fixture
def link():
    """A cable between two network namespaces, or the reason why there is none."""
    try:
        with Link() as cable:
            yield cable
    except AbsentError as error:
        pytest.skip(str(error))


def under(clock, code):
    """What a program prints that has this clock."""
    command = [sys.executable, "-c", code]
    return subprocess.run(command, env={**os.environ, **clock.variables}, capture_output=True, text=True, check=True).stdout.split()


def test_only_the_system_clock_is_moved(tmp_path):
    """Ahead by an hour for programs that are told so; CLOCK_MONOTONIC is the machine's, and so is the clock of everybody else."""
    clock = MovedClock(tmp_path, 3600.0)
    before, steady = time.time_ns(), time.monotonic_ns()
    moved, same = map(int, under(clock, "import time; print(time.time_ns(), time.monotonic_ns())"))
    assert before + 3600e9 <= moved <= time.time_ns() + 3600e9
    assert steady <= same <= time.monotonic_ns()
    clock.step(-7200.0)
    before = time.time_ns()
    assert before - 3600e9 <= int(under(clock, "import time; print(time.time_ns())")[0]) <= time.time_ns() - 3600e9


def test_a_clock_that_runs_fast(tmp_path):
    """Fast by 500 ppm: what it is ahead grows by half a millisecond a second, and a program reads the same."""
    clock = MovedClock(tmp_path, 0.0, 500.0)
    first, began = clock.ahead(), time.time()
    time.sleep(0.4)
    grown, seconds = clock.ahead() - first, time.time() - began
    assert grown == pytest.approx(500e-6 * seconds, rel=0.1)
    read, steady = map(int, under(clock, "import time; print(time.time_ns(), time.monotonic_ns())"))
    ahead = read * 1e-9 - time.time() + (time.monotonic_ns() - steady) * 1e-9
    assert ahead == pytest.approx(clock.ahead(), abs=20e-3)  # between its two readings the program may have had to wait


def test_who_sets_the_clock_sets_the_moved_one(tmp_path):
    """Settings and steering of the system clock go to the moved one, as those of a program that synchronises do."""
    clock = MovedClock(tmp_path, 10.0)
    began = time.time()
    under(clock, "import time; time.clock_settime(time.CLOCK_REALTIME, time.time() - 7.0)")
    assert clock.ahead() == pytest.approx(3.0, abs=0.5)
    assert abs(time.time() - began) < 60.0
    under(
        clock,
        "import ctypes, struct; words = bytearray(208); struct.pack_into('=I4xqq', words, 0, 0x2, 0, 100 * 65536)\n"
        "buffer = (ctypes.c_char * 208).from_buffer(words); assert ctypes.CDLL(None).clock_adjtime(0, buffer) == 0",
    )
    first, began = clock.ahead(), time.time()
    time.sleep(0.3)
    assert clock.ahead() - first == pytest.approx(100e-6 * (time.time() - began), rel=0.1)


def test_a_wait_ends_by_the_moved_clock(tmp_path):
    """A condition with a deadline on the system clock is neither missed by what the clock is ahead, nor met before its time."""
    code = """
import ctypes, time
libc = ctypes.CDLL(None)
cond, mutex = ctypes.create_string_buffer(64), ctypes.create_string_buffer(64)
began, end = time.monotonic(), time.time() + 0.2
until = (ctypes.c_long * 2)(int(end), int(end % 1 * 1e9))
libc.pthread_mutex_lock(mutex)
while libc.pthread_cond_timedwait(cond, mutex, until) == 0:
    pass
print(time.monotonic() - began)
"""
    for ahead in (-3600.0, 3600.0):
        (tmp_path / str(ahead)).mkdir()
        (waited,) = under(MovedClock(tmp_path / str(ahead), ahead), code)
        assert 0.19 < float(waited) < 60.0


def test_the_page_shows_the_settings_that_were_run():
    block = re.search(r"```ini\n(.*?)```", PAGE.read_text(encoding="utf-8"), re.S)[1]
    told = configparser.ConfigParser(delimiters=(" ",))
    told.optionxform = str
    told.read_string(block)
    assert dict(told["global"]) == SETTINGS


@pytest.mark.long
@pytest.mark.parametrize("shift", [0.0, -FRAMES, 0.7], ids=["together", "a frame behind", "too far to be waited for"])
def test_the_fusion_node_tells_how_far_clocks_are_apart(shift):
    """Real processes over DDS, one of them by another clock: what the node tells is the truth, and what it fuses is what docs say."""
    found = fused(shift, QUICK, 2, domain=int(next_domain()))
    # transport and waiting differ between the two processes by milliseconds on a busy machine; the limit of the warning is 5 ms
    assert abs(found["told_ms"] - found["truth_ms"]) < 5.0
    assert (found["warned"] > 0) == bool(shift)
    assert found["fused"] > 0
    if not shift:
        assert found["of_one_radar"] == 0
        assert found["message"].count("is not waited for") == 0
    elif abs(shift) > 0.5:
        assert found["of_one_radar"] == found["fused"]  # the left one, whose stamps are behind, is not waited for
        assert "left is not waited for: its stamps are behind those of the others; synchronise the clocks" in found["message"]
    else:
        assert re.search(r"the clock of right is \d+\.\d ms behind that of left: clouds of different moments", found["message"])
        assert found["of_different_frames"] > 0
        assert found["frames_apart"] == 1


@pytest.mark.long
def test_ptp4l_over_a_virtual_cable(link, tmp_path):
    """One clock at both ends: the offset is microseconds. A clock that is 20 ms ahead: these 20 ms."""
    link.start("near")
    same = link.start("far")
    moved = MovedClock(tmp_path, 0.02)
    # stamps of the kernel: what the machine does meanwhile delays packets between stamps only within the kernel
    assert np.median([abs(one.offset) for one in heard(same, 3, 60.0)]) < 1e-3
    assert "TIME_STATUS_NP" in link.ask("GET TIME_STATUS_NP")
    same.close()
    assert np.median([one.offset for one in heard(link.start("far", variables=moved.variables), 3, 60.0)]) == pytest.approx(0.02, abs=1e-3)


@pytest.mark.long
def test_ptp4l_sets_the_clock_of_the_second_radar_right():
    """Before it acts, it and the fusion node tell the same offset; afterwards the clock is right and the node is content."""
    try:
        found = steered(QUICK, 3, domain=int(next_domain()))
    except AbsentError as error:
        pytest.skip(str(error))
    assert found["before_truth_ms_median"] > 20.0
    assert found["before_warned"] > 0
    assert found["before_ptp_error_us_p95"] < 1e3
    assert found["before_fusion_error_ms_median"] < 5.0
    assert found["after_truth_us_p95"] < 1e3
    assert abs(found["after_fusion_told_ms_median"]) < 5.0
    assert found["after_warned"] == 0
