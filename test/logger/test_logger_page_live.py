"""The logger in a real browser over a running graph: what the graph detects is labelled by keyboard and kept, also after a kill."""

from __future__ import annotations

import pytest
from browser import chromium, needs_chromium
from log_page import LogPage, labels
from running import RunningGraph
from typer.testing import CliRunner

from radar_app.cli import app
from radar_app.logger.event import read_event
from radar_app.logger.store import read_session
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
MOST = 8 * 130  # clouds in which an event has to come: eight times the scene

pytestmark = [pytest.mark.long, pytest.mark.timeout(900)]


@pytest.fixture
def graph(tmp_path):
    needs_chromium()
    made = RunningGraph(tmp_path, SCENE, "--param", "driver.at_end=loop", stage="gestures")
    yield made
    made.end()


def new_events(folder, seen):
    """Read the events that have come since the last call, with their raw frames."""
    files = read_session(folder).files
    new = sorted(set(files) - seen)
    seen.update(new)
    return [read_event(files[number], raw=True) for number in new]


def with_its_frames(event):
    """Whether raw frames of the gesture itself were kept: on a busy machine the page misses those of some, whose clouds it has."""
    return any(event.start_ns <= frame.stamp_ns <= event.end_ns and abs(frame.cube).max() > 0 for frame in event.frames)


def test_a_running_graph_is_labelled_and_a_kill_loses_nothing(graph, tmp_path):
    """An event with its maps is labelled, taken back and labelled again while the next ones come; then the page is killed."""
    folder = tmp_path / "session"
    with chromium(tmp_path / "profile") as driver:
        page = LogPage(driver, "live", folder, "--subject", "anna")
        first = graph.until(page, lambda: page.event + 1, MOST) - 1
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
        second = graph.until(page, lambda: page.event if page.event > first else 0, MOST)  # detection goes on
        page.type("1")
        page.shows(f"saved: event {second} is pull")
        page.kill()
        known = [(first, "push", "anna"), (second, "pull", "anna")]
        assert labels(folder) == known

        seen = set(read_session(folder).files)
        page = LogPage(driver, "live", folder)
        graph.until(page, lambda: any(with_its_frames(event) for event in new_events(folder, seen)), MOST)
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
    events = [read_event(session.files[number], raw=True) for number, _, _ in known]
    for event in events:
        assert len(event.maps.stamp_ns) > 1
        assert sum(event.start_ns <= cloud.stamp_ns <= event.end_ns for cloud in event.clouds) > 1
    done = CliRunner().invoke(app, ["lab", "dataset", "import", str(folder), str(tmp_path / "people")])
    assert done.exit_code == 0, done.output
    assert "2 samples added" in done.output
    assert len(list(read_samples(tmp_path / "people"))) == 2
