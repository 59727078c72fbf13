"""Rooms and zones with any name give discovery messages that Home Assistant takes."""

import json

import pytest
from home_assistant import TOPIC, check
from hypothesis import given
from hypothesis import strategies as st

from radar_core import ConfigError
from radar_ros.home.entities import Room, gesture_event, slug, slugs

NAMES = st.text(min_size=1, max_size=20).filter(lambda name: name.strip())


@given(NAMES, st.lists(NAMES, unique=True, max_size=4))
def test_any_name_of_a_room_and_of_its_zones_passes_the_schema(name, zones):
    """Topics have only allowed characters, no two entities share one, and names arrive as they were given."""
    found = Room(name).discovery(zones)
    assert len(found) == 15 + 2 * len(zones)
    configurations = [check(topic, payload)[1] for topic, payload in found.items()]
    assert {c["device"]["name"] for c in configurations} == {name}
    unique = [c["unique_id"] for c in configurations if "unique_id" in c]
    assert len(set(unique)) == len(unique)
    states = [c["state_topic"] for c in configurations if "state_topic" in c]
    assert len(set(states)) == len(states)
    assert not any(character in topic for topic in states for character in "#+ \x00")
    assert len({TOPIC.fullmatch(topic)["node"] for topic in found}) == 1


@given(NAMES)
def test_an_identifier_is_the_same_every_time(name):
    """After a restart the house must find its entities again."""
    assert slug(name) == slug(name)
    assert slug(slug(name)) == slug(name)


@pytest.mark.parametrize(
    ("name", "expected"), [("Living room", "living_room"), ("Küche", "kuche"), ("  Bad  2 ", "bad_2"), ("a/b#c+d", "a_b_c_d")]
)
def test_identifiers_can_be_read(name, expected):
    """Letters without accents, one underscore for all that lies between."""
    assert slug(name) == expected


def test_names_that_look_alike_stay_apart():
    """The first keeps the short one, so that adding a zone does not rename another."""
    found = slugs(["Sofa", "sofa", "居間", "寝室"])
    assert found["Sofa"] == "sofa"
    assert len(set(found.values())) == 4
    assert slugs(["Sofa"])["Sofa"] == "sofa"


def test_a_gesture_says_what_how_sure_whose_and_where():
    """Its payload is one JSON object."""
    assert json.loads(gesture_event("pull", 0.98765, 3, zones=["Büro"])) == {
        "event_type": "pull",
        "confidence": 0.988,
        "person": 3,
        "zones": ["Büro"],
    }


@pytest.mark.parametrize("base", ["", "/a", "a/", "a b", "a/#", "+"])
def test_a_base_that_is_no_topic(base):
    """One line that says what it must be."""
    with pytest.raises(ConfigError, match="it must be the beginning of an MQTT topic"):
        Room("a", base=base)


def test_a_room_without_a_name():
    """Blank is no name."""
    with pytest.raises(ConfigError, match="a room needs a name"):
        Room("  ")
