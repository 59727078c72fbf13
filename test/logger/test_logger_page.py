"""The logger in a real browser over a recording: labels by keyboard alone, and a kill that loses nothing that the page had called saved."""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
import sys
import time
from contextlib import contextmanager
from pathlib import Path

import pytest
from performances import clouds_of
from selenium.webdriver import Chrome, ChromeOptions
from selenium.webdriver.chrome.service import Service
from selenium.webdriver.common.action_chains import ActionChains
from selenium.webdriver.common.keys import Keys

from radar_app.logger.store import read_session
from radar_core import RadarInfo
from radar_ros.bags import BagWriter
from radar_ros.messages.convert import cloud_to_msg, info_to_msg

FLAGS = (
    "--headless=new", "--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run", "--disable-background-networking",
    "--disable-component-update", "--disable-sync", "--window-size=1300,1100",
)  # fmt: skip
PERFORMED = ["push", "pull", "push", "pull", "push", "pull"]

pytestmark = [
    pytest.mark.long,
    pytest.mark.skipif(shutil.which("chromedriver") is None or shutil.which("chromium") is None, reason="needs chromium and its driver"),
]


@pytest.fixture(scope="module")
def bag(tmp_path_factory):
    """Somebody who performs six gestures, as clouds."""
    path = tmp_path_factory.mktemp("logged") / "clouds"
    with BagWriter(path) as writer:
        writer.put("/radar/info", 0, info_to_msg(RadarInfo(), 0))
        for cloud in clouds_of(PERFORMED):
            writer.put("/radar/points", cloud.stamp_ns, cloud_to_msg(cloud))
    return path


@contextmanager
def browser(profile: Path):
    """A browser with nothing in it."""
    options = ChromeOptions()
    options.binary_location = shutil.which("chromium")
    for flag in (*FLAGS, f"--user-data-dir={profile}"):
        options.add_argument(flag)
    options.set_capability("goog:loggingPrefs", {"browser": "ALL"})
    driver = Chrome(options=options, service=Service(shutil.which("chromedriver")))
    try:
        yield driver
    finally:
        driver.quit()


class View:
    """The command, and its page in the browser, on the tab of the logger."""

    def __init__(self, driver, bag, folder, *options):
        words = ("view", str(bag), "--log", str(folder), "--port", "0", *options)
        self.process = subprocess.Popen([sys.executable, "-m", "radar_app.cli", *words], stdout=subprocess.PIPE, text=True)
        self.driver = driver
        driver.get(self.process.stdout.readline().strip())
        self.until(lambda: driver.execute_script("return window.Bokeh != null && Bokeh.documents.length > 0 && Bokeh.documents[0].is_idle"))
        tabs = "[...Bokeh.documents[0]._all_models.values()].find((model) => model.type == 'Tabs')"
        driver.execute_script(f"const tabs = {tabs}; tabs.active = tabs.tabs.findIndex((tab) => tab.title == 'Log')")

    def until(self, wanted, timeout=90.0):
        end = time.monotonic() + timeout
        while not (found := wanted()):
            assert self.process.poll() is None, "the command has ended"
            assert time.monotonic() < end, self.driver.execute_script("return document.body.innerText") + self.said
            time.sleep(0.05)
        return found

    def model(self, name, what):
        return self.driver.execute_script(f"return Bokeh.documents[0].get_model_by_name('{name}').{what}")

    @property
    def event(self):
        return self.model("logger_event", "data.event[0]")

    @property
    def said(self):
        return self.model("logger_said", "text")

    def press(self, *keys):
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
    folder = tmp_path / "session"
    with browser(tmp_path / "profile") as driver:
        view = View(driver, bag, folder, "--subject", "anna", "--rate", "3")
        view.until(lambda: view.event == 0)
        image = "renderers[0].data_source.data.micro_doppler[0]"
        view.until(lambda: view.driver.execute_script(f"return Math.max(...{_plot(image)}.filter((x) => x == x)) > 5"))
        view.press("2")
        view.shows("saved: event 0 is push")
        assert labels(folder) == [(0, "push", "anna")]
        view.press("u")
        view.shows("taken back: event 0 was push")
        assert labels(folder) == []
        view.until(lambda: view.event == 0)
        view.press("t")
        view.press("2", Keys.ESCAPE, "t", Keys.BACKSPACE, "thumb_up", Keys.ENTER)
        view.shows("saved: event 0 is thumb_up")
        view.until(lambda: view.event == 1)
        view.press("x")
        view.shows("discarded: event 1")
        view.until(lambda: view.event == 2)
        view.press("a")
        view.shows("saved: event 2 is thumb_up")
        view.until(lambda: view.event == 3)
        view.press("1")
        view.shows("saved: event 3 is pull")
        assert [line["message"] for line in driver.get_log("browser") if line["level"] == "SEVERE"] == []
        view.kill()
        known = [(0, "thumb_up", "anna"), (2, "thumb_up", "anna"), (3, "pull", "anna")]
        assert labels(folder) == known
        view = View(driver, bag, folder)
        view.until(lambda: view.event >= 0)
        assert "anna" in view.model("logger_about", "text")
        view.press("u")
        view.shows("taken back: event 3 was pull")
        view.until(lambda: view.event == 3)
        view.press("9")
        view.shows("saved: event 3 is push_pull")
        view.end()
    assert labels(folder) == [*known[:2], (3, "push_pull", "anna")]
    assert read_session(folder).told == ()


def _plot(what):
    return f"Bokeh.documents[0].get_model_by_name('logger_micro_doppler_plot').{what}"
