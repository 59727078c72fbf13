"""The house rules of the design, held by a test: who may import whom, and who may know ROS."""

import ast
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
ORDER = ["radar_core", "radar_sim", "radar_driver", "radar_dsp", "radar_tracking", "radar_gestures", "radar_ros"]
ROS_PACKAGES = {"rclpy", "handwave", "tf2_msgs", "message_filters", "launch", "launch_ros", "builtin_interfaces"}
MODULES = sorted(path for package in ORDER for path in (ROOT / package).rglob("*.py"))


def imported(path: Path) -> set[str]:
    """Every module name that a file imports, lazily or not."""
    names: set[str] = set()
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module and node.level == 0:
            names |= {node.module} | {f"{node.module}.{alias.name}" for alias in node.names}
    return names


def is_node(path: Path) -> bool:
    """A node, or a module beside it that only nodes use."""
    return path.name in ("node.py", "messages.py") or path.parent.name == "nodes"


@pytest.mark.parametrize("path", MODULES, ids=lambda p: str(p.relative_to(ROOT)))
def test_imports_follow_the_house(path):
    """Data flows one way; only nodes and radar_ros know ROS; of radar_ros, only the command imports stages."""
    package = path.relative_to(ROOT).parts[0]
    tops = {name.split(".")[0] for name in imported(path)}
    above = set(ORDER[: ORDER.index(package) + 1])
    if is_node(path):
        above.add("radar_ros")
    assert {t for t in tops if t.startswith("radar_")} <= above
    knows_ros = {t for t in tops if t in ROS_PACKAGES or t.endswith("_msgs") or t.endswith("_srvs")}
    if package != "radar_ros" and not is_node(path):
        assert not knows_ros


def test_every_package_is_built_by_pip_and_by_colcon():
    """The list of packages stands in two build files; they must agree with the folders."""
    folders = {path.parent.name for path in ROOT.glob("radar_*/__init__.py")}
    assert folders == set(ORDER)
    for build_file in ("pyproject.toml", "CMakeLists.txt"):
        text = (ROOT / build_file).read_text()
        assert all(package in text for package in folders), build_file


def test_package_xml_and_pyproject_agree():
    """One name and one version everywhere."""
    import xml.etree.ElementTree as ET

    manifest = ET.parse(ROOT / "package.xml").getroot()
    project = (ROOT / "pyproject.toml").read_text()
    assert f'name = "{manifest.findtext("name")}"' in project
    assert f'version = "{manifest.findtext("version")}"' in project
    assert manifest.findtext("version") in (ROOT / "CHANGELOG.rst").read_text()
