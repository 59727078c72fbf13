"""Tests use ROS domains of their own, this machine only, and check every message field."""

import gc
import os
import sys
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


def pytest_collection_modifyitems(items):
    """Hard cases are about numbers: which lines they reach is not counted, as tracing millions of steps takes half as long again."""
    for item in items:
        if "stability" in item.path.parts:
            item.add_marker(pytest.mark.no_cover)
