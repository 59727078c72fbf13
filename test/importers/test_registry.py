"""The registry of recordings: complete, and shown by the command; docs/reference/formats.md is made from it."""

import re

import pytest
from typer.testing import CliRunner

from radar_app.cli import app
from radar_lab.importers import KINDS, listing
from radar_lab.importers.layouts import LAYOUTS


@pytest.mark.parametrize("name", KINDS)
def test_everything_is_said_of_each_kind(name):
    """No fact is empty, and none is a sentence with a full stop: pages and the command show them as they are."""
    kind = KINDS[name]
    for fact, value in [("doc", kind.doc), *kind.facts()]:
        assert value, fact
        assert not value.endswith("."), fact


def test_layouts_are_kinds():
    """Each entry can be imported, and its axes are as many as its sizes."""
    assert LAYOUTS.keys() <= KINDS.keys()
    for layout in LAYOUTS.values():
        assert len(layout.axes.split()) == len(layout.shape)


def test_the_command_lists_them():
    """All kinds with their facts, and each kind's name in the help."""
    shown = CliRunner().invoke(app, ["import", "--kinds"])
    assert shown.exit_code == 0
    assert shown.output.strip() == listing()
    for name, kind in KINDS.items():
        assert f"{name}: {kind.doc}" in shown.output
    said = CliRunner().invoke(app, ["import", "--help"], env={"COLUMNS": "200"}).output
    assert set(KINDS) <= set(re.findall(r"\w+", said))
