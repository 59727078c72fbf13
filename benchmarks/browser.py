"""A real browser, without a window, that looks at the live page."""

from __future__ import annotations

import contextlib
import shutil
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Final

from benchmarks.report import AbsentError

FLAGS: Final = (
    "--headless=new", "--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run", "--disable-background-networking",
    "--disable-component-update", "--disable-sync", "--window-size=1300,1000", "--remote-debugging-port=0",
)  # fmt: skip
_DRAWN: Final = "return Bokeh.documents.length ? Bokeh.documents[0].get_model_by_name('drawn').data.n[0] : 0"


def needs_browser() -> None:
    """Raise an AbsentError where there is no browser to drive."""
    if shutil.which("chromium") is None or shutil.which("chromedriver") is None:
        raise AbsentError("no chromium with chromedriver here: apt-get install chromium chromium-driver")
    try:
        import selenium  # noqa: F401
    except ImportError:
        raise AbsentError("no selenium here: pip install 'handwave[test]'") from None


@contextlib.contextmanager
def page(folder: Path) -> Iterator[tuple[Any, list[int]]]:
    """Open the page in a browser beside a graph; yields what drives the browser, and the process ids of page and browser."""
    from selenium.webdriver import Chrome, ChromeOptions
    from selenium.webdriver.chrome.service import Service

    command = [sys.executable, "-m", "radar_app", "view", "--port", "0"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True, start_new_session=True) as server:
        driver: Any = None
        try:
            assert server.stdout is not None
            address = server.stdout.readline().strip()
            options = ChromeOptions()
            options.binary_location = str(shutil.which("chromium"))
            for flag in (*FLAGS, f"--user-data-dir={folder / 'profile'}"):
                options.add_argument(flag)
            driver = Chrome(options=options, service=Service(str(shutil.which("chromedriver")), popen_kw={"start_new_session": True}))
            driver.get(address)
            yield driver, [server.pid, driver.service.process.pid]
        finally:
            if driver is not None:
                driver.quit()
            server.send_signal(signal.SIGINT)


def pictures(driver: Any) -> int:
    """Count the pictures of a moment that the browser has drawn."""
    return int(driver.execute_script(_DRAWN))
