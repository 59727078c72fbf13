"""Whose a track is, and what the area under the curve means, by hand."""

import math

import numpy as np
import pytest

from benchmarks.living import KINDS, Judged, auc, figures, room, whose
from radar_tracking.tracks import Track, TrackStatus


def track(x, y):
    zero = np.zeros(3)
    return Track(1, TrackStatus.CONFIRMED, 1.0, 0.0, 3, np.array([x, y, 1.0]), zero, zero, np.eye(6))


def test_tracks_belong_to_who_is_near_and_to_nobody_between():
    """The nearest to the person, one beside it, one on the thing, one between both, one far from both."""
    person, thing = np.array([2.0, 0.0, 1.0]), np.array([[2.0, 1.4, 0.1], [2.2, 1.4, 0.1]], np.float32)
    tracks = [track(2.1, 0.0), track(2.3, 0.0), track(2.2, 1.5), track(2.0, 0.7), track(5.0, 0.0)]
    assert whose(tracks, person, thing, "vacuum") == ["person", "", "vacuum", "", ""]
    assert whose([], person, thing, "vacuum") == []


def test_the_area_under_the_curve():
    """All people above all things: 1; all below: 0; none of either: not known."""
    assert auc([2.0, 3.0], [-1.0, 1.0]) == 1.0
    assert auc([-2.0], [-1.0, 1.0]) == 0.0
    assert math.isnan(auc([], [1.0]))


@pytest.mark.long
def test_figures_count_each_track_once_and_pets_apart():
    """People above fans, below pets: the area is that against things; a track at an age has the odds of its last look."""
    tracks = [Judged(number, "person", np.array([0.5, 2.0]), np.array([-1.0, 3.0])) for number in range(5)]
    tracks += [Judged(number, "fan", np.array([0.5, 2.0]), np.array([-3.0, -4.0])) for number in range(5)]
    tracks += [Judged(number, "pet", np.array([0.5, 2.0]), np.array([5.0, 5.0])) for number in range(5)]
    found = figures(tracks)
    assert found["auc"] == 1.0
    assert found["auc_interval"] == [1.0, 1.0]
    assert found["auc_against"]["pet"] == 0.0
    assert found["by_kind"]["pet"]["taken_for_a_person"] == 1.0
    assert tracks[0].at(1.0) == -1.0
    assert tracks[0].at(0.1) == -1.0  # there is no earlier look


@pytest.mark.parametrize("number", range(4))
def test_a_room_has_one_person_and_its_thing(number):
    scene = room(number)
    assert len(scene.people) == 1
    assert (len(scene.fans), len(scene.curtains), len(scene.movers)) == {
        "fan": (1, 0, 0), "curtain": (0, 1, 0), "vacuum": (0, 0, 1), "pet": (0, 0, 1),
    }[KINDS[number]]  # fmt: skip
