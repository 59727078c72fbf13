"""Emulated boards: a TinyRad on an emulated bus, and below the real libusb; a DCA1000 on real sockets and terminals."""

import pytest
from dca1000_bench import bench, tidy  # noqa: F401  (pytest finds fixtures here)
from leftovers import held, left_since
from tinyrad_backend import Backend
from tinyrad_board import Board
from umockdev_machine import Machine, missing

from radar_driver.tinyrad.config import TinyRadConfig
from radar_driver.tinyrad.source import TinyRadSource


class Rig:
    """A board, its bus, and a source on it; quick to give up, so that faults do not take long."""

    def __init__(self, frames=(), *, board=None, **knobs):
        arguments = {"paced": True, **(board or {})}
        self.board = Board(frames, **arguments)
        self.bus = Backend(self.board)
        self.config = TinyRadConfig(**{"timeout": 0.1, **knobs})
        self.source = TinyRadSource(self.config, self.bus)

    def start(self):
        self.source.power_up()
        self.source.resume()
        return self

    def read(self, times=1):
        """Frames, waiting for each as long as the reader would."""
        found = []
        for _ in range(times):
            reading = self.source.read(1.0)
            assert reading is not None
            found.append(reading.data)
        return found

    @property
    def free(self):
        """Whether nothing of the bus is held."""
        return not self.bus.handles and not self.bus.claims


@pytest.fixture
def rig():
    """Make rigs; whatever the test leaves is closed, and no thread may outlive it."""
    made, before = [], held()

    def make(*arguments, **named):
        made.append(Rig(*arguments, **named))
        return made[-1]

    yield make
    for one in made:
        one.board.faults.clear()
        one.source.power_down()
        assert one.free
    assert not left_since(before)


@pytest.fixture
def machine(tmp_path):
    """Plug an emulated board in below the real libusb."""
    if missing():
        pytest.skip(missing())
    machines = []

    def make(frames=b"", **named):
        file = None
        if frames:
            file = tmp_path / "frames.raw"
            file.write_bytes(frames)
        machines.append(Machine(file, **named))
        return machines[-1]

    yield make
    for one in machines:
        one.close()
