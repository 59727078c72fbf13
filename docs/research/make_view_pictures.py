"""Photograph the live page in Chromium: ``python docs/research/make_view_pictures.py``.

Simulates the demo's room, shows it with ``handwave view``, stops time when the hand is followed, and writes docs/img/view.png and
docs/img/view_choices.png.
"""

from __future__ import annotations

import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from benchmarks.browser import FLAGS
from radar_app.view.zones_file import ZonesFile
from radar_ros.offline import simulate, simulators

ROOT = Path(__file__).resolve().parents[2]
PATIENCE = 900.0  # s: the library works out the results in real time where the machine is quick enough
SIZE = (1440, 1380)


def until(wanted: Callable[[], Any]) -> Any:
    end = time.monotonic() + PATIENCE
    while not (found := wanted()):
        if time.monotonic() > end:
            sys.exit("the page did not come so far; is the machine busy?")
        time.sleep(0.05)
    return found


def text(driver: Any, name: str) -> str:
    return str(driver.execute_script(f"return Bokeh.index.find_one(Bokeh.documents[0].get_model_by_name('{name}')).shadow_el.textContent"))


def press(driver: Any, name: str) -> None:
    driver.execute_script(f"Bokeh.index.find_one(Bokeh.documents[0].get_model_by_name('{name}')).shadow_el.querySelector('button').click()")


def photograph(driver: Any, address: str) -> None:
    driver.get(address)
    until(lambda: driver.execute_script("return window.Bokeh != null && Bokeh.documents.length > 0 && Bokeh.documents[0].is_idle"))
    until(
        lambda: (
            "swipe left" in text(driver, "gestures") and "no hand" not in text(driver, "control") and "0 s ago" in text(driver, "gestures")
        )
    )
    press(driver, "pause")
    until(lambda: "paused" in text(driver, "head"))
    time.sleep(2.0)  # for the last picture to be drawn
    driver.save_screenshot(str(ROOT / "docs/img/view.png"))
    tabs = "[...Bokeh.documents[0]._all_models.values()].find((model) => model.type == 'Tabs')"
    driver.execute_script(f"{tabs}.active = 1")
    time.sleep(2.0)
    driver.set_window_size(SIZE[0], 1000)
    time.sleep(2.0)
    driver.save_screenshot(str(ROOT / "docs/img/view_choices.png"))


def main() -> None:
    if shutil.which("chromium") is None or shutil.which("chromedriver") is None:
        sys.exit("this needs chromium and its driver: apt-get install chromium chromium-driver")
    from selenium.webdriver import Chrome, ChromeOptions
    from selenium.webdriver.chrome.service import Service

    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as name:
        folder = Path(name)
        for _ in simulate(simulators("demo"), folder / "room"):
            pass
        zones = ZonesFile(folder / "living_room.yaml")
        zones.save("sofa", "counting", [(1.7, 0.3), (1.7, 1.6), (3.1, 1.6), (3.1, 0.3)])
        zones.save("desk", "counting", [(3.6, -2.6), (3.6, -1.2), (4.9, -1.2), (4.9, -2.6)])
        zones.save("fan", "exclusion", [(4.4, 1.4), (4.4, 2.3), (5.3, 2.3), (5.3, 1.4)])
        command = [sys.executable, "-m", "radar_app", "view", str(folder / "room"), "--port", "0", "--zones", str(zones.path)]
        with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as server:
            assert server.stdout is not None
            address = server.stdout.readline().strip()
            options = ChromeOptions()
            options.binary_location = str(shutil.which("chromium"))
            for flag in (*FLAGS, f"--user-data-dir={folder / 'profile'}", "--hide-scrollbars"):
                options.add_argument(flag)
            driver = Chrome(options=options, service=Service(str(shutil.which("chromedriver"))))
            try:
                driver.set_window_size(*SIZE)
                photograph(driver, address)
            finally:
                driver.quit()
                server.send_signal(2)


if __name__ == "__main__":
    main()
