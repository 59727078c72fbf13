"""An emulated capture card with a sensor, the driver's settings for both, and a look at what a test leaves behind."""

import pytest
from dca1000_emulator import BOARD, HOST, CaptureCard, SensorCli, cfg
from leftovers import held, left_since

from radar_driver.dca1000.board import Dca1000Config, Dca1000Source


class Bench:
    """A capture card, a sensor and the driver's settings for both."""

    def __init__(self, folder, frames, text, **faults):
        (folder / "radar.cfg").write_text(text)
        self.cfg, self.tty = folder / "radar.cfg", folder / "tty"
        self.card = CaptureCard(frames, **faults)
        self.cli = SensorCli(self.tty)
        self.card.running = lambda: self.cli.running
        self.log = self.card.log = self.cli.log = []  # codes and commands, in the order in which they came

    def settings(self, **other):
        """Point the driver to the emulated boards; answers come at once, so waiting is short."""
        ports = {"config_port": self.card.config_port, "data_port": self.card.data_port}
        given = {
            "config": str(self.cfg),
            "serial_port": str(self.tty),
            "host_address": HOST,
            "board_address": BOARD,
            "timeout": 0.2,
            **ports,
        }
        return Dca1000Config(**{**given, **other})

    def source(self, **other):
        """Make the driver's source."""
        return Dca1000Source(self.settings(**other))

    def close(self):
        """Switch everything off."""
        self.card.close()
        self.cli.close()


@pytest.fixture
def tidy():
    """Whatever a test opened is closed in its end, and its threads have ended."""
    before = held()
    yield
    assert not left_since(before)


@pytest.fixture
def bench(tidy, tmp_path):
    """Make benches; all are switched off in the end."""
    made = []

    def make(frames, text=None, **faults):
        made.append(Bench(tmp_path, frames, text or cfg(), **faults))
        return made[-1]

    yield make
    for one in made:
        one.close()
