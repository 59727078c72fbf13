"""Parts of the benchmark of small devices: a process that is slowed, levels over time, intervals of ratios."""

import subprocess
import sys
import time

import numpy as np
import psutil
import pytest

from benchmarks.report import share_interval
from benchmarks.slowed import QUOTA, TURNS, slowed
from benchmarks.small import level_shares, ratio_interval, scene_file
from radar_sim import load_scene


@pytest.mark.long
def test_a_process_gets_its_share_of_a_core_and_goes_on_afterwards():
    """A busy loop; on a busy machine it gets less, never more."""
    with subprocess.Popen([sys.executable, "-c", "import sys\nprint(flush=True)\nwhile True: pass"], stdout=subprocess.PIPE) as busy:
        try:
            busy.stdout.readline()
            process, core = psutil.Process(busy.pid), max(psutil.Process().cpu_affinity())
            with slowed(busy.pid, 3.0, core) as slowing:
                before, began = process.cpu_times().user, time.monotonic()
                time.sleep(1.5)
                used, wall = process.cpu_times().user - before, time.monotonic() - began
                assert process.cpu_affinity() == [core]
            assert slowing.how in (QUOTA, TURNS)
            assert 0.25 < slowing.on < 0.4
            assert 0 < used < 0.45 * wall
            assert process.status() != psutil.STATUS_STOPPED
        finally:
            busy.kill()


def test_a_process_that_ends_while_it_is_slowed_is_no_error():
    """The context ends as usual."""
    command, core = [sys.executable, "-c", "import time; time.sleep(9)"], max(psutil.Process().cpu_affinity())
    with subprocess.Popen(command) as short, slowed(short.pid, 3.0, core):
        short.kill()
        short.wait()
        time.sleep(0.05)


def test_levels_are_shares_of_the_time():
    """What was told before the time counts from its begin."""
    told = [(0.0, "a", "best"), (12.0, "a", "worse"), (15.0, "a", "best"), (1.0, "b", "only")]
    assert level_shares(told, 10.0, 20.0) == {"a": {"best": pytest.approx(0.7), "worse": pytest.approx(0.3)}, "b": {"only": 1.0}}


def test_the_interval_of_a_ratio_holds_it():
    """Two shares of 60 trials each, a thousand times: the true ratio is within 95 % of the intervals, or a little less."""
    random, n = np.random.default_rng(1), 60
    part, other = random.binomial(n, 0.85, 1000), random.binomial(n, 0.93, 1000)
    inside = [low <= 0.85 / 0.93 <= high for low, high in (ratio_interval(p, q, n) for p, q in zip(part, other, strict=True))]
    assert 0.93 < np.mean(inside) < 0.98
    low, high = share_interval(n, n)
    assert ratio_interval(n, n, n) == pytest.approx((low, high / low))


def test_scenes_have_another_rate_and_seed(tmp_path):
    """The rest stays."""
    usual, made = load_scene("demo"), load_scene(scene_file(tmp_path, "demo", 3))
    assert made.radars[0].waveform.frame_interval == 0.04
    assert (made.seed, made.people, made.effects) == (3, usual.people, usual.effects)
