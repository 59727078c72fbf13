"""Colours of people on the page: different for all who are there, kept by each, and bounded over a long day."""

from hypothesis import given
from hypothesis import strategies as st
from test_feed import SECOND, tracks

from radar_app.view.colours import NOBODY, PEOPLE, Colours, colour
from radar_app.view.feed import Feed
from radar_tracking.tracks import TrackStatus

rooms = st.lists(st.sets(st.integers(1, 40), max_size=len(PEOPLE)), min_size=1, max_size=60)


@given(rooms)
def test_nobody_has_the_colour_of_another(room):
    """Whatever their numbers and whoever comes and goes; and each keeps theirs while they are there."""
    colours, before = Colours(), {}
    for here in room:
        colours.see(here)
        worn = {person: colour(colours.numbers, person) for person in here}
        assert len(set(worn.values())) == len(here)
        assert NOBODY not in worn.values()
        assert all(worn[person] == before[person] for person in here if person in before)
        before = worn


def test_who_left_is_remembered_for_a_while():
    """A gesture of somebody who has gone keeps its colour, and after thousands of people few are kept."""
    colours = Colours()
    colours.see({1})
    first = colour(colours.numbers, 1)
    for person in range(2, 12):
        colours.see({person})
    assert colour(colours.numbers, 1) == first
    for person in range(12, 5000):
        colours.see({person, 7000})
    assert len(colours.numbers) < 100
    assert colour(colours.numbers, 7000) != NOBODY
    assert colour(colours.numbers, 1) == NOBODY


def test_more_people_than_colours():
    """All of them have one, and keep it."""
    colours = Colours()
    colours.see(range(20))
    numbers = colours.numbers
    assert {colour(numbers, person) for person in range(20)} == set(PEOPLE)
    colours.see(range(20))
    assert colours.numbers == numbers


def test_the_feed_says_who_has_which():
    """Only who is believed has one; another recording begins anew."""
    feed = Feed()
    feed.put("tracks", 100 * SECOND, tracks(0, 0, 3, 10))
    feed.put("tracks", 101 * SECOND, tracks(0, 0, 4, status=TrackStatus.TENTATIVE))
    assert feed.history().colours == {3: 0, 10: 1}
    feed.put("tracks", 10 * SECOND, tracks(0, 0, 10))
    assert feed.history().colours == {10: 0}
