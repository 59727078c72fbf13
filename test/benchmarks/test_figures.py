"""What makes figures: a result is out of date when its code changed, and only then; what is done is not done again."""

import json
import os
import signal
import subprocess
import sys
import time

import pytest

from benchmarks import figures
from benchmarks.house import ROOT
from benchmarks.studies import STUDIES, Study

LISTED = """
import importlib, json, sys
importlib.import_module(sys.argv[1])
print(json.dumps([name for name in sys.modules if name.split(".")[0].startswith(("radar_", "benchmarks"))]))
"""


STUDY = """
import pathlib, sys, time
folder = pathlib.Path(sys.argv[1])
try:
    (folder / "begun").touch()
    time.sleep(60)
except KeyboardInterrupt:
    time.sleep(1)
    (folder / "tidied").touch()
"""


def test_an_interrupted_study_may_stop_what_it_started(tmp_path):
    """Ctrl-C reaches both: the study is not killed while it still tidies up."""
    told = f"import sys; from benchmarks.figures import _output; _output([sys.executable, '-c', {STUDY!r}, {str(tmp_path)!r}])"
    with subprocess.Popen([sys.executable, "-c", told], cwd=ROOT, start_new_session=True, stderr=subprocess.DEVNULL) as running:
        end = time.monotonic() + 60.0
        while not (tmp_path / "begun").exists() and time.monotonic() < end:
            time.sleep(0.05)
        os.killpg(running.pid, signal.SIGINT)
        assert running.wait(30.0) != 0
    assert (tmp_path / "tidied").exists()


def test_comments_change_nothing(tmp_path):
    """A docstring, a comment, a line break: the same; a number, another order, a byte of data: not."""
    said = []
    for number, text in enumerate(
        ("def f(x):\n    return x + 1\n", 'def f(x):\n    """One more."""\n    return (x +\n        1)  # one\n')
    ):
        path = tmp_path / f"{number}.py"
        path.write_text(text, encoding="utf-8")
        said.append(figures.fingerprint(path))
    assert said[0] == said[1]
    for name, text in (("2.py", "def f(x):\n    return x + 2\n"), ("a.yaml", "x: 1\n"), ("b.yaml", "x: 1 # one\n")):
        (tmp_path / name).write_text(text, encoding="utf-8")
        said.append(figures.fingerprint(tmp_path / name))
    assert len(set(said)) == 4


@pytest.mark.long
def test_what_a_study_imports_is_its_code():
    """Modules that a process holds after the import are of the code; so are those imported later, and nodes that a graph names."""
    command = [sys.executable, "-c", LISTED, "benchmarks.probe"]
    held = json.loads(subprocess.run(command, capture_output=True, text=True, check=True, cwd=ROOT).stdout)
    assert {one for one in held if not (ROOT / one.replace(".", "/")).is_dir()} - figures.closure("benchmarks.probe") == set()
    assert {"radar_tracking.poisson.person", "radar_dsp.baseband", "radar_sim.simulator"} <= figures.closure("benchmarks.living")
    assert "radar_ros.nodes.baseband" in figures.closure("benchmarks.graph")
    assert "radar_ros.nodes.baseband" not in figures.closure("benchmarks.living")


@pytest.mark.long
def test_configurations_that_modules_name_are_code():
    assert {"config/scenes/two_radars.yaml", "config/tracking/thesis.yaml"} <= figures.code(STUDIES["tracking"]).keys()
    assert "config/models/gestures.npz" in figures.code(STUDIES["gesture_streams"])


@pytest.mark.long
def test_what_is_done_is_not_done_again(tmp_path, capsys):
    """A real study with little data, through all states of its stored result."""
    assert figures.outdated("probe", tmp_path).startswith("not stored")
    assert figures.make("probe", tmp_path, ["--quick"]) == ""
    stored, record = tmp_path / "probe.json", tmp_path / "made" / "probe.json"
    assert "right" in json.loads(stored.read_text(encoding="utf-8"))
    assert figures.outdated("probe", tmp_path) == ""
    before = stored.stat().st_mtime_ns
    assert figures.make_all(["probe"], tmp_path)
    assert (stored.stat().st_mtime_ns, capsys.readouterr().out) == (before, "1 of 1 are of this code\n")
    made = json.loads(record.read_text(encoding="utf-8"))
    code = made["code"] | {"benchmarks/probe.py": "00000000", "radar_core/gone.py": "00000000"}
    record.write_text(json.dumps(made | {"code": code}), encoding="utf-8")
    assert figures.outdated("probe", tmp_path) == f"benchmarks/probe.py, radar_core/gone.py changed since {made['date']}"
    record.write_text(json.dumps(made | {"command": "python -m benchmarks probe"}), encoding="utf-8")
    assert "its command was" in figures.outdated("probe", tmp_path)
    record.unlink()
    assert "nobody knows" in figures.outdated("probe", tmp_path)


def test_a_study_that_fails_is_told_and_stores_nothing(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(figures, "STUDIES", {"probe": Study("probe --no-such-option")})
    assert not figures.make_all(["probe"], tmp_path)
    assert "failed with status 2" in capsys.readouterr().out
    assert list(tmp_path.iterdir()) == []


def test_only_a_release_fails(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(figures, "folder", lambda: tmp_path)
    assert figures.main(["--check", "probe"]) == 0
    assert "probe: not stored" in capsys.readouterr().out
    assert figures.main(["--check", "--release", "probe"]) == 1
    with pytest.raises(SystemExit):
        figures.main(["--check", "no_such_study"])
