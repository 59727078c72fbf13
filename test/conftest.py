"""Tests use ROS domains of their own, this machine only, and check every message field."""

import gc
import os
import sys
import zlib
from pathlib import Path

import pytest
from hypothesis import settings

sys.path.insert(0, str(Path(__file__).parent))  # oracles, for every test

from ros_domains import next_domain

os.environ["ROS_DOMAIN_ID"] = next_domain()  # before anything imports rclpy or messages
os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"
os.environ["ROS_PYTHON_CHECK_FIELDS"] = "1"
for _pool in ("OMP", "OPENBLAS", "MKL"):
    os.environ.setdefault(f"{_pool}_NUM_THREADS", "1")

# Examples of a property whose test names no number; `make test ARGS="--hypothesis-profile many"` looks harder.
settings.register_profile("usual", max_examples=30, deadline=None)
settings.register_profile("many", max_examples=1000, deadline=None)
settings.load_profile("usual")

_FILES = ("clouds_graph", "graph", "launch", "machine", "recovery", "several_rooms", "supervisor", "two_radars", "watchdog")
_QUICK_GRAPHS = ("[budget]", "[faults]", "[graph]", "[load_steps]", "[ptp]", "[small]", "[soak]", "[view]")
_PLACES = ("app/", "benchmarks/test_ptp.py", "e2e/", "logger/test_logger_page", "tradeoff/", "view/")
_GRAPHS = (*_PLACES, *(f"ros/test_{name}.py" for name in _FILES))


def pytest_addoption(parser):
    parser.addoption("--part", type=_part, default=(1, 1), metavar="K/N", help="of N parts of the long tests only the Kth; the others all")


def _part(text):
    """Two whole numbers, the first at most the second."""
    part, parts = (int(number) for number in text.split("/"))
    if not 1 <= part <= parts:
        raise ValueError(f"--part {text}: there is no such part")
    return part, parts


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_make_scheduler(config, log):
    """With ``-n``: graphs of many processes run one at a time, and no other file is split, so that its fixtures are made once."""
    from xdist.scheduler import LoadScopeScheduling

    class WholeFiles(LoadScopeScheduling):
        def _split_scope(self, nodeid):
            place = nodeid.partition("::")[0].removeprefix("test/")
            if place == "benchmarks/test_quick_runs.py":  # minutes each, and nothing that they share but, some of them, a ROS domain
                return "graphs" if nodeid.endswith(_QUICK_GRAPHS) else nodeid
            return "graphs" if place.startswith(_GRAPHS) else place

    return WholeFiles(config, log)


def pytest_collection_finish():
    """What is imported and collected stays to the end: no later look for garbage walks over it again (half a million objects)."""
    gc.collect()
    gc.freeze()


def pytest_collection_modifyitems(config, items):
    """Hard cases are about numbers: which lines they reach is not counted, as tracing millions of steps takes half as long again."""
    for item in items:
        if "stability" in item.path.parts:
            item.add_marker(pytest.mark.no_cover)
    part, parts = config.getoption("part")
    others = [item for item in items if "long" in item.keywords and _drawn(item) % parts != part - 1]
    if others:
        config.hook.pytest_deselected(items=others)
        left_out = set(others)
        items[:] = [item for item in items if item not in left_out]


def _drawn(item):
    """A number by chance that stays: files are not split, but for the quick runs of studies."""
    place = item.nodeid.partition("::")[0]
    return zlib.crc32((item.nodeid if place.endswith("test_quick_runs.py") else place).encode())
