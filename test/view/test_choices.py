"""Measured choices: every one that names parameters names real ones, with values that a node takes."""

import json

import pytest

from radar_app.view.choices import default_folder, load_choices, on_front
from radar_core import ConfigError
from radar_ros.offline import pipeline_config

PANELS = load_choices(default_folder())
CHOICES = [choice for panel in PANELS.values() for choice in panel]


def test_all_stages_are_there():
    """And each knob has several choices, at most one of them the default."""
    assert len(PANELS) >= 20
    for panel in PANELS.values():
        assert len(panel) > 1
        assert sum(choice.default for choice in panel) <= 1


@pytest.mark.parametrize("choice", [c for c in CHOICES if c.settings], ids=lambda c: f"{c.panel}: {c.name}")
def test_settings_are_parameters_that_a_node_takes(choice):
    """They load into the library's configuration, whose knobs are the nodes' parameters."""
    given = {}
    for name, value in choice.settings.items():
        node, _, parameter = name.partition(".")
        given.setdefault(node, {})[parameter] = value
    pipeline_config(given)


def test_the_default_sets_what_is_set_anyway():
    """A default that names parameters names their defaults; panels of the thesis's trackers choose one of these, too."""
    usual = pipeline_config({})
    for choice in CHOICES:
        if choice.default and choice.settings:
            nodes = {}
            for name, value in choice.settings.items():
                node, _, parameter = name.partition(".")
                if name != "tracking.tracker" or choice.panel == "tracker":
                    nodes.setdefault(node, {})[parameter] = value
            assert pipeline_config(nodes) == usual, choice


def test_the_front():
    """Nothing on it is beaten in both."""
    for panel in PANELS.values():
        front = [choice for choice in panel if on_front(choice, panel)]
        assert front
        for one in front:
            assert not any(other.time < one.time and other.loss < one.loss for other in panel)


def test_words_where_there_are_no_results(tmp_path):
    """What is missing, and what makes it."""
    with pytest.raises(ConfigError, match="handwave lab tradeoff"):
        load_choices(tmp_path)
    (tmp_path / "x.json").write_text(json.dumps({"rows": [{"stage": "x"}]}))
    with pytest.raises(ConfigError, match="no result of handwave tradeoff"):
        load_choices(tmp_path)
