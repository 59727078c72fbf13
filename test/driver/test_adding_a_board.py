"""The guide's board is loaded from the page itself and works; boards of other packages are found, broken ones hurt nobody."""

import importlib
import itertools
import re
import socket
import sys
import threading
import time
import types
from pathlib import Path

import board_packages
import numpy as np
import pytest
import ti_demo_emulator as ti

from radar_core import ConfigError, DeviceError, RadarFrame
from radar_driver import boards as registry
from radar_driver.health import Verdict, probe
from radar_driver.live import Reader

PAGE = Path(__file__).resolve().parents[2] / "docs" / "how-to" / "adding-a-board.md"


def page_board(*, whole=False):
    """The module that the page's first block of Python is, or all of them one after the other."""
    blocks = re.findall(r"```python\n(.*?)```", PAGE.read_text(encoding="utf-8"), re.S)
    code = "\n".join(blocks if whole else blocks[:1])
    module = types.ModuleType("page_board")
    sys.modules["page_board"] = module  # dataclasses look their types up there
    exec(compile(code, str(PAGE), "exec"), module.__dict__)
    return module if whole else module.BOARD


def until(wanted, timeout=5.0):
    end = time.monotonic() + timeout
    while not wanted() and time.monotonic() < end:
        time.sleep(0.01)
    return wanted()


@pytest.fixture
def recording(tmp_path):
    """Counts as the page's board reads them: 20 frames of (chirp, rx, sample) in int16."""
    path = tmp_path / "frames.i16"
    rng = np.random.default_rng(1)
    rng.integers(-300, 300, (20, 32, 2, 64, 2)).astype("<i2").tofile(path)
    return path


def test_the_page_s_board_gives_frames(recording):
    """Through the reader: frames that fit their description, in order, with the board's own count."""
    board = page_board()
    source = board.open(board.config(path=str(recording), frame_interval=0.01))
    source.power_up()
    frames = []

    def notify():
        reading = reader.take()
        if reading is not None:
            frames.append(reading.data)

    reader = Reader(source, notify)
    reader.start()
    assert until(lambda: len(frames) >= 10)
    reader.stop()
    source.power_down()
    assert all(isinstance(frame, RadarFrame) for frame in frames)
    for frame in frames:
        frame.check(source.info)
    assert all(b.sequence > a.sequence and b.stamp_ns > a.stamp_ns for a, b in itertools.pairwise(frames))
    raw = np.fromfile(recording, "<i2").reshape(20, 32, 2, 64, 2)
    expected = raw[frames[0].sequence % 20] @ np.array([1, 1j])
    np.testing.assert_array_equal(frames[0].cube[0], expected.astype(np.complex64))


def test_the_page_s_board_has_a_health(recording, tmp_path):
    """And says what to do when its file is not there."""
    board = page_board()
    found = probe(board.open(board.config(path=str(recording), frame_interval=0.01)), 0.3)
    assert {"noise floor", "coupling", "saturation"} <= {check.name for check in found.checks}
    # Evenly spread counts from -300 to 299 have the power 2 * 300^2 / 3.
    level = {check.name: check.value for check in found.checks}["noise floor"]
    assert level == pytest.approx(10 * np.log10(2 * 300**2 / 3) - 20 * np.log10(32767), abs=0.3)
    gone = probe(board.open(board.config(path=str(tmp_path / "none"))), 0.3)
    assert gone.verdict is Verdict.FAIL
    assert "there is no" in gone.checks[0].advice
    assert [f.options["path"] for f in board.find()] == []


@pytest.fixture
def fresh(tmp_path, monkeypatch):
    """A registry that looks anew, and a folder on the path for packages of the test."""
    monkeypatch.syspath_prepend(tmp_path)
    importlib.invalidate_caches()
    registry._known.cache_clear()
    yield tmp_path
    registry._known.cache_clear()


GOOD = """
    from radar_core.config import config
    from radar_driver.boards import Board

    @config
    class Knobs:
        '''Nothing to choose.'''

    BOARD = Board("theirs", "somebody's board", Knobs, lambda settings: None, lambda: ())
    SECOND = Board("ti_demo", "takes a name", Knobs, lambda settings: None, lambda: ())
    ODD = Board("a.b", "has a dot", Knobs, lambda settings: None, lambda: ())
    NUMBER = 7
"""


def test_boards_of_other_packages_are_found(fresh):
    """By their entry point; one that takes a name, has an impossible one, is no board or does not load is told and left out."""
    entries = {"theirs": "gb:BOARD", "second": "gb:SECOND", "odd": "gb:ODD", "number": "gb:NUMBER", "gone": "gb:NOTHING"}
    board_packages.install(fresh, "gb", GOOD, entries)
    board_packages.install(fresh, "gb_broken", "raise RuntimeError('no library')", {"faulty": "gb_broken:BOARD"})
    assert registry.board("theirs").title == "somebody's board"
    assert registry.board("ti_demo").title.startswith("TI mmWave")
    reasons = registry.broken()
    assert set(reasons) == {"second", "odd", "number", "gone", "faulty"}
    assert "calls its board 'ti_demo'" in reasons["second"]
    assert "'a.b' cannot be the name of a board" in reasons["odd"]
    assert "it is a int" in reasons["number"]
    assert "RuntimeError: no library" in reasons["faulty"]
    with pytest.raises(ConfigError, match="the board 'faulty': gb_broken:BOARD cannot be used"):
        registry.board("faulty")
    with pytest.raises(ConfigError, match=r"there is no source 'nobody'; choose one of .*theirs"):
        registry.board("nobody")


def first_frame(source):
    """Power up, resume, and read until there is a frame."""
    source.power_up()
    source.resume()
    end = time.monotonic() + 5.0
    while (reading := source.read(0.1)) is None:
        assert time.monotonic() < end
    source.power_down()
    source.power_down()
    reading.data.check(source.info)
    return reading.data.cube


@pytest.fixture
def counts():
    return np.random.default_rng(2).integers(-300, 300, (1, 32, 2, 64, 2)).astype("<i2")


def test_the_page_s_socket(counts):
    """A server that sends a frame in pieces; then it is gone, which is said."""
    module = page_board(whole=True)
    with socket.create_server(("127.0.0.1", 0)) as server:
        settings = module.FileBoard(path=f"127.0.0.1:{server.getsockname()[1]}")

        def serve():
            link, _ = server.accept()
            with link:
                data = counts.tobytes()
                link.sendall(data[:5000])
                time.sleep(0.05)
                link.sendall(data[5000:])

        thread = threading.Thread(target=serve)
        thread.start()
        np.testing.assert_array_equal(first_frame(module.SocketSource(settings)), (counts @ [1, 1j]).astype(np.complex64))
        thread.join()
    with pytest.raises(DeviceError, match="nobody answers at") as caught:
        module.SocketSource(settings).power_up()
    assert caught.value.gone


def test_the_page_s_serial_port(counts, tmp_path):
    """Through a pseudo terminal."""
    board = ti.Board(tmp_path / "tty")
    source = page_board(whole=True).SerialSource(page_board(whole=True).FileBoard(path=str(board.link)))
    source.power_up()
    sender = threading.Timer(0.1, board.send_all, [counts.tobytes()])
    sender.start()
    source.power_up = lambda: None
    np.testing.assert_array_equal(first_frame(source), (counts @ [1, 1j]).astype(np.complex64))
    sender.join()
    board.unplug()


def test_the_page_s_vendor_library(counts, monkeypatch):
    """Where it is not installed, what to install; where it is, its frames."""
    module = page_board(whole=True)
    with pytest.raises(DeviceError, match="pip install vendor_sdk"):
        module.SdkSource(module.FileBoard()).power_up()
    link = types.SimpleNamespace(get_frame=lambda timeout: counts.tobytes(), close=lambda: None)
    monkeypatch.setitem(sys.modules, "vendor_sdk", types.SimpleNamespace(open=lambda path: link, Error=RuntimeError))
    np.testing.assert_array_equal(first_frame(module.SdkSource(module.FileBoard())), (counts @ [1, 1j]).astype(np.complex64))


def test_a_board_in_a_file(tmp_path, recording):
    """Found by its path, with what lies beside it; every other outcome is one message with file and reason."""
    code = re.search(r"```python\n(.*?)```", PAGE.read_text(encoding="utf-8"), re.S)[1]
    path = tmp_path / "my_board.py"
    path.write_text("import beside_it_28\n" + code)
    (tmp_path / "beside_it_28.py").write_text("")
    board = registry.board(str(path))
    assert (board.name, board.variant) == ("file_board", "live")
    assert registry.board(str(path)) is board
    for name, text, message in (
        ("none", "x = 1\n", "none.py cannot be used as a board: ConfigError: it is a NoneType"),
        ("broken", "def (\n", "broken.py cannot be used as a board: SyntaxError"),
        ("taken", code.replace('Board("file_board"', 'Board("tinyrad"'), "calls its board 'tinyrad', as one of ours"),
    ):
        (tmp_path / f"{name}.py").write_text(text)
        with pytest.raises(ConfigError, match=re.escape(message)):
            registry.board(str(tmp_path / f"{name}.py"))
    with pytest.raises(ConfigError, match="there is no Python file"):
        registry.board(str(tmp_path / "gone.py"))
