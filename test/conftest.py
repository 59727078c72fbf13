"""Tests use ROS domains of their own, this machine only, and check every message field."""

import os
from pathlib import Path

import pytest

# Before anything imports rclpy or messages. The process id keeps parallel workers and parallel runs of the suite apart. Domains above
# 101 have ports that the system also gives to anybody who asks for any port.
os.environ["ROS_DOMAIN_ID"] = str(10 + os.getpid() % 40)
os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"
os.environ["ROS_PYTHON_CHECK_FIELDS"] = "1"
for _pool in ("OMP", "OPENBLAS", "MKL"):
    os.environ.setdefault(f"{_pool}_NUM_THREADS", "1")

_GRAPHS = ("e2e/", "tradeoff/", *(f"ros/test_{name}.py" for name in ("clouds_graph", "graph", "recovery", "supervisor", "two_radars")))


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(config, items):
    """With ``--dist loadgroup``: graphs of many processes run one at a time, and no file is split, so that its fixtures are made once."""
    if config.getoption("dist", "no") != "loadgroup" and os.environ.get("PYTEST_XDIST_WORKER") is None:
        return
    for item in items:
        place = item.path.relative_to(Path(__file__).parent).as_posix()
        item.add_marker(pytest.mark.xdist_group("graphs" if place.startswith(_GRAPHS) else place))
