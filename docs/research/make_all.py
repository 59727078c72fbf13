"""Make every picture of the docs that this machine can make: ``make pictures``.

    python docs/research/make_all.py [--results FOLDER] [--only PART]

Pictures of recordings need HANDWAVE_DATA, the folder with the recordings. Pictures of benchmarks need their results: FOLDER holds
NAME.json, what ``python -m benchmarks NAME --json`` printed, and NAME/, what it kept. What is missing is named and left out.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

HERE = Path(__file__).resolve().parent
ROOT = HERE.parents[1]
BARE = (
    "make_calibration.py",
    "make_camera_pictures.py",
    "make_fixed_point_plot.py",
    "make_simulator_pictures.py",
    "make_demo_picture.py",
    "make_view_pictures.py",
    "make_tradeoff.py",
)
RECORDINGS = ("make_pictures.py", "make_recording_pictures.py")
RESULTS = {
    "make_tracking_pictures.py": {"--figures": "tracking.json"},
    "make_gesture_pictures.py": {"--figures": "gestures.json", "--real": "gestures_real.json"},
    "make_hand_pictures.py": {"--figures": "hand_velocity.json"},
    "make_load_pictures.py": {"--figures": "load_steps.json"},
    "make_hand_track_pictures.py": {"--figures": "hand.json", "--keep": "hand"},
}
"""Scripts with what each takes of the folder of results."""


def commands(results: Path | None) -> Iterator[tuple[str, list[str], str]]:
    """Yield each script with its arguments, and why it is left out (empty: it is not)."""
    for name in BARE:
        yield name, [], ""
    data = os.environ.get("HANDWAVE_DATA", "")
    for name in RECORDINGS:
        yield name, [], "" if data else "HANDWAVE_DATA names no folder with recordings"
    for name, wanted in RESULTS.items():
        found = {option: str(results / file) for option, file in wanted.items() if results and (results / file).exists()}
        absent = [file for option, file in wanted.items() if option not in found]
        words = [word for pair in found.items() for word in pair]
        yield name, words, f"--results has no {', '.join(absent)}" if absent else ""


def main() -> int:
    """Run the scripts one after the other; returns the exit status: 1 when one failed."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--results", type=Path, metavar="FOLDER", help="results of benchmarks")
    parser.add_argument("--only", default="", metavar="PART", help="only scripts with this in their names")
    options = parser.parse_args()
    failed = []
    for name, words, absent in commands(options.results):
        if options.only not in name:
            continue
        if absent:
            print(f"{name}: left out, {absent}", flush=True)
            continue
        print(f"{name} ...", flush=True)
        if subprocess.run([sys.executable, str(HERE / name), *words], cwd=ROOT, env={**os.environ, "PYTHONPATH": str(ROOT)}).returncode:
            failed.append(name)
    print(f"failed: {', '.join(failed)}" if failed else "all made that could be", flush=True)
    return 1 if failed else 0


if __name__ == "__main__":
    raise SystemExit(main())
