"""Zones that are drawn: one is changed, the others stay, and what makes no sense changes nothing."""

import pytest

from radar_app.view.zones_file import ZonesFile
from radar_core import ConfigError

SQUARE = [(1.0, 0.0), (2.0, 0.0), (2.0, 1.0), (1.0, 1.0)]
BEFORE = """border: 0.3
zones:
- name: sofa  # the big one
  off_delay: 20.0
  polygon: [[2.0, 0.5], [3.5, 1.2], [3.1, 2.1]]
"""


def test_a_new_file(tmp_path):
    """The first zone makes it."""
    file = ZonesFile(tmp_path / "zones.yaml")
    assert file.layout().zones == ()
    file.save("desk", "counting", SQUARE)
    (zone,) = file.layout().zones
    assert (zone.name, zone.kind, zone.polygon) == ("desk", "counting", tuple(SQUARE))


def test_all_else_stays_and_the_text_of_before_is_kept(tmp_path):
    """Delays and borders that somebody wrote by hand survive a zone that is drawn."""
    path = tmp_path / "zones.yaml"
    path.write_text(BEFORE)
    file = ZonesFile(path)
    file.save("fan", "exclusion", SQUARE)
    file.save("sofa", "counting", SQUARE)
    layout = file.layout()
    assert layout.border == 0.3
    assert [(zone.name, zone.kind, zone.off_delay) for zone in layout.zones] == [("sofa", "counting", 20.0), ("fan", "exclusion", 5.0)]
    assert layout.zones[0].polygon == tuple(SQUARE)
    assert (tmp_path / "zones.yaml.bak").read_text() != path.read_text()
    file.remove("sofa")
    assert [zone.name for zone in file.layout().zones] == ["fan"]


@pytest.mark.parametrize(
    ("name", "corners", "said"),
    [
        ("", SQUARE, "no name|empty"),
        ("room", SQUARE, "whole room"),
        ("x", SQUARE[:2], "three corners"),
        ("x", [*SQUARE[::2], *SQUARE[1::2]], "meets"),
    ],
)
def test_what_is_no_zone_changes_nothing(tmp_path, name, corners, said):
    """The words say why."""
    path = tmp_path / "zones.yaml"
    path.write_text(BEFORE)
    with pytest.raises(ConfigError, match=said):
        ZonesFile(path).save(name, "counting", corners)
    assert path.read_text() == BEFORE
    assert list(tmp_path.iterdir()) == [path]


def test_who_is_not_there_cannot_be_removed(tmp_path):
    """Somebody may have changed the file meanwhile."""
    with pytest.raises(ConfigError, match="no zone 'sofa'"):
        ZonesFile(tmp_path / "zones.yaml").remove("sofa")


def test_a_folder_that_cannot_be_written(tmp_path):
    """Is said, with what to do."""
    with pytest.raises(ConfigError, match="cannot be written"):
        ZonesFile(tmp_path / "nowhere" / "zones.yaml").save("desk", "counting", SQUARE)
