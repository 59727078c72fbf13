"""Damaged files: recordings, archives of arrays, settings, originals of others, and disks that are full while something is written."""

from __future__ import annotations

import functools
import json
import os
import struct
import subprocess
import sys
import tempfile
import zipfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Final

from handwave.msg import StageStatus

from benchmarks.faults_rows import Fault, Seen, refused
from radar_core.config import load_file
from radar_core.ladder import load_ladders
from radar_core.mounting import load_mount
from radar_core.paths import find_config
from radar_gestures.classifiers.model import load_model
from radar_lab.importers import open_original
from radar_ros import bags
from radar_sim import load_scene
from radar_sim.motions.bvh import load_bvh
from radar_tracking import TrackerConfig
from radar_tracking.zones import LayoutConfig

MEANS: Final = "real file"
_MESSAGES: Final = 100
_FLUSHED: Final = 20  # messages of one chunk
_CHUNK, _INDEX = 6, 7  # opcodes
_SCENE: Final = "duration: 1.0\nseed: 3\npoints: [{position: [2.0, 0.5, 1.4], velocity: [0.5, 0, 0], rcs: 0.1}]\n"


@functools.cache
def good_bag() -> tuple[bytes, str]:
    """Content of the files of a recording of 100 messages, flushed every 20."""
    with tempfile.TemporaryDirectory() as folder:
        with bags.BagWriter(Path(folder) / "bag") as writer:
            for number in range(_MESSAGES):
                writer.put("/stage_status", number, StageStatus(stage="faults", sequence=number))
                if number % _FLUSHED == _FLUSHED - 1:
                    writer.flush()
        return (Path(folder) / "bag" / "bag_0.mcap").read_bytes(), (Path(folder) / "bag" / "metadata.yaml").read_text(encoding="utf-8")


def records() -> list[tuple[int, int, int]]:
    """Opcode, begin and end of each record of the file [bytes]."""
    data, at, found = good_bag()[0], 8, []
    while at + 9 <= len(data) - 8:
        end = at + 9 + int.from_bytes(data[at + 1 : at + 9], "little")
        found.append((data[at], at, end))
        at = end
    return found


@contextmanager
def bag(data: bytes, metadata: str | None = "") -> Iterator[Path]:
    """Lay a recording down with this content; metadata: empty for the good one, None for none."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "bag"
        path.mkdir()
        (path / "bag_0.mcap").write_bytes(data)
        if metadata is not None:
            (path / "metadata.yaml").write_text(metadata or good_bag()[1], encoding="utf-8")
        yield path


def _read(path: Path) -> list[int]:
    return [item.stamp_ns for item in bags.read(path)]


def _repaired(data: bytes, kept: int, metadata: str | None = "") -> Seen:
    """Read what is damaged, repair it, and count what is there again of what was ``kept``."""
    with bag(data, metadata) as path:
        seen = refused(lambda: _read(path))
        if not seen.survived:
            return seen
        counts = bags.repair(path)
        found = _read(path)
        whole = counts == {"/stage_status": len(found)} and found == sorted(set(found)) and max(found) < _MESSAGES
        return Seen(whole, seen.lines, max(kept - len(found), 0), note="" if whole else f"{counts} but {len(found)} are read")


def _cut(behind: int, extra: int) -> Seen:
    """End a recording so many bytes behind the record of its third chunk (or that one's index)."""
    ends = [end for opcode, _, end in records() if opcode == behind]
    return _repaired(good_bag()[0][: ends[2] + extra], 3 * _FLUSHED, None)


def _within() -> Seen:
    ends = [(begin, end) for opcode, begin, end in records() if opcode == _CHUNK]
    begin, end = ends[3]
    return _repaired(good_bag()[0][: (begin + end) // 2], 3 * _FLUSHED, None)


def _flipped(opcode: int, number: int, at: float, kept: int) -> Seen:
    """Change one bit within a record."""
    data = bytearray(good_bag()[0])
    begin, end = [(begin, end) for code, begin, end in records() if code == opcode][number]
    data[begin + 9 + int(at * (end - begin - 9))] ^= 4
    return _repaired(bytes(data), kept)


def _nothing(data: bytes, metadata: str | None = "") -> Seen:
    """Of a recording in which nothing is whole, reading and repairing both say so."""
    with bag(data, metadata) as path:
        seen = refused(lambda: _read(path))
        again = refused(lambda: bags.repair(path))
        return Seen(seen.survived and again.survived, seen.lines + again.lines, note=seen.note + again.note)


def _killed() -> Seen:
    """Kill who records, after it has said that so much is in the file."""
    code = (
        "import sys, time\nfrom pathlib import Path\nfrom handwave.msg import StageStatus\nfrom radar_ros import bags\n"
        "writer = bags.BagWriter(Path(sys.argv[1]))\n"
        "for k in range(70): writer.put('/stage_status', k, StageStatus(stage='faults', sequence=k))\n"
        "writer.flush()\nprint('flushed', flush=True)\n"
        "for k in range(70, 90): writer.put('/stage_status', k, StageStatus(stage='faults', sequence=k))\ntime.sleep(60)\n"
    )
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "bag"
        with subprocess.Popen([sys.executable, "-c", code, str(path)], stdout=subprocess.PIPE) as process:
            assert process.stdout is not None
            process.stdout.readline()
            process.kill()
        seen = refused(lambda: _read(path))
        bags.repair(path)
        return Seen(seen.survived, seen.lines, max(70 - len(_read(path)), 0))


def _full_bag() -> Seen:
    """Let the disk be full (a limit of size) while a recording is written."""
    code = (
        "import resource, sys\nfrom pathlib import Path\nfrom handwave.msg import StageStatus\nfrom radar_ros import bags\n"
        "resource.setrlimit(resource.RLIMIT_FSIZE, (20_000, 20_000))\nwriter, kept = bags.BagWriter(Path(sys.argv[1])), 0\n"
        "try:\n    for k in range(1000):\n        writer.put('/stage_status', k, StageStatus(stage='faults', sequence=k))\n"
        "        if k % 20 == 19:\n            writer.flush(); kept = k + 1\n"
        "except OSError as error:\n    print(error)\nprint(kept)\n"
    )
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "bag"
        done = subprocess.run([sys.executable, "-c", code, str(path)], stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True)
        lines = done.stdout.splitlines()
        bags.repair(path)
        found = len(_read(path))
        return Seen(found > 0, lines[:-1], max(int(lines[-1]) - found, 0))


def _text(load: Callable[[Path], Any], text: str | bytes, suffix: str = ".yaml", good: str = "") -> Seen:
    """Read a text file with a fault in it; ``good`` is read afterwards."""
    with tempfile.TemporaryDirectory() as folder:
        path, well = Path(folder) / f"file{suffix}", Path(folder) / f"good{suffix}"
        path.write_bytes(text if isinstance(text, bytes) else text.encode())
        well.write_text(good, encoding="utf-8")
        return refused(lambda: load(path), good=(lambda: load(well)) if good else None)


def _scene(text: str | bytes) -> Seen:
    return _text(load_scene, text, good=_SCENE)


def _model(change: Callable[[bytes], bytes]) -> Seen:
    """Read a gesture model whose file was changed."""
    shipped = find_config("gestures", "models", ".npz")
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "model.npz"
        path.write_bytes(change(shipped.read_bytes()))
        return refused(lambda: load_model(path), good=lambda: load_model(shipped))


def _member(data: bytes, name: str, content: bytes) -> bytes:
    """Put other content in the place of one array."""
    with tempfile.TemporaryDirectory() as folder:
        old, new = Path(folder) / "old.npz", Path(folder) / "new.npz"
        old.write_bytes(data)
        with zipfile.ZipFile(old) as source, zipfile.ZipFile(new, "w") as target:
            for member in source.infolist():
                target.writestr(member.filename, content if member.filename == name else source.read(member))
        return new.read_bytes()


def _array(shape: str, kind: str = "<f4") -> bytes:
    head = f"{{'descr': '{kind}', 'fortran_order': False, 'shape': {shape}, }}".ljust(117) + "\n"
    return b"\x93NUMPY\x01\x00" + struct.pack("<H", len(head)) + head.encode() + bytes(64)


def _original(kind: str, suffix: str, data: bytes, **options: Any) -> Seen:
    """Import somebody's recording."""

    def load(path: Path) -> None:
        for _ in open_original(kind, path, **options).items:
            pass

    return _text(load, data, suffix)


def _command(*words: str, data: bytes, metadata: str | None = "") -> Seen:
    """Let the command look at a damaged recording: one line, status 2, no traceback."""
    with bag(data, metadata) as path:
        done = subprocess.run([sys.executable, "-m", "radar_app", *words, str(path)], capture_output=True, text=True, timeout=120)
        good = done.returncode == 2 and "Traceback" not in done.stderr
        return Seen(good, done.stderr.splitlines(), note="" if good else f"status {done.returncode}")


def _saved() -> Seen:
    """Save settings on a full disk: the file of before stays as it is."""
    code = (
        "import resource, signal, sys\nfrom radar_core.files import write_whole\n"
        "resource.setrlimit(resource.RLIMIT_FSIZE, (100, 100))\ntry:\n    write_whole(sys.argv[1], 'new' * 1000)\n"
        "except OSError as error:\n    print(f'{error.strerror}')\n"
    )
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "settings.yaml"
        path.write_text("old", encoding="utf-8")
        done = subprocess.run([sys.executable, "-c", code, str(path)], capture_output=True, text=True)
        kept = path.read_text(encoding="utf-8") == "old" and os.listdir(folder) == [path.name]
        return Seen(done.returncode == 0, done.stdout.splitlines(), int(not kept))


def _taken() -> Seen:
    """Record into a folder that has a recording."""
    with bag(good_bag()[0]) as path:
        seen = refused(lambda: bags.BagWriter(path))
        seen.lost = _MESSAGES - len(_read(path))
        return seen


def _mount(text: str) -> Seen:
    return _text(load_mount, text)


_KEEP: Final = _MESSAGES - _FLUSHED
_BOMB: Final = "a: &a [1, 1]\n" + "".join(
    f"{b}: &{b} [*{a}, *{a}]\n" for a, b in zip("abcdefghijklmnopqrs", "bcdefghijklmnopqrst", strict=True)
)


FAULTS: Final = (
    *(
        Fault(
            f"recording cut {extra} bytes behind a chunk",
            MEANS,
            "cut off .*handwave repair",
            functools.partial(_cut, _CHUNK, extra),
            quick=extra == 2,
        )
        for extra in (0, 2, 5, 8)
    ),
    Fault("recording cut 5 bytes behind an index", MEANS, "cut off .*handwave repair", functools.partial(_cut, _INDEX, 5)),
    Fault("recording cut within a chunk", MEANS, "cut off .*handwave repair", _within, quick=True),
    Fault("who records is killed", "SIGKILL", "cut off .*handwave repair", _killed),
    Fault("disk full while recording", "RLIMIT_FSIZE", "File too large", _full_bag),
    Fault("one bit of a recorded message", MEANS, "checksum mismatch", functools.partial(_flipped, _CHUNK, 2, 0.5, _KEEP), quick=True),
    Fault("one bit of the first chunk", MEANS, "checksum mismatch", functools.partial(_flipped, _CHUNK, 0, 0.9, _KEEP)),
    Fault(
        "one bit of the index of chunks",
        MEANS,
        "cannot be read as a bag|not where the index says",
        functools.partial(_flipped, 8, 1, 0.25, _MESSAGES),
    ),
    Fault("recording without a byte", MEANS, "seems to be empty|nothing can be recovered", functools.partial(_nothing, b""), quick=True),
    Fault("recording of eight bytes", MEANS, "cannot be read as a bag", lambda: _nothing(good_bag()[0][:8])),
    Fault("recording of noise", MEANS, "magic is invalid", functools.partial(_nothing, bytes(range(256)) * 40)),
    Fault("metadata of a recording is damaged", MEANS, "cannot be read as a bag", lambda: _repaired(good_bag()[0], _MESSAGES, "{x: [")),
    Fault(
        "metadata of a recording is of something else",
        MEANS,
        "cannot be read as a bag",
        lambda: _repaired(good_bag()[0], _MESSAGES, "a: 1\n"),
    ),
    Fault("handwave info of a cut recording", "command", "cut off", lambda: _command("info", data=good_bag()[0][:5000], metadata=None)),
    Fault("handwave repair of an empty recording", "command", "nothing can be recovered", functools.partial(_command, "repair", data=b"")),
    Fault("recording into a folder that has one", MEANS, "choose a folder that does not exist", _taken),
    Fault("settings saved on a full disk", "RLIMIT_FSIZE", "File too large", _saved),
    Fault("key twice in YAML", MEANS, "stands twice", lambda: _scene(_SCENE + "seed: 4\n"), quick=True),
    Fault(
        "true for a duration",
        MEANS,
        "which is no number",
        lambda: _scene(_SCENE.replace("duration: 1.0", "duration: true")),
        quick=True,
    ),
    Fault(
        "number in quotes",
        MEANS,
        "leave the quotes out",
        lambda: _scene(_SCENE.replace("duration: 1.0", "duration: '1.0'")),
        quick=True,
    ),
    Fault("duration that is no number", MEANS, "finite|valid number", lambda: _scene(_SCENE.replace("duration: 1.0", "duration: .nan"))),
    Fault("key that is spelt wrongly", MEANS, "unknown key 'duratoin'", lambda: _scene(_SCENE.replace("duration", "duratoin"))),
    Fault("YAML that is cut off", MEANS, "not valid YAML", lambda: _scene(_SCENE[:-4])),
    Fault("YAML that is no text", MEANS, "is no text|not valid YAML", lambda: _scene(bytes(range(128, 256)))),
    Fault("YAML nested too deeply", MEANS, "not valid YAML", lambda: _scene("a: " + 5000 * "[")),
    Fault(
        "YAML of a million aliases",
        MEANS,
        "unknown key 'a'",
        lambda: _text(lambda path: load_file(TrackerConfig, path), _BOMB + "min_distance: *t\n"),
    ),
    Fault(
        "zone of two corners",
        MEANS,
        "corners|polygon",
        lambda: _text(lambda path: load_file(LayoutConfig, path), "zones: [{name: a, polygon: [[0, 0], [1, 0]]}]\n"),
    ),
    Fault("mount with infinite height", MEANS, "finite", lambda: _mount("version: 1\nradar: radar\nmount: {z: .inf}\n")),
    Fault(
        "levels of accuracy cut off",
        MEANS,
        "is no JSON",
        lambda: _text(load_ladders, json.dumps({"format": 1, "stages": {}})[:-3], ".json"),
    ),
    Fault("gesture model cut off", MEANS, "not a gesture model", lambda: _model(lambda data: data[: len(data) // 2]), quick=True),
    Fault(
        "one bit of a gesture model",
        MEANS,
        "not a gesture model",
        lambda: _model(lambda data: data[:3000] + bytes([data[3000] ^ 16]) + data[3001:]),
    ),
    Fault("array of a terabyte", MEANS, "too much", lambda: _model(lambda data: _member(data, "about.npy", _array("(99999999999,)")))),
    Fault(
        "array of objects",
        MEANS,
        "no array of numbers|not a gesture model",
        lambda: _model(lambda data: _member(data, "about.npy", _array("(1,)", "|O"))),
    ),
    Fault("motion capture cut off", MEANS, "bvh", lambda: _text(load_bvh, "HIERARCHY\nROOT Hips\n{\nOFFSET 0 0", ".bvh")),
    Fault(
        "somebody's raw frames cut off",
        MEANS,
        "cannot be read|npy",
        lambda: _original("openradar", ".npy", _array("(2, 4, 8, 16)", "<c8")),
    ),
    Fault("somebody's archive of noise", MEANS, "crossing|cannot be read", lambda: _original("crossing", ".npz", bytes(range(256)))),
)
