"""The page gives way to the nodes: its niceness, and where it is a session of its own that of the session."""

import subprocess
import sys
from pathlib import Path

import pytest

from radar_app import view_commands

_CODE = """
import os
from pathlib import Path
from radar_app.view_commands import _yield_to_graph
_yield_to_graph()
print(os.nice(0))
print(Path("/proc/self/autogroup").read_text())
"""


def _autogroup() -> list[str]:
    """What this process's autogroup says: nothing where there is none, or where a control group took its place."""
    told = Path("/proc/self/autogroup")
    return told.read_text(encoding="utf-8").split() if told.exists() else []


@pytest.mark.skipif(not _autogroup(), reason="this process has no autogroup")
@pytest.mark.parametrize("own", [True, False])
def test_the_page_yields(own):
    """A session of its own yields as a whole; that of somebody's shell stays as it was."""
    before = _autogroup()[-1]
    told = subprocess.run([sys.executable, "-c", _CODE], capture_output=True, text=True, start_new_session=own, check=True).stdout.split()
    assert int(told[0]) >= view_commands._NICE
    assert told[-1] == (str(view_commands._NICE) if own else before)
