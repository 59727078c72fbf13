"""ROS domains of tests: a worker has a share of its own, so that no two tests that run at once hear each other."""

import itertools
import os

_LAST = 101  # domains above it have ports that the system also gives to anybody who asks for any port
_WORKERS = int(os.environ.get("PYTEST_XDIST_WORKER_COUNT", "1"))
_WORKER = int(os.environ.get("PYTEST_XDIST_WORKER", "gw0")[2:])
_SHARE = range(1 + _WORKER, _LAST + 1, _WORKERS)
_TURNS = itertools.count(os.getppid())  # runs of the suite at the same time begin at different places


def next_domain() -> str:
    """A domain that this worker has not used for as long as possible: killed nodes stay visible to others for a while."""
    return str(_SHARE[next(_TURNS) % len(_SHARE)])
