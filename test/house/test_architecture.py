"""The house rules of the design, held by a test: who may import whom, and who may know ROS. There are no exemptions."""

import xml.etree.ElementTree as ET
from pathlib import Path

import pytest

from benchmarks.house import ORDER, circles, imported, imports, modules

ROOT = Path(__file__).resolve().parents[2]
ROS_PACKAGES = {"rclpy", "handwave", "message_filters", "launch", "launch_ros", "builtin_interfaces", "rosbags", "mcap"}
ROS_ROOMS = ("radar_ros", "radar_app", "benchmarks")
MODULES = modules(ROOT)


@pytest.mark.parametrize("name", sorted(MODULES))
def test_imports_follow_the_house(name):
    """A room imports only rooms before it, lazily or not; only the last rooms know ROS."""
    room = name.split(".")[0]
    tops = {other.split(".")[0] for other in imported(MODULES[name])}
    rooms = {top for top in tops if top.startswith("radar_") or top == "benchmarks"}
    assert rooms <= set(ORDER[: ORDER.index(room) + 1])
    if room not in ROS_ROOMS:
        assert not {top for top in tops if top in ROS_PACKAGES or top.endswith(("_msgs", "_srvs"))}


def test_no_module_imports_itself_through_others():
    """No circles, lazy imports included."""
    assert circles(imports(MODULES)) == []


def test_every_package_is_built_by_pip_and_by_colcon():
    """The list of packages stands in two build files; they must agree with the folders."""
    folders = {path.parent.name for path in ROOT.glob("radar_*/__init__.py")} | {"benchmarks"}
    assert folders == set(ORDER)
    for build_file in ("pyproject.toml", "CMakeLists.txt"):
        text = (ROOT / build_file).read_text()
        assert all(package in text for package in folders), build_file


def test_package_xml_and_pyproject_agree():
    """One name and one version everywhere."""
    manifest = ET.parse(ROOT / "package.xml").getroot()
    project = (ROOT / "pyproject.toml").read_text()
    assert f'name = "{manifest.findtext("name")}"' in project
    assert f'version = "{manifest.findtext("version")}"' in project
    assert manifest.findtext("version") in (ROOT / "CHANGELOG.rst").read_text()
