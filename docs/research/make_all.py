"""Make every picture of the docs that this machine can make: ``make pictures``.

    python docs/research/make_all.py [--results FOLDER] [--only PART]

Pictures of recordings need HANDWAVE_DATA, the folder with the recordings. Pictures of studies show the stored results
(docs/research/figures, or FOLDER with NAME.json of other runs); one also needs what its study kept (``make figures ARGS=hand``). What is
missing is named and left out.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Sequence
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))  # the benchmarks are not installed

from benchmarks.report import join

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
    "make_tracking_pictures.py": {"--figures": ("tracking",)},
    "make_gesture_pictures.py": {
        "--figures": ("gesture_tables", "gesture_networks"),
        "--real": ("gestures_real",),
        "--people": ("gestures_people",),
        "--transfer": ("gestures_transfer",),
        "--daily": ("gestures_daily",),
        "--rooms": ("gesture_rooms_first",),
    },
    "make_hand_pictures.py": {"--figures": ("hand_velocity",)},
    "make_load_pictures.py": {"--figures": ("load_steps",)},
    "make_hand_track_pictures.py": {"--figures": ("hand",)},
}
"""Scripts with the studies whose results each takes."""
KEPT = {"make_hand_track_pictures.py": {"--keep": ROOT / "build" / "figures" / "hand"}}
"""Scripts with what studies kept when they were run here."""


def one_file(studies: Sequence[str], results: Path, folder: Path) -> Path:
    """Give the file with the results of studies, which is put together in a folder where there are several."""
    if len(studies) == 1:
        return results / f"{studies[0]}.json"
    whole = join(json.loads((results / f"{study}.json").read_text(encoding="utf-8").splitlines()[-1]) for study in studies)
    path = folder / f"{'_'.join(studies)}.json"
    path.write_text(json.dumps(whole), encoding="utf-8")
    return path


def commands(results: Path, folder: Path) -> Iterator[tuple[str, list[str], str]]:
    """Yield each script with its arguments, and why it is left out (empty: it is not); ``folder`` is for files between."""
    for name in BARE:
        yield name, [], ""
    data = os.environ.get("HANDWAVE_DATA", "")
    for name in RECORDINGS:
        yield name, [], "" if data else "HANDWAVE_DATA names no folder with recordings"
    for name, wanted in RESULTS.items():
        kept = KEPT.get(name, {})
        absent = [f"{results / study}.json" for studies in wanted.values() for study in studies if not (results / f"{study}.json").exists()]
        absent += [str(path) for path in kept.values() if not path.is_dir()]
        words = []
        if not absent:
            words = [word for option, studies in wanted.items() for word in (option, str(one_file(studies, results, folder)))]
            words += [word for option, path in kept.items() for word in (option, str(path))]
        yield name, words, f"there is no {', '.join(absent)}" if absent else ""


def main() -> int:
    """Run the scripts one after the other; returns the exit status: 1 when one failed."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument(
        "--results", type=Path, default=HERE / "figures", metavar="FOLDER", help="results of studies; default: those stored"
    )
    parser.add_argument("--only", default="", metavar="PART", help="only scripts with this in their names")
    options = parser.parse_args()
    failed = []
    with tempfile.TemporaryDirectory() as folder:
        for name, words, absent in commands(options.results, Path(folder)):
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
