"""How hands move between gestures: bounds are kept, each move is another, and who was told to is slow."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from radar_core import ConfigError
from radar_sim import Action, Person
from radar_sim.motions.pace import Free, Told
from radar_sim.motions.script import Timeline
from radar_sim.people import Moves

REACH = 0.62
places = st.tuples(*[st.floats(-0.5, 0.5)] * 3)


def speeds(pace, start, end, n=2001):
    """Speeds of the hand on a move [m/s]."""
    seconds, path = pace.time(start, end), pace.path(start, end)
    way = np.array([path(u) for u in np.linspace(0.0, 1.0, n)]) * REACH
    return np.linalg.norm(np.diff(way, axis=0), axis=1) * (n - 1) / seconds


@given(places, places, st.integers(0, 1000))
def test_the_highest_speed_lies_between_the_bounds_and_grows_with_the_root_of_the_way(start, end, seed):
    way = math.dist(start, end)
    pace = Free(Moves(speed=(0.5, 2.0)), REACH, np.random.default_rng(seed))
    if way < 0.05:
        return
    top = speeds(pace, start, end).max()
    slowest = min(0.5 * math.sqrt(way), 1.875 * way * REACH / 0.1)
    assert slowest * 0.999 <= top <= 2.0 * math.sqrt(way) * 1.001


def test_every_move_has_a_speed_of_its_own_drawn_evenly_on_a_scale_of_logarithms():
    pace = Free(Moves(speed=(0.5, 2.0)), REACH, np.random.default_rng(1))
    drawn = []
    for _ in range(2000):
        drawn.append(math.log(speeds(pace, (0.0, 0.0, 0.0), (0.6, 0.0, -0.8), 41).max()))
        pace.turn()
    drawn = np.array(drawn)
    low, high = math.log(0.5), math.log(2.0)
    assert abs(drawn.mean() - (low + high) / 2) < 0.05
    assert abs(drawn.std() - (high - low) / math.sqrt(12)) < 0.03


def test_a_move_to_where_the_hand_is_takes_no_time():
    for pace in (Told(REACH), Free(Moves(), REACH, np.random.default_rng(0))):
        assert pace.time((0.1, 0.2, 0.3), (0.1, 0.2, 0.3)) == 0.0


def test_who_was_told_to_is_slow_and_holds_the_hand_still_for_a_third_of_a_second():
    pace = Told(REACH)
    assert speeds(pace, (0.06, 0.0, -0.93), (0.95, 0.0, -0.05)).max() < 0.91
    assert pace.pause() == 0.35


def person(moves, *script):
    return Person(position=(2.0, 0.0), moves=moves, script=script)


def around(timeline):
    """Kinds of what stands before and after each gesture, and how long these take [s]."""
    found = []
    for k, segment in enumerate(timeline.segments):
        if segment.kind == "gesture":
            found += [timeline.segments[k - 1], timeline.segments[k + 1]]
    return found


PUSHES = tuple(step for _ in range(12) for step in (Action(stand=1.5), Action(gesture="push")))


def test_pauses_around_gestures_lie_between_the_bounds():
    held = [s.end - s.start for s in around(Timeline(person(Moves(pause=(0.1, 0.4)), *PUSHES), 3)) if s.kind == "stand"]
    assert len(held) == 24
    assert 0.1 <= min(held) < 0.2
    assert 0.3 < max(held) <= 0.4
    assert {s.kind for s in around(Timeline(person(Moves(pause=(0.0, 0.0)), *PUSHES), 3))} <= {"move", "stand"}


def test_the_hand_goes_down_at_once_and_then_rests():
    """Who was told to move slowly lowers it over all of the time that they stand."""
    free = Timeline(person(Moves(), Action(gesture="push"), Action(stand=20.0)), 3)
    lowering = [s for s in free.segments if s.kind == "move"][1]
    assert lowering.end - lowering.start < 3.0
    assert free.segments[-1].kind == "stand"
    assert free.segments[-1].hand(0.0) == pytest.approx(free.segments[-1].hand(1.0))
    assert free.end == pytest.approx(Timeline(person(Moves(), Action(gesture="push")), 3).end - (lowering.end - lowering.start) + 20.0)
    told = Timeline(person(None, Action(gesture="push"), Action(stand=20.0)), 3)
    assert told.segments[-1].end - told.segments[-1].start == 20.0


def test_moves_of_one_person_change_nothing_in_the_strokes():
    """The same strokes, whatever the hands do in between; and the same draws give the same person."""
    one, two = (Timeline(person(moves, *PUSHES), 3) for moves in (None, Moves()))
    strokes = [[s.hand(0.3) for s in t.segments if s.kind == "gesture"] for t in (one, two)]
    assert strokes[0] == strokes[1]
    again = Timeline(person(Moves(), *PUSHES), 3)
    assert [s.end for s in again.segments] == [s.end for s in two.segments]
    assert [s.end for s in Timeline(person(Moves(), *PUSHES), 4).segments] != [s.end for s in two.segments]


@pytest.mark.parametrize("script", [PUSHES, (Action(fidget=20.0),), (Action(sit=1.0), Action(gesture="wave"), Action(rise=1.0))])
def test_hands_never_jump(script):
    timeline = Timeline(person(Moves(speed=(2.0, 4.0), pause=(0.0, 0.0)), *script), 5)
    hand = np.concatenate([[s.hand(u) for u in np.linspace(0.0, 1.0, max(2, round(500 * (s.end - s.start))))] for s in timeline.segments])
    assert np.abs(np.diff(hand, axis=0)).max() * REACH * 500 < 8.0


def test_bounds_the_wrong_way_round_are_refused():
    with pytest.raises(ConfigError, match=r"Moves\.speed: the lower bound 2 is above the upper one, 1"):
        Moves(speed=(2.0, 1.0))
    with pytest.raises(ConfigError, match=r"Moves\.pause"):
        Moves(pause=(0.5, 0.1))
