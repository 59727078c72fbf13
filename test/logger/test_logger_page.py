"""The logger in a real browser over a recording: labels by keyboard alone, and a kill that loses nothing that the page had called saved."""

from __future__ import annotations

import pytest
from browser import chromium, needs_chromium
from log_page import BACKSPACE, ENTER, ESCAPE, LogPage, labels
from performances import clouds_of

from radar_app.logger.store import read_session
from radar_core import RadarInfo
from radar_ros.bags import BagWriter
from radar_ros.messages.convert import cloud_to_msg, info_to_msg

PERFORMED = ["push", "pull", "push", "pull", "push", "pull"]

pytestmark = pytest.mark.long


@pytest.fixture(scope="module")
def bag(tmp_path_factory):
    """Somebody who performs six gestures, as clouds."""
    path = tmp_path_factory.mktemp("logged") / "clouds"
    with BagWriter(path) as writer:
        writer.put("/radar/info", 0, info_to_msg(RadarInfo(), 0))
        for cloud in clouds_of(PERFORMED):
            writer.put("/radar/points", cloud.stamp_ns, cloud_to_msg(cloud))
    return path


def test_labels_by_keyboard_and_a_kill(bag, tmp_path):
    """Digits, a name of one's own, its letter, discard and undo; what the page calls saved is on the disk, also after a kill."""
    needs_chromium()
    folder = tmp_path / "session"
    with chromium(tmp_path / "profile") as driver:
        view = LogPage(driver, bag, folder, "--subject", "anna", "--rate", "3")
        view.until(lambda: view.event == 0)
        view.until(lambda: max(view.map("micro_doppler"), default=0.0) > 5)
        view.type("2")
        view.shows("saved: event 0 is push")
        assert labels(folder) == [(0, "push", "anna")]
        view.type("u")
        view.shows("taken back: event 0 was push")
        assert labels(folder) == []
        view.until(lambda: view.event == 0)
        view.type("t")
        view.type("2", ESCAPE, "t", BACKSPACE, "thumb_up", ENTER)
        view.shows("saved: event 0 is thumb_up")
        view.until(lambda: view.event == 1)
        view.type("x")
        view.shows("discarded: event 1")
        view.until(lambda: view.event == 2)
        view.type("a")
        view.shows("saved: event 2 is thumb_up")
        view.until(lambda: view.event == 3)
        view.type("1")
        view.shows("saved: event 3 is pull")
        assert [line["message"] for line in driver.get_log("browser") if line["level"] == "SEVERE"] == []
        view.kill()
        known = [(0, "thumb_up", "anna"), (2, "thumb_up", "anna"), (3, "pull", "anna")]
        assert labels(folder) == known
        view = LogPage(driver, bag, folder)
        view.until(lambda: view.event >= 0)
        assert "anna" in view.model("logger_about", "text")
        view.type("u")
        view.shows("taken back: event 3 was pull")
        view.until(lambda: view.event == 3)
        view.type("9")
        view.shows("saved: event 3 is push_pull")
        view.end()
    assert labels(folder) == [*known[:2], (3, "push_pull", "anna")]
    assert read_session(folder).told == ()
