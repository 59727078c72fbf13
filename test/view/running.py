"""A graph of real nodes beside the page, and waiting for what it has to do.

Waiting ends when the graph does nothing more, or has worked through so many clouds in vain: a busy machine needs longer, and is given it.
"""

import subprocess
import sys
import time

from browser import PATIENCE

from radar_app.view.live import LiveSource


class RunningGraph:
    """`handwave up` on a scene, and how far it has come: by how many clouds one of its stages has looked at."""

    def __init__(self, folder, scene, *words, stage):
        path = folder / "room.yaml"
        path.write_text(scene)
        command = [sys.executable, "-m", "radar_app", "up", *words, "--scene", str(path), "--param", "visualisation.rate=1.0"]
        self.log = (folder / "up.txt").open("w+")
        self.process = subprocess.Popen(command, stdout=self.log, stderr=subprocess.STDOUT)
        self._ears, self._stage = LiveSource(), stage

    @property
    def clouds(self):
        reports = [entry.value.processed for entry in self._ears.feed.history().status if entry.value.stage == self._stage]
        return max(reports, default=0)

    def until(self, page, wanted, most):
        """Wait for something, for so many clouds at most; returns it."""
        first = last = self.clouds
        since = time.monotonic()
        while not (found := wanted()):
            now = self.clouds
            if now != last:
                last, since = now, time.monotonic()
            assert now - first < most, f"nothing came in {now - first} clouds; the page says: {page.text('head')}"
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
