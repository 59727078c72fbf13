"""What is the same for every board: listed, probed, refused in one line where it is missing; and each fault of a line has its test."""

import json
import re
from pathlib import Path

import numpy as np
import pytest
from dca1000_emulator import encode
from typer.testing import CliRunner

from radar_app.cli import app
from radar_driver.boards import boards
from radar_driver.health import Verdict, probe

ROOT = Path(__file__).resolve().parents[2]
PAGE = ROOT / "docs" / "research" / "boards.md"
BOARDS = ("a121", "bgt60", "dca1000", "ld2450", "ti_demo", "tinyrad")
MISSING = {
    "a121": (["address=127.0.0.1:9"], "start the exploration server on it"),
    "bgt60": ([], "ifxradarsdk"),
    "ld2450": (["port=/dev/nowhere"], "plug the board in"),
    "ti_demo": (["port=/dev/nowhere"], "plug the board in"),
    "tinyrad": ([], "plug it in"),
}
LOAD = ("jitter", "frame rate", "lost frames", "noise floor", "coupling", "receivers")  # of a busy machine, and of samples without a radar


def test_every_board_is_listed():
    """With its knobs, by `handwave devices --boards`."""
    shown = json.loads(CliRunner().invoke(app, ["devices", "--boards", "--json"]).output)["boards"]
    known = {one["board"]: one for one in shown}
    assert set(BOARDS) <= known.keys() & boards().keys()
    assert all(known[name]["knobs"] for name in BOARDS)


@pytest.mark.parametrize("name", MISSING)
def test_a_board_that_is_not_there(name):
    """Status 2, and what to do."""
    settings, words = MISSING[name]
    done = CliRunner().invoke(app, ["probe", name, "--duration", "0.5", "--json", *(f"--set={one}" for one in settings)])
    assert done.exit_code == 2
    checks = json.loads(done.output)["checks"]
    assert checks[0]["verdict"] == "fail"
    assert words in checks[0]["advice"]


def healthy(source, seconds=0.6):
    """Probe a source; the checks that neither load nor made-up samples disturb have to be well."""
    found = probe(source, seconds)
    bad = {check.name: check.advice for check in found.checks if check.verdict is Verdict.FAIL and check.name not in LOAD}
    assert not bad
    assert found.checks[0].verdict is Verdict.OK
    return found


def test_probe_of_a_tinyrad(rig):
    """On the emulated bus: link and temperature."""
    frames = [np.random.default_rng(1).integers(-300, 300, 32768).astype("<i2").tobytes()]
    found = healthy(rig(frames, timeout=2.0).source)
    assert {check.name: check for check in found.checks}["controller.temperature"].value == 31.25


def test_probe_of_a_dca1000(bench):
    """On real sockets and a pseudo terminal: the link, and what the card says of itself."""
    rng = np.random.default_rng(1)
    cube = rng.normal(0, 300, (2, 16, 4, 64)).round() + 1j * rng.normal(0, 300, (2, 16, 4, 64)).round()
    found = healthy(bench([encode(cube)]).source(timeout=2.0), 1.0)
    assert any(key.startswith("capture board") for key in found.report)


def rows():
    """Rows of the page's table of faults: source, then what each column names."""
    text = PAGE.read_text(encoding="utf-8").partition("## Faults of every line, and their tests")[2].partition("\n## ")[0]
    table = [[cell.strip() for cell in line.strip("|").split("|")] for line in text.splitlines() if line.startswith("| ")]
    return {row[0]: row[1:] for row in table[1:] if not row[0].startswith("---")}


def test_every_fault_of_every_line_has_a_test():
    """The page names a test for each source and each fault, and each of them exists; what has none is said in words."""
    found = rows()
    assert {f"`{name}`" for name in (*BOARDS, "cloud2")} <= found.keys()
    for source, cells in found.items():
        for cell in cells:
            named = re.findall(r"`(\w+)::(\w+)`", cell)
            assert named or cell.startswith("—"), (source, cell)
            for file, test in named:
                (path,) = ROOT.glob(f"test/*/test_{file}.py")
                assert f"def test_{test}(" in path.read_text(encoding="utf-8"), (file, test)
