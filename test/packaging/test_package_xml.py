"""package.xml names what the package imports, and nodes do without what they can do without."""

import ast
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from catkin_pkg.package import parse_package

ROOT = Path(__file__).resolve().parents[2]
ROOMS = sorted(path.parent.name for path in ROOT.glob("radar_*/__init__.py"))
# Import name: name in pyproject.toml and rosdep key. No key: apt has none, or rosdep would call pip, which Ubuntu 24.04 refuses.
LIBRARIES = {
    "numpy": ("numpy", "python3-numpy"),
    "scipy": ("scipy", "python3-scipy"),
    "numba": ("numba", "python3-numba"),
    "sklearn": ("scikit-learn", "python3-sklearn"),
    "joblib": ("joblib", "python3-joblib"),
    "matplotlib": ("matplotlib", "python3-matplotlib"),
    "pydantic": ("pydantic", "python3-pydantic"),
    "typing_extensions": ("typing-extensions", "python3-typing-extensions"),
    "yaml": ("pyyaml", "python3-yaml"),
    "psutil": ("psutil", "python3-psutil"),
    "serial": ("pyserial", "python3-serial"),
    "rich": ("rich", "python3-rich"),
    "usb": ("pyusb", "python3-usb"),
    "typer": ("typer", ""),
    "finufft": ("finufft", ""),
    "threadpoolctl": ("threadpoolctl", ""),
    "rosbags": ("rosbags", ""),
    "mcap": ("mcap", ""),
    "paho": ("paho-mqtt", "python3-paho-mqtt"),
    "pythonosc": ("python-osc", ""),
    "bokeh": ("bokeh", ""),
    "tornado": ("tornado", "python3-tornado"),
    "h5py": ("h5py", "python3-h5py"),
    "acconeer": ("acconeer-exptool", ""),
}
OPTIONAL = {"av", "bpy", "mathutils", "distributed", "mediapipe", "onnx", "onnxruntime", "torch", "stonesoup", "pyfftw", "selenium"}
"""Extras of pyproject.toml: what needs them says so."""
BRIDGES = {"hri_msgs", "vision_msgs"}
"""Messages of other packages, used where they are installed."""


def imported(*folders):
    """Top-level names that the files of these folders import, anywhere in them."""
    found = set()
    for path in (path for folder in folders for path in sorted(folder.rglob("*.py"))):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Import):
                found |= {alias.name.split(".")[0] for alias in node.names}
            elif isinstance(node, ast.ImportFrom) and node.level == 0:
                found.add(node.module.split(".")[0])
    return found - set(sys.stdlib_module_names) - {*ROOMS, "benchmarks", "handwave"}


@pytest.fixture(scope="module")
def manifest():
    """The manifest as colcon and rosdep read it."""
    return parse_package(str(ROOT / "package.xml"))


@pytest.fixture(scope="module")
def requirements():
    """What goes into the virtual environment: name and specifier."""
    lines = (ROOT / "requirements-ros.txt").read_text().splitlines()
    return dict(re.fullmatch(r"([\w-]+)(\S*)", line).groups() for line in lines if line and not line.startswith("#"))


@pytest.mark.long
def test_every_import_is_declared(manifest, requirements):
    """By its rosdep key, in requirements-ros.txt, or as an extra; messages by their package."""
    declared = {dependency.name for dependency in (*manifest.exec_depends, *manifest.build_depends)}
    used = imported(*(ROOT / room for room in ROOMS), ROOT / "benchmarks", ROOT / "launch")
    unknown = sorted(used - set(LIBRARIES) - OPTIONAL - BRIDGES - declared)
    assert not unknown, f"not in package.xml: {unknown}; add the dependency there, and a row here where its key is not its import's name"
    for name in sorted(used & set(LIBRARIES)):
        distribution, key = LIBRARIES[name]
        assert key in declared or distribution in requirements, f"{name}: {key or distribution} is declared nowhere"


@pytest.mark.long
def test_nothing_is_declared_in_vain(manifest):
    """Every library in the manifest is imported somewhere."""
    used = imported(*(ROOT / room for room in ROOMS), ROOT / "benchmarks")
    keys = {key for name, (_, key) in LIBRARIES.items() if name in used}
    assert {d.name for d in manifest.exec_depends if d.name.startswith("python3-")} <= keys | {"python3-venv"}


def test_versions_are_those_of_pyproject(requirements):
    """One version of a library, wherever it is named; a virtual environment gets what pip would."""
    text = (ROOT / "pyproject.toml").read_text()
    for name, specifier in requirements.items():
        assert f'"{name}{specifier}"' in text, name


def test_the_maintainer_is_the_project(manifest):
    """Nobody is invented, and no page is promised that there is not."""
    (maintainer,) = manifest.maintainers
    assert maintainer.name == "The Handwave project"
    assert maintainer.email.endswith(".invalid")
    assert manifest.urls == []
    assert manifest.authors == []


def test_what_colcon_tests_is_declared(manifest):
    """The folders that `colcon test` runs import nothing but declared test dependencies and the package itself."""
    folders = re.search(r"foreach\(_room ([^)]*)\)\n *ament_add_pytest_test", (ROOT / "CMakeLists.txt").read_text())[1].split()
    assert folders
    declared = {d.name for d in (*manifest.test_depends, *manifest.exec_depends, *manifest.build_depends)}
    for folder in folders:
        own = {path.stem for path in (ROOT / "test" / folder).glob("*.py")} | {"oracles"}
        for name in sorted(imported(ROOT / "test" / folder) - own - OPTIONAL):
            distribution, key = LIBRARIES.get(name, (name, f"python3-{name}"))
            assert {name, key} & declared or distribution == "typer", f"test/{folder} imports {name}"


WITHOUT = """
import importlib, sys
class Missing:
    def find_spec(self, name, path=None, target=None):
        if name.split(".")[0] in {missing!r}:
            raise ModuleNotFoundError(f"No module named {{name!r}}", name=name)
sys.meta_path.insert(0, Missing())
for name in {nodes!r}:
    importlib.import_module(f"radar_ros.nodes.{{name}}")
from radar_app.graph import run_node, run_nodes
from radar_app.launching import launch_description
"""


@pytest.mark.long
def test_nodes_start_without_what_they_can_do_without():
    """Of the libraries without a rosdep key only pydantic and threadpoolctl are needed by all; recordings need rosbags and mcap."""
    from radar_app.graph import NODES

    missing = {
        "finufft",
        "sklearn",
        "joblib",
        "matplotlib",
        "typer",
        "rich",
        "psutil",
        "serial",
        "usb",
        "rosbags",
        "mcap",
        "message_filters",
    }
    code = WITHOUT.format(missing=missing, nodes=[name for name in NODES if name != "recorder"])
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=120)
    assert done.returncode == 0, done.stderr


def test_the_simulator_does_without_finufft(monkeypatch):
    """Auto takes the matrix product in the place of the transform; who names the transform is told what to do."""
    from radar_core import ConfigError, RadarInfo
    from radar_sim import Simulator, load_scene
    from radar_sim.propagation import choose, separable
    from radar_sim.propagation.base import Physics, Sampling

    with_it = Simulator(load_scene("one_user")).process(30).frame.cube
    for module in (choose, separable):
        monkeypatch.setattr(module, "HAS_NUFFT", False)
    without = Simulator(load_scene("one_user")).process(30).frame.cube
    assert 0 < np.linalg.norm(with_it - without) < 1e-3 * np.linalg.norm(with_it)
    info = RadarInfo()
    with pytest.raises(ConfigError, match="needs finufft: pip install finufft"):
        separable.Nufft(Physics(), Sampling(info, np.asarray(info.array.tx), np.asarray(info.array.rx)))
