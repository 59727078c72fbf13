"""The page of `handwave view --log` in a browser, on the tab of the logger."""

from __future__ import annotations

import os
import signal
import subprocess
import sys

from browser import Page

from radar_app.logger.store import read_session

ENTER, ESCAPE, BACKSPACE = "\ue007", "\ue00c", "\ue003"
"""Keys as WebDriver names them."""


class LogPage(Page):
    """The command, and its page in the browser, on the tab of the logger; ``what`` is shown: a recording, or live."""

    def __init__(self, driver, what, folder, *options):
        words = ("view", str(what), "--log", str(folder), "--port", "0", *options)
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

    def map(self, field):
        """Values of one of the three maps that stand on the page; cells in which there is nothing are left out."""
        data = f"Bokeh.documents[0].get_model_by_name('logger_micro_doppler_plot').renderers[0].data_source.data.{field}[0]"
        return self.driver.execute_script(f"return Array.from({data}).filter((x) => x == x)")

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
    """What is labelled in a session: number of the event, gesture, subject."""
    return [(one.event, one.gesture, one.subject) for one in read_session(folder).labels]
