"""The page for contributors names only what exists."""

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
PAGE = (ROOT / "CONTRIBUTING.md").read_text()
PATHS = sorted(
    {name.rstrip("/") for name in re.findall(r"`((?:radar_\w+|benchmarks|test|\.ci)(?:/[\w.]+)*/?)`", PAGE)}
    | set(re.findall(r"\]\(([\w./-]+)\)", PAGE))
)


@pytest.mark.parametrize("name", PATHS)
def test_every_path_that_the_page_names_is_there(name):
    """Files and folders, relative to the root of the repository."""
    assert (ROOT / name).exists()


def test_every_room_stands_on_the_page_in_the_order_of_the_house():
    """The table of rooms is the list that the architecture test holds imports against."""
    from benchmarks.house import ORDER

    assert tuple(re.findall(r"^\| `(\w+)` \|", PAGE, re.MULTILINE))[: len(ORDER)] == ORDER


def test_the_way_of_a_frame_takes_ten_steps_with_files():
    """Each step names at least one file."""
    steps = re.findall(r"^\d+\. .*$", PAGE, re.MULTILINE)
    assert len(steps) == 10
    assert all(re.search(r"`radar_\w+/[\w/]+\.py`", step) for step in steps)


@pytest.mark.parametrize("kind", ["board", "effect", "CFAR", "estimator", "gesture model", "command"])
def test_the_page_says_where_to_add(kind):
    """One row for each, with a path that exists."""
    row = next(line for line in PAGE.splitlines() if re.match(rf"\| an? {kind} \|", line))
    assert any(name in row for name in PATHS)


def test_targets_of_make_that_the_page_names_exist():
    """`make x` of the page is a target."""
    targets = set(re.findall(r"^([\w-]+):", (ROOT / "Makefile").read_text(), re.MULTILINE))
    assert set(re.findall(r"make ([\w-]+)", PAGE)) <= targets
