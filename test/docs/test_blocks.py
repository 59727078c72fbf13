"""Every command and every block of Python of README, tutorials and how-tos runs in a test.

What each page shows is on one of three levels:

run
    here, for real, in a folder of its own, one command after the other.
elsewhere
    by the test that `ELSEWHERE` names: graphs that run until Ctrl-C, and what needs samples, chambers or two radars first.
not run
    by no test, because no machine of ours can: boards, ROS 2's own tools, other machines. The page says so itself, in a comment before the
    block: ``<!-- not run: needs the board -->``.

That every line of `handwave` has options which exist is what `test_pages.py` looks for, on all levels.
"""

import os
import pickle
import re
import shlex
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
import rclpy
import typer
from handwave.msg import Track as TrackMsg
from handwave.msg import TrackArray as TrackArrayMsg
from handwave.msg import Zone as ZoneMsg
from handwave.msg import ZoneArray as ZoneArrayMsg
from markdown_blocks import Block, blocks_of, is_shell, shell_lines
from pages import DOCS, ROOT
from typer.testing import CliRunner

sys.path.append(str(Path(__file__).parents[1] / "importers"))
from originals import write_crossing

from radar_app.cli import app
from radar_core import Pose, RadarInfo
from radar_core.mounting import MountCalibration
from radar_dsp.array_file import CalibratedArray, save_array
from radar_ros import qos
from radar_tracking import Tracks

PAGES = [
    ROOT / "README.md",
    ROOT / "examples" / "README.md",
    *sorted((DOCS / "tutorials").glob("*.md")),
    *sorted((DOCS / "how-to").glob("*.md")),
]
ELSEWHERE = {  # beginning of the line to the test, or the folder of tests, that runs such a command
    "handwave demo": "test/e2e/test_demo.py",
    "handwave replay": "test/e2e/test_replay.py",
    "handwave up --mqtt": "test/ros/test_several_rooms.py",
    "handwave up --also": "test/app/test_watching.py",
    "handwave up": "test/ros/test_cli.py",
    "handwave watch": "test/app",
    "handwave status": "test/app",
    "handwave listen": "test/app",
    "handwave doctor": "test/doctor/test_doctor_command.py",
    "handwave view --log": "test/logger/test_logger_page.py",
    "handwave view": "test/view",
    "handwave show": "test/app",
    "handwave record": "test/ros/test_cli.py",
    "handwave gesture": "test/ros/test_own_gestures_graph.py",
    "handwave lab turntable": "test/ros/test_calibrate.py",
    "handwave lab calibrate-camera": "test/ros/test_camera_calibration.py",
    "handwave lab calibrate": "test/ros/test_calibrate.py",
    "handwave lab tradeoff --tune": "test/tradeoff/test_tune.py",
    "handwave lab tradeoff": "test/tradeoff/test_tradeoff.py",
    "handwave tradeoff": "test/tradeoff/test_tune.py",
    "handwave turntable": "test/ros/test_calibrate.py",
    "handwave calibrate-camera": "test/ros/test_camera_calibration.py",
    "handwave calibrate ": "test/ros/test_calibrate.py",
    "handwave devices": "test/ros/test_device_commands.py",
    "handwave lab dataset": "test/ros/test_dataset_commands.py",
    "handwave calibrate-pair": "test/ros/test_calibrate_pair.py",
    "handwave calibrate-tilt": "test/ros/test_calibrate_tilt.py",
    "handwave calibrate-coupling": "test/ros/test_calibrate_coupling.py",
    "handwave probe cube.npy": "test/importers/test_cube_faults.py",
    "make": "Makefile",  # what .ci/run calls
    "python examples": "test/e2e/test_examples.py",
    "python": "",  # a block of the page under that name: below
    ". ": "",
    "cd ": "",
    "do ": "",  # of a loop in the shell
    "done": "",
}
COMMANDS = typer.main.get_command(app).commands
MACHINES = re.compile(
    r"/dev/tty|(?!0\.0\.0\.0|127\.)\b\d+\.\d+\.\d+\.\d+|homeassistant\.local"
    r"|driver\.source=(tinyrad|bgt60|dca1000)|probe (tinyrad|a121|ld2450|ti_demo)"
)
"""What a line must not name unless the page says that it is not run."""


def name(page):
    return str(page.relative_to(ROOT))


def commands_of(page):
    """Commands of a page with the blocks that they stand in."""
    for block in blocks_of(page.read_text(encoding="utf-8")):
        if is_shell(block, COMMANDS):
            for line in shell_lines(block):
                yield block, line


def level_of(line):
    """Where a command is run: a test, or ``here``."""
    for beginning, test in ELSEWHERE.items():
        if line.startswith(beginning):
            return test
    return "here" if line.startswith("handwave ") else None


@pytest.mark.parametrize("page", PAGES, ids=name)
def test_every_command_has_its_level(page):
    """It is run here, or by a test that is there and names it, or the page says why not."""
    wrong = []
    for block, line in commands_of(page):
        if block.not_run:
            continue
        test = level_of(line)
        if test is None:
            wrong.append(f"{line}: nothing runs it; say <!-- not run: REASON --> before its block")
        elif MACHINES.search(line):
            wrong.append(f"{line}: names what a test does not have; say <!-- not run: REASON --> before its block")
        elif test not in ("", "here"):
            words = line.replace("handwave lab ", "handwave ").split()
            word = words[1].removeprefix("examples/").removesuffix(".py")
            files = [ROOT / test] if (ROOT / test).is_file() else sorted((ROOT / test).glob("test_*.py"))
            if not any(word in file.read_text(encoding="utf-8") for file in files):
                wrong.append(f"{line}: {test} does not run {word}")
    assert wrong == []


def test_marks_have_reasons():
    """A block is taken out with a reason that says what is needed, and few are."""
    blocks = [block for page in PAGES for block in blocks_of(page.read_text(encoding="utf-8")) if block.not_run]
    assert blocks
    for block in blocks:
        assert re.match(r"needs |takes ", block.not_run), block.not_run


def test_blocks_are_found():
    """Fences of every language, indented blocks, and the mark before each; a comment and a joined line."""
    page = "\n".join(
        [
            "text",
            "",
            "    handwave up        # runs",
            "    handwave watch && handwave status",
            "",
            "<!-- not run: needs a board -->",
            "```sh",
            "handwave probe a121 \\",
            "    --set x=1",
            "```",
            "",
            "    handwave scenes",
            "```python",
            "import x",
            "```",
        ]
    )
    found = blocks_of(page)
    assert [(block.language, block.not_run) for block in found] == [
        ("indented", ""),
        ("sh", "needs a board"),
        ("indented", ""),
        ("python", ""),
    ]
    assert list(shell_lines(found[0])) == ["handwave up", "handwave watch", "handwave status"]
    assert list(shell_lines(found[1])) == ["handwave probe a121 --set x=1"]
    assert found[3] == Block("python", "import x", "")


def run(folder, line):
    """Run one command in a folder, in this process; it has to end well."""
    before = Path.cwd()
    os.chdir(folder)
    try:
        done = CliRunner().invoke(app, [*shlex.split(line)[1:]])
    finally:
        os.chdir(before)
    assert done.exit_code == 0, f"{line}: {done.output} {done.exception!r}"


def code_of(page, language):
    """Blocks of a page in a language."""
    return [block.code for block in blocks_of((DOCS / page).read_text(encoding="utf-8")) if block.language == language]


def evening(folder, bag="evening"):
    """A second of a person, as raw frames."""
    short = (ROOT / "config" / "scenes" / "short.yaml").read_text(encoding="utf-8")
    (folder / "second.yaml").write_text(short.replace("duration: 6.0", "duration: 1.0"), encoding="utf-8")
    run(folder, f"handwave simulate second.yaml --out {bag}")


def results(folder):
    """What comes out of it."""
    evening(folder)
    run(folder, "handwave process evening --out results")


def own_cube(folder):
    """An evening, a recording of others, and a cube of another radar with the files that describe it, as the page has them."""
    evening(folder)
    write_crossing(folder / "two_people.npz")
    for code in code_of("how-to/record-and-replay.md", "yaml"):
        (folder / re.match(r"# (\w\.yaml)", code)[1]).write_text(code, encoding="utf-8")
    rng = np.random.default_rng(1)
    np.save(folder / "cube.npy", (rng.standard_normal((3, 64, 8, 256, 2)) @ [1, 1j]).astype(np.complex64))


def own_board(folder):
    """The board of the page, and what it reads."""
    (folder / "my_board.py").write_text(code_of("how-to/adding-a-board.md", "python")[0], encoding="utf-8")
    np.random.default_rng(1).integers(-300, 300, (20, 32, 2, 64, 2)).astype("<i2").tofile(folder / "frames.i16")


BEFORE = {  # what a page takes for granted
    "docs/how-to/record-and-replay.md": own_cube,
    "docs/how-to/adding-a-board.md": own_board,
    "docs/how-to/ros.md": results,
    "docs/tutorials/first-five-minutes.md": lambda folder: evening(folder, "out/demo"),
}
HERE = [page for page in PAGES if any(level_of(line) == "here" and not block.not_run for block, line in commands_of(page))]


@pytest.mark.long
@pytest.mark.parametrize("page", HERE, ids=name)
def test_commands_run(page, tmp_path):
    """One after the other, as a reader types them; each ends well."""
    BEFORE.get(name(page), lambda folder: None)(tmp_path)
    for block, line in commands_of(page):
        if level_of(line) == "here" and not block.not_run:
            run(tmp_path, line)


PYTHON_ELSEWHERE = {
    "docs/tutorials/recording-in-python.md": "test/docs/test_pages.py",
    "docs/how-to/adding-a-board.md": "test/driver/test_adding_a_board.py",
}
GIVEN = {  # names that a block takes for granted
    "docs/how-to/calibration.md": lambda: {"info": RadarInfo(frame_id="right/radar")},
    "docs/how-to/zones.md": lambda: {"tracks": Tracks(10**9, 1, "room", (), np.empty(0, np.int32))},
}


def living_room(folder):
    """The zones of the page."""
    (folder / "living_room.yaml").write_text(code_of("how-to/zones.md", "yaml")[0], encoding="utf-8")


def calibrations(folder):
    """Files of a calibrated array, and of a mount that was measured."""
    info = RadarInfo()
    n = info.array.n_tx * info.array.n_rx
    zeros, pairs = np.zeros(n), np.zeros((n, 2))
    found = CalibratedArray(
        info.array, info.waveform.carrier, np.zeros(n, bool), (True, False), zeros, zeros, zeros, zeros, pairs, 1.0, 0.0,
        np.full((1, 2), np.nan), np.full((1, 2), np.nan), 2.0, 10,
    )  # fmt: skip
    save_array(found, folder / "array.npz")
    covariance = ((1e-4, 0.0, 0.0), (0.0, 1e-4, 0.0), (0.0, 0.0, 1e-6))
    mount = MountCalibration(radar="right/radar", reference="left/radar", mount=Pose(y=-0.7, z=1.3), covariance=covariance)
    mount.save(folder / "right.yaml")


FILES = {"docs/how-to/zones.md": living_room, "docs/how-to/calibration.md": calibrations, **BEFORE}
SPINS = re.compile(r"^rclpy\.spin", re.M)
SCRIPTS = [
    (page, number, code) for page in PAGES if name(page) not in PYTHON_ELSEWHERE for number, code in enumerate(code_of(page, "python"))
]


@pytest.mark.long
@pytest.mark.parametrize(("page", "number", "code"), SCRIPTS, ids=lambda value: name(value) if isinstance(value, Path) else "")
def test_python_runs(page, number, code, tmp_path):
    """Each block, in an interpreter of its own; it prints what it should. One that listens to a graph hears messages of ours."""
    FILES.get(name(page), lambda folder: None)(tmp_path)
    before = f"import pickle; globals().update(pickle.loads({pickle.dumps(GIVEN.get(name(page), dict)())!r}))\n"
    (tmp_path / "script.py").write_text(before + code, encoding="utf-8")
    with (tmp_path / "out.txt").open("w") as out:
        process = subprocess.Popen([sys.executable, "script.py"], cwd=tmp_path, stdout=out, stderr=subprocess.STDOUT)
        try:
            if SPINS.search(code):
                talk_until(lambda: (tmp_path / "out.txt").read_text().strip())
                process.send_signal(signal.SIGINT)
                process.wait(timeout=60)
            else:
                assert process.wait(timeout=200) == 0, (tmp_path / "out.txt").read_text()
        finally:
            process.kill()
            process.wait()
    said = (tmp_path / "out.txt").read_text()
    assert bool(said.strip()) == ("print(" in code), said


def talk_until(heard):
    """Publish a person and zones until somebody says something."""
    rclpy.init(args=[])
    node = rclpy.create_node("talker")
    try:
        tracks = node.create_publisher(TrackArrayMsg, "tracks", qos.RESULT)
        zones = node.create_publisher(ZoneArrayMsg, "zones", qos.LATCHED)
        end = time.monotonic() + 60.0
        while not heard():
            assert time.monotonic() < end, "the script prints nothing"
            tracks.publish(TrackArrayMsg(tracks=[TrackMsg(id=1, status=TrackMsg.CONFIRMED, position=[2.0, 0.5, 1.0])]))
            zones.publish(ZoneArrayMsg(zones=[ZoneMsg(name="near", presence=ZoneMsg.OCCUPIED, count=1)]))
            time.sleep(0.1)
    finally:
        node.destroy_node()
        rclpy.try_shutdown()


def test_python_that_runs_elsewhere():
    """The tests that run these pages name them."""
    for page, test in PYTHON_ELSEWHERE.items():
        assert Path(page).stem in (ROOT / test).read_text(encoding="utf-8")
        assert code_of(ROOT / page, "python")
