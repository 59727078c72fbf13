"""`colcon build` in a workspace: messages, Python packages, executables and shared files arrive where ROS tools look."""

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
BUILT = (
    "package.xml",
    "CMakeLists.txt",
    "setup.py",
    "cmake",
    "msg",
    "srv",
    "launch",
    "config",
    "rviz",
    "deploy",
    "scripts",
    "test",
    "pyproject.toml",
)


@pytest.fixture(scope="module")
def workspace(tmp_path_factory):
    """A workspace with this package, built once."""
    root = tmp_path_factory.mktemp("workspace")
    source = root / "src" / "handwave"
    source.mkdir(parents=True)
    for name in [*BUILT, "benchmarks", *(p.name for p in ROOT.glob("radar_*"))]:
        if (ROOT / name).is_dir():
            shutil.copytree(ROOT / name, source / name, ignore=shutil.ignore_patterns("__pycache__"))
        else:
            shutil.copy(ROOT / name, source / name)
    colcon = shutil.which("colcon", path=f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}")
    if colcon is None:
        pytest.skip("colcon is not installed: pip install '.[workspace]'")
    _run(root, "colcon", "build")
    return root


def _run(folder, tool, *words):
    path = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
    environment = {name: value for name, value in os.environ.items() if name != "PIP_CONSTRAINT"} | {"PATH": path}
    command = [shutil.which(tool, path=path), *words]
    done = subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True, timeout=280)
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


@pytest.mark.long
def test_executables_and_shared_files(workspace):
    """`ros2 run` finds one executable per node, `ros2 launch` the launch files, rviz its set-up."""
    prefix = workspace / "install" / "handwave"
    executables = {path.name for path in (prefix / "lib" / "handwave").iterdir()}
    assert {"driver_node", "baseband_node", "tracking_node", "gestures_node", "hand_node", "handwave"} <= executables
    assert all(os.access(prefix / "lib" / "handwave" / name, os.X_OK) for name in executables)
    share = prefix / "share" / "handwave"
    assert list((share / "launch").glob("*.launch.py"))
    assert (share / "config" / "scenes" / "demo.yaml").is_file()
    assert list((share / "rviz").glob("*.rviz"))
    entries = next(prefix.rglob("benchmarks-*.egg-info/entry_points.txt")).read_text()
    assert "[handwave.commands]" in entries
    assert "tradeoff = benchmarks.commands:tradeoff" in entries


@pytest.mark.long
def test_messages_and_packages_import_from_the_workspace(workspace):
    """After sourcing setup.bash, messages and libraries are the workspace's, not this environment's."""
    # The editable install of this environment hooks imports ahead of PYTHONPATH; a user's workspace has no such hook.
    code = (
        "import sys; sys.meta_path = [f for f in sys.meta_path if 'ScikitBuild' not in type(f).__name__];"
        "sys.path = [p for p in sys.path if p];"
        "import handwave.msg, radar_ros, radar_core.paths as p; handwave.msg.TrackArray();"
        "print(handwave.__file__, radar_ros.__file__, p.share_dir(), sep='\\n')"
    )
    command = f". install/setup.sh && exec '{sys.executable}' -c \"{code}\""
    # The wheels of ROS set the library path at the start of Python unless told that it is done already: start afresh.
    environment = {k: v for k, v in os.environ.items() if k in ("PATH", "HOME", "LANG", "TMPDIR")}
    done = subprocess.run(["sh", "-c", command], cwd=workspace, env=environment, capture_output=True, text=True, timeout=60)
    assert done.returncode == 0, done.stderr
    for line in done.stdout.split():
        assert line.startswith(str(workspace / "install")), done.stdout


@pytest.mark.long
def test_colcon_test_runs_what_needs_no_processes(workspace):
    """The rooms that the build names, each with a result that colcon reads; one of them is run here."""
    listed = _run(workspace / "build" / "handwave", "ctest", "-N")
    assert set(re.findall(r"Test +#\d+: (\w+)", listed)) == {"core", "sim", "dsp", "tracking"}
    _run(workspace, "colcon", "test", "--ctest-args", "-R", "core")
    told = _run(workspace, "colcon", "test-result", "--verbose")
    total, errors, failures = (int(n) for n in re.search(r"(\d+) tests, (\d+) errors, (\d+) failures", told).groups())
    assert total > 100
    assert (errors, failures) == (0, 0)
