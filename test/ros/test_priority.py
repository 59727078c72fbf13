"""Who looks at results gives way to the nodes that make them: a process, and its session where it has one of its own."""

import subprocess
import sys
from pathlib import Path

import pytest

_CODE = """
import os
from pathlib import Path
from radar_ros.priority import give_way
give_way(7)
print(os.nice(0))
print(Path("/proc/self/autogroup").read_text())
"""


def _autogroup() -> list[str]:
    """What this process's autogroup says: nothing where there is none, or where a control group took its place."""
    told = Path("/proc/self/autogroup")
    return told.read_text(encoding="utf-8").split() if told.exists() else []


@pytest.mark.skipif(not _autogroup(), reason="this process has no autogroup")
@pytest.mark.parametrize("own", [True, False])
def test_a_process_gives_way(own):
    """A session of its own yields as a whole; that of somebody's shell stays as it was."""
    before = _autogroup()[-1]
    told = subprocess.run([sys.executable, "-c", _CODE], capture_output=True, text=True, start_new_session=own, check=True).stdout.split()
    assert int(told[0]) >= 7
    assert told[-1] == ("7" if own else before)


@pytest.mark.usefixtures("own_domain")
@pytest.mark.parametrize(("kinds", "wanted"), [(("evaluation",), 5), (("evaluation", "zones"), 0)])
def test_a_node_that_looks_gives_way_alone_only(kinds, wanted):
    """In a process of its own; in one process with who makes results, nobody gives way."""
    code = f"""
import os, importlib, signal
from radar_ros import stage
before = os.nice(0)
def make():
    node = stage.rclpy.create_node("last")
    node.close = lambda: None
    node.gives_way = 9
    node.create_timer(0.1, lambda: os.kill(os.getpid(), signal.SIGINT))
    return node
makers = [importlib.import_module("radar_ros.nodes." + kind).make_node for kind in {kinds!r}]
stage.run(*makers, make)
print(os.nice(0) - before)
"""
    told = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, start_new_session=True, check=True, timeout=60)
    assert told.stdout.split()[-1] == str(wanted)
