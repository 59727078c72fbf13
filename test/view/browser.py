"""A real, headless Chromium, and the page of `handwave view` in it."""

import shutil
import subprocess
import sys
import time
from contextlib import contextmanager

import pytest

FLAGS = (
    "--headless=new", "--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run", "--disable-background-networking",
    "--disable-component-update", "--disable-sync", "--window-size=1300,1000", "--remote-debugging-port=0",
)  # fmt: skip
PATIENCE = 120.0  # s: the machine may be busy


def needs_chromium():
    """Skip, and say why, where there is no browser to drive."""
    if shutil.which("chromium") is None or shutil.which("chromedriver") is None:
        pytest.skip("no chromium with chromedriver here: apt-get install chromium chromium-driver")
    pytest.importorskip("selenium", reason="no selenium here: pip install handwave[test]")


@contextmanager
def chromium(profile):
    """A browser with a fresh profile."""
    from selenium.webdriver import Chrome, ChromeOptions
    from selenium.webdriver.chrome.service import Service

    options = ChromeOptions()
    options.binary_location = shutil.which("chromium")
    for flag in (*FLAGS, f"--user-data-dir={profile}"):
        options.add_argument(flag)
    options.set_capability("goog:loggingPrefs", {"browser": "ALL"})
    driver = Chrome(options=options, service=Service(shutil.which("chromedriver")))
    driver.set_script_timeout(PATIENCE)
    try:
        yield driver
    finally:
        driver.quit()


@contextmanager
def command(*words, env=None):
    """`handwave view` with its first line, the address; stopped by Ctrl-C, after which it must end by itself and well."""
    process = subprocess.Popen(
        [sys.executable, "-m", "radar_app", "view", *words], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env=env
    )
    try:
        address = process.stdout.readline().strip()
        assert address.startswith("http://"), process.stderr.read()
        yield process, address
        assert process.poll() is None, process.stderr.read()
        process.send_signal(2)
        assert process.wait(30) == 0, process.stderr.read()
    finally:
        if process.poll() is None:
            process.kill()
            process.wait()


class Page:
    """The page in a browser."""

    def __init__(self, driver, address):
        self.driver = driver
        driver.get("about:blank")
        driver.get_log("browser")  # what the page before said when its server had gone
        driver.get(address)
        self.until(lambda: driver.execute_script("return window.Bokeh != null && Bokeh.documents.length > 0 && Bokeh.documents[0].is_idle"))

    def until(self, wanted, timeout=PATIENCE):
        """Wait for something; what stands on the page is told when it does not come."""
        end = time.monotonic() + timeout
        while not (found := wanted()):
            assert time.monotonic() < end, self.driver.execute_script("return document.body.innerText") + str(
                self.driver.get_log("browser")
            )
            time.sleep(0.05)
        return found

    def model(self, name, what):
        """A property of a model, by its name."""
        return self.driver.execute_script(f"return Bokeh.documents[0].get_model_by_name('{name}').{what}")

    def data(self, name, column):
        """A column of a data source, as a list."""
        return self.driver.execute_script(f"return Array.from(Bokeh.documents[0].get_model_by_name('{name}').data['{column}'])")

    def set(self, name, what, value):
        """Set a property of a model, as a widget does."""
        self.driver.execute_script(f"Bokeh.documents[0].get_model_by_name('{name}').{what} = arguments[0]", value)

    def text(self, name):
        """What a text of the page says."""
        find = f"Bokeh.index.find_one(Bokeh.documents[0].get_model_by_name('{name}'))"
        return self.driver.execute_script(f"return {find}.shadow_el.textContent")

    def gestures(self):
        """The list of gestures; empty as long as there are none."""
        said = self.text("gestures")
        return "" if "none yet" in said else said

    def press(self, name):
        """Click a button of the page."""
        find = f"Bokeh.index.find_one(Bokeh.documents[0].get_model_by_name('{name}')).shadow_el.querySelector('button')"
        button = self.driver.execute_script(f"return {find}")
        self.driver.execute_script("arguments[0].scrollIntoView({block: 'center'})", button)
        button.click()

    def corner(self, x, y):
        """Click a place of the plan [m] until it is a corner of the zone: a busy browser takes a slow click for a long press."""
        for _ in range(8):
            self.click_plan(x, y)
            end = time.monotonic() + PATIENCE / 8
            while time.monotonic() < end:
                drawn = zip(self.data("draft", "x"), self.data("draft", "y"), strict=False)  # the browser may get one before the other
                if any(abs(a - x) < 0.1 and abs(b - y) < 0.1 for a, b in drawn):
                    return
                time.sleep(0.05)
        raise AssertionError(f"no click became a corner at {x}, {y}: {self.driver.get_log('browser')}")

    def click_plan(self, x, y):
        """Click the plan at a place in the room [m]."""
        from selenium.webdriver.common.action_chains import ActionChains

        find = "const view = Bokeh.index.find_one(Bokeh.documents[0].get_model_by_name('plan'))"
        element = self.driver.execute_script(f"{find}; view.el.scrollIntoView({{block: 'center'}}); return view.el")
        place = f"[view.frame.x_scale.compute({y}), view.frame.y_scale.compute({x}), view.el.offsetWidth, view.el.offsetHeight]"
        across, down, width, height = self.driver.execute_script(f"{find}; return {place}")
        chain = ActionChains(self.driver, duration=0)
        chain.move_to_element_with_offset(element, round(across - width / 2), round(down - height / 2)).click().perform()
