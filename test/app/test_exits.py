"""How commands end, by real processes: full disk, Ctrl-C, closed terminal, closed pipe; in one line, with the right status."""

import os
import pty
import random
import resource
import signal
import subprocess
import sys
import time
from contextlib import suppress
from pathlib import Path

import pytest
from rosbags.highlevel import AnyReader
from typer.testing import CliRunner

from radar_app.cli import app
from radar_core import DataError
from radar_core.files import replacing, write_whole
from radar_ros.bags import BagWriter, contents, incomplete, read, repair, was_cut_off

COMMAND = [sys.executable, "-m", "radar_app"]


def run(*arguments, limit=None, **options):
    """Run a command, no file larger than ``limit`` bytes."""

    def small_files():
        if limit is not None:
            resource.setrlimit(resource.RLIMIT_FSIZE, (limit, limit))

    return subprocess.run(
        [*COMMAND, *map(str, arguments)], capture_output=True, text=True, timeout=120, preexec_fn=small_files, check=False, **options
    )


def one_line(text):
    """Whether it is what `radar_app.exits.say` says, and nothing else."""
    return text.startswith("handwave: ") and text.count("\n") == 1


@pytest.fixture(scope="module")
def raw(tmp_path_factory):
    """One second of raw frames of a room without anybody."""
    folder = tmp_path_factory.mktemp("exits")
    scene = folder / "second.yaml"
    scene.write_text("duration: 1.0\npoints:\n  - {position: [2.0, 0.0, 1.0]}\n")
    bag = folder / "raw"
    assert CliRunner().invoke(app, ["simulate", str(scene), "--out", str(bag)]).exit_code == 0
    return bag


def test_a_device_that_is_full_ends_a_command_that_prints():
    """Python notices only when it flushes; status 74, as of sysexits."""
    with Path("/dev/full").open("w") as full:
        done = subprocess.run([*COMMAND, "scenes"], stdout=full, stderr=subprocess.PIPE, text=True, timeout=60, check=False)
    assert done.returncode == 74
    assert one_line(done.stderr), done.stderr
    assert "the disk is full" in done.stderr


@pytest.mark.long
def test_a_full_disk_leaves_no_bag_that_looks_whole(raw, tmp_path):
    """``simulate`` and ``process``: the bag has no end, so `repair` is asked for, and gets back what had been written."""
    out = tmp_path / "out"
    done = run("simulate", "short", "--out", out, limit=3_000_000)
    assert done.returncode == 74
    assert one_line(done.stderr), done.stderr
    assert str(out) in done.stderr
    assert "Traceback" not in done.stderr + done.stdout
    assert was_cut_off(out)
    with pytest.raises(DataError, match="handwave repair"):
        contents(out)
    repair(out)
    assert contents(out)["/radar/frame"] > 0
    results = tmp_path / "results"
    done = run("process", raw, "--out", results, limit=8_000)
    assert done.returncode == 74, done.stderr
    assert "Traceback" not in done.stderr + done.stdout
    assert was_cut_off(results)


def test_a_full_disk_leaves_a_bag_that_is_repaired_as_it_was(raw, tmp_path):
    """What could not be rescued is still there to be rescued."""
    bag = tmp_path / "cut"
    bag.mkdir()
    whole = next(raw.glob("*.mcap")).read_bytes()
    (bag / "cut_0.mcap").write_bytes(whole[: len(whole) * 2 // 3])
    done = run("repair", bag, limit=1_000_000)
    assert done.returncode == 74
    assert one_line(done.stderr), done.stderr
    assert [path.name for path in bag.iterdir()] == ["cut_0.mcap"]
    assert [path.name for path in tmp_path.iterdir()] == ["cut"]


@pytest.mark.long
def test_whoever_reads_the_output_may_go(tmp_path):
    """``| head -1``: status 141, not a word; with rich tables and with plain lines, before a command and in one."""
    for words in ("scenes", "--help", "devices --boards"):
        line = f"{sys.executable} -m radar_app {words} | head -1 > {tmp_path}/line; echo ${{PIPESTATUS[0]}}"
        done = subprocess.run(["bash", "-c", line], capture_output=True, text=True, timeout=60, check=True)
        assert done.stdout.strip() in ("141", "0"), words  # 0: it had written everything by then
        assert done.stderr == "", words
    line = f"{sys.executable} -m radar_app scenes | (exec <&-; sleep 0.1); echo ${{PIPESTATUS[0]}}"  # nobody reads, ever
    done = subprocess.run(["bash", "-c", line], capture_output=True, text=True, timeout=60, check=True)
    assert (done.stdout.strip(), done.stderr) == ("141", "")


def listens(pid):
    """Whether a process has handlers of its own: Python itself takes no SIGHUP."""
    caught = next(line for line in Path(f"/proc/{pid}/status").read_text().splitlines() if line.startswith("SigCgt"))
    return bool(int(caught.split()[1], 16) & (1 << (signal.SIGHUP - 1)))


def wait_until(done, timeout=30.0):
    end = time.monotonic() + timeout
    while not done():
        assert time.monotonic() < end
        time.sleep(0.01)


@pytest.mark.long
@pytest.mark.parametrize(("number", "seed"), [(signal.SIGINT, 1), (signal.SIGINT, 2), (signal.SIGHUP, 3), (signal.SIGTERM, 4)])
def test_signals_at_any_moment_end_in_one_line(number, seed, raw, tmp_path):
    """While it imports, reads, compiles, writes: status 128 + signal, no traceback; a bag says that it is not all there."""
    rng = random.Random(f"{number}{seed}")
    words = rng.choice([("simulate", "demo"), ("process", str(raw))])
    out = tmp_path / "out"
    with subprocess.Popen([*COMMAND, *words, "--out", str(out)], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
        wait_until(lambda: listens(process.pid))
        time.sleep(rng.uniform(0.0, 3.0))
        process.send_signal(number)
        told, complaint = process.communicate(timeout=30.0)
    assert "Traceback" not in told + complaint
    assert "Exception ignored" not in complaint
    if process.returncode == 0:  # it was done by then
        assert incomplete(out) == ""
        return
    assert process.returncode == 128 + number, complaint
    assert ("handwave: stopped" in complaint) != ("stopped: " in told)  # by the command where it knows more, else by `exits`
    if out.exists():
        assert incomplete(out) or was_cut_off(out)


@pytest.mark.long
@pytest.mark.parametrize("bare", [False, True])
def test_a_closed_terminal_ends_a_command(bare, tmp_path):
    """A real terminal that goes away: SIGHUP, status 129, and nothing hangs though nothing can be written; in a bare environment, too."""
    environment = {name: os.environ[name] for name in ("PATH", "HOME")} if bare else dict(os.environ)
    pid, master = pty.fork()
    if pid == 0:
        os.execve(sys.executable, [*COMMAND, "simulate", "demo", "--out", str(tmp_path / "out")], environment)
    wait_until(lambda: listens(pid))
    time.sleep(0.5)
    os.close(master)
    ended = []
    wait_until(lambda: ended.append(os.waitpid(pid, os.WNOHANG)) or ended[-1][0] == pid)
    assert os.waitstatus_to_exitcode(ended[-1][1]) == 129


def test_a_bag_that_was_stopped_says_so(raw, tmp_path):
    """`info` tells it, other readers see it in the bag's own data, and a whole one says nothing."""
    with suppress(KeyboardInterrupt), BagWriter(tmp_path / "part") as writer:
        for number, item in enumerate(read(raw)):
            writer.write(item.topic, item.msgtype, item.stamp_ns, item.data)
            if number == 10:
                raise KeyboardInterrupt
    assert "stopped before its end" in incomplete(tmp_path / "part")
    assert incomplete(raw) == ""
    with AnyReader([tmp_path / "part"]) as reader:
        assert reader.message_count == 11
    assert "incomplete: " in CliRunner().invoke(app, ["info", str(tmp_path / "part")]).output
    assert "incomplete: " not in CliRunner().invoke(app, ["info", str(raw)]).output


def test_a_file_is_there_as_a_whole_or_not_at_all(tmp_path):
    """Whatever goes wrong meanwhile, the old one stays; nothing else is left."""
    file = tmp_path / "mount.yaml"
    write_whole(file, "x: 1\n")
    for error in (OSError(28, "No space left on device"), KeyboardInterrupt()):
        with suppress(OSError, KeyboardInterrupt), replacing(file) as partial:
            partial.write_text("x: 2")
            raise error
    assert file.read_text() == "x: 1\n"
    assert [path.name for path in tmp_path.iterdir()] == ["mount.yaml"]


@pytest.mark.long
def test_a_path_that_cannot_be_written_is_one_line(raw, tmp_path):
    """A folder that is not there: no traceback, status 2, the path is named."""
    done = run("calibrate-coupling", raw, "-o", tmp_path / "nowhere" / "c.yaml")
    assert done.returncode == 2
    assert one_line(done.stderr), done.stderr
    assert "nowhere" in done.stderr
    assert "No such file" in done.stderr
