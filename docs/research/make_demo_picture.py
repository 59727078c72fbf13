"""Run the demo; draw its display for the README: ``python docs/research/make_demo_picture.py``.

Writes docs/img/demo.svg and the three sentences that the report begins with between the demo-output marks of README.md.
"""

from __future__ import annotations

import io
import json
import os
import subprocess
import sys
import tempfile
from pathlib import Path

import rclpy
from rich.console import Console

from radar_app.demo_report import sentences
from radar_app.live import Monitor
from radar_app.supervisor import environment
from radar_sim import load_scene

ROOT = Path(__file__).resolve().parents[2]
DOMAIN = 179
BEGIN, END = "<!-- demo-output -->", "<!-- /demo-output -->"


def main() -> None:
    """Watch one demo from outside and draw what it showed."""
    os.environ.update(environment(DOMAIN))
    display = Console(record=True, width=80, file=io.StringIO())
    with tempfile.TemporaryDirectory() as folder:
        command = [
            sys.executable,
            "-m",
            "radar_app.cli",
            "demo",
            "--headless",
            "--json",
            "--bag",
            f"{folder}/demo",
            "--domain",
            str(DOMAIN),
        ]
        demo = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True)
        rclpy.init(args=[])
        monitor = Monitor()
        monitor.duration = load_scene("demo").duration
        drawing = 0
        while demo.poll() is None:
            monitor.spin(0.1)
            drawing += monitor.hand is not None
            if drawing == 15:  # into the drawing: something of everything is on the display
                display.print(monitor.render("handwave demo"))
        monitor.close()
        rclpy.try_shutdown()
        assert demo.stdout is not None
        figures = json.loads(demo.stdout.read())
    said = sentences(figures)
    for sentence in said:
        display.print(sentence, highlight=False)
    (ROOT / "docs" / "img").mkdir(exist_ok=True)
    display.save_svg(str(ROOT / "docs" / "img" / "demo.svg"), title="make demo")
    readme, text = ROOT / "README.md", "\n".join(said)
    before, _, rest = readme.read_text(encoding="utf-8").partition(BEGIN)
    after = rest.partition(END)[2]
    readme.write_text(f"{before}{BEGIN}\n```text\n{text}\n```\n{END}{after}", encoding="utf-8")


if __name__ == "__main__":
    main()
