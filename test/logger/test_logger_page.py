"""The logger in a real browser over a recording: labels by keyboard alone, and a kill that loses nothing that the page had called saved."""

from __future__ import annotations

import os
import signal
import subprocess
import sys

import pytest
from browser import Page, chromium, needs_chromium
from performances import clouds_of

from radar_app.logger.store import read_session
from radar_core import RadarInfo
from radar_ros.bags import BagWriter
from radar_ros.messages.convert import cloud_to_msg, info_to_msg

PERFORMED = ["push", "pull", "push", "pull", "push", "pull"]
ENTER, ESCAPE, BACKSPACE = "\ue007", "\ue00c", "\ue003"
"""Keys as WebDriver names them."""

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


class View(Page):
    """The command, and its page in the browser, on the tab of the logger."""

    def __init__(self, driver, bag, folder, *options):
        words = ("view", str(bag), "--log", str(folder), "--port", "0", *options)
        self.process = subprocess.Popen([sys.executable, "-m", "radar_app", *words], stdout=subprocess.PIPE, text=True)
        super().__init__(driver, self.process.stdout.readline().strip())
        tabs = "[...Bokeh.documents[0]._all_models.values()].find((model) => model.type == 'Tabs')"
        driver.execute_script(f"const tabs = {tabs}; tabs.active = tabs.tabs.findIndex((tab) => tab.title == 'Log')")

    @property
    def event(self):
        return self.model("logger_event", "data.event[0]")

    @property
    def said(self):
        return self.model("logger_said", "text")

    def type(self, *keys):
        """Press keys, wherever the focus is."""
        from selenium.webdriver.common.action_chains import ActionChains

        ActionChains(self.driver).send_keys(*keys).perform()

    def shows(self, words):
        self.until(lambda: words in self.said)

    def kill(self):
        os.kill(self.process.pid, signal.SIGKILL)
        assert self.process.wait(30.0) == -signal.SIGKILL
        self.process.stdout.close()

    def end(self):
        """End it as Ctrl-C does."""
        self.process.send_signal(signal.SIGINT)
        self.process.wait(60.0)
        self.process.stdout.close()


def labels(folder):
    return [(one.event, one.gesture, one.subject) for one in read_session(folder).labels]


def test_labels_by_keyboard_and_a_kill(bag, tmp_path):
    """Digits, a name of one's own, its letter, discard and undo; what the page calls saved is on the disk, also after a kill."""
    needs_chromium()
    folder = tmp_path / "session"
    with chromium(tmp_path / "profile") as driver:
        view = View(driver, bag, folder, "--subject", "anna", "--rate", "3")
        view.until(lambda: view.event == 0)
        image = "renderers[0].data_source.data.micro_doppler[0]"
        view.until(lambda: view.driver.execute_script(f"return Math.max(...{_plot(image)}.filter((x) => x == x)) > 5"))
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
        view = View(driver, bag, folder)
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


def _plot(what):
    return f"Bokeh.documents[0].get_model_by_name('logger_micro_doppler_plot').{what}"
