"""The logger in a real browser over a running graph: what the graph detects is labelled by keyboard and kept, also after a kill.

Waiting ends when the graph does nothing more, or has worked through so many turns of the scene in vain: a busy machine needs longer, and is
given it.
"""

from __future__ import annotations

import subprocess
import sys
import time

import pytest
from browser import PATIENCE, chromium, needs_chromium
from log_page import LogPage, labels
from typer.testing import CliRunner

from radar_app.cli import app
from radar_app.logger.event import read_event
from radar_app.logger.store import read_session
from radar_app.view.live import LiveSource
from radar_lab.datasets.samples import read_samples

SCENE = """
duration: 5.2
seed: 5
purpose: gestures
radars: [{waveform: {n_sample: 32, bandwidth: 0.75e+9, frame_interval: 0.04}}]  # a busy machine keeps up
people:
  - {id: 1, position: [2.0, 0.0], script: [{gesture: push, at: 1.8}, {gesture: pull, at: 3.6}]}
effects: {noise: {}, losses: {}}
"""
TURN = 130  # clouds of the scene
MOST = 8  # turns in which an event has to come

pytestmark = [pytest.mark.long, pytest.mark.timeout(900)]


class Graph:
    """A graph of real nodes, its scene again and again, and how far it has come."""

    def __init__(self, folder):
        scene = folder / "room.yaml"
        scene.write_text(SCENE)
        words = ("up", "--scene", str(scene), "--param", "driver.at_end=loop", "--param", "visualisation.rate=0.5")
        self.log = (folder / "up.txt").open("w+")
        self.process = subprocess.Popen([sys.executable, "-m", "radar_app", *words], stdout=self.log, stderr=subprocess.STDOUT)
        self._ears = LiveSource()

    @property
    def clouds(self):
        """How many clouds have been looked at for gestures."""
        reports = [entry.value.processed for entry in self._ears.feed.history().status if entry.value.stage == "gestures"]
        return max(reports, default=0)

    def until(self, page, wanted):
        """Wait for something that the graph has to do."""
        first = last = self.clouds
        since = time.monotonic()
        while not (found := wanted()):
            now = self.clouds
            if now != last:
                last, since = now, time.monotonic()
            assert now - first < MOST * TURN, f"nothing came in {now - first} clouds; the page says: {page.said}"
            assert time.monotonic() - since < PATIENCE, self.said()
            assert self.process.poll() is None, self.said()
            time.sleep(0.1)
        return found

    def said(self):
        self.log.seek(0)
        return "the graph stands still: " + self.log.read()[-2000:]

    def end(self):
        self._ears.close()
        self.process.send_signal(2)
        try:
            self.process.wait(60.0)
        finally:
            self.process.kill()
            self.log.close()


@pytest.fixture
def graph(tmp_path):
    needs_chromium()
    made = Graph(tmp_path)
    yield made
    made.end()


def test_a_running_graph_is_labelled_and_a_kill_loses_nothing(graph, tmp_path):
    """An event with its maps is labelled, taken back and labelled again while the next ones come; then the page is killed."""
    folder = tmp_path / "session"
    with chromium(tmp_path / "profile") as driver:
        page = LogPage(driver, "live", folder, "--subject", "anna")
        first = graph.until(page, lambda: page.event + 1) - 1
        for field in ("micro_doppler", "azimuth", "elevation"):
            page.until(lambda field=field: any(page.map(field)))
        page.type("2")
        page.shows(f"saved: event {first} is push")
        assert labels(folder) == [(first, "push", "anna")]
        page.type("u")
        page.shows(f"taken back: event {first} was push")
        assert labels(folder) == []
        page.until(lambda: page.event == first)
        page.type("2")
        page.shows(f"saved: event {first} is push")
        second = graph.until(page, lambda: page.event if page.event > first else 0)  # detection goes on
        page.type("1")
        page.shows(f"saved: event {second} is pull")
        page.kill()
        known = [(first, "push", "anna"), (second, "pull", "anna")]
        assert labels(folder) == known

        before = set(read_session(folder).files)
        page = LogPage(driver, "live", folder)
        graph.until(page, lambda: set(read_session(folder).files) - before)
        page.type("u")
        page.shows(f"taken back: event {second} was pull")
        page.until(lambda: page.event == second)
        page.type("1")
        page.shows(f"saved: event {second} is pull")
        page.end()
    session = read_session(folder)
    assert labels(folder) == known
    assert session.told == ()
    assert session.radar.waveform.n_sample == 32
    for number, _, _ in known:
        event = read_event(session.files[number], raw=True)
        assert len(event.maps.stamp_ns) > 1
        assert sum(event.start_ns <= cloud.stamp_ns <= event.end_ns for cloud in event.clouds) > 1
        assert any(event.start_ns <= frame.stamp_ns <= event.end_ns for frame in event.frames)
        assert all(abs(frame.cube).max() > 0 for frame in event.frames)
    done = CliRunner().invoke(app, ["lab", "dataset", "import", str(folder), str(tmp_path / "people")])
    assert done.exit_code == 0, done.output
    assert "2 samples added" in done.output
    assert len(list(read_samples(tmp_path / "people"))) == 2
