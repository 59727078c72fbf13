"""Hard cases of motions: no times, far times, extreme people, extreme knobs, long scripts."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from radar_core import GESTURES, DataError
from radar_sim.bodies.base import LEG
from radar_sim.bodies.skeleton import Skeleton
from radar_sim.bodies.subject import Subject
from radar_sim.motions.script import Timeline
from radar_sim.people import VARIANTS, Action, Draw, Moves, Person, Reach, Variation, Walk

FIELDS = ("place", "heading", "hands", "feet", "pelvis", "trunk", "head", "breath")


def finite(timeline: Timeline, times) -> bool:
    posture = timeline.posture(np.asarray(times, np.float64))
    return all(np.isfinite(getattr(posture, name)).all() for name in FIELDS)


def test_no_times_and_one():
    """Nothing asked for is nothing given, in the right shapes; a script of nothing stands."""
    timeline = Timeline(Person(), 0)
    empty = timeline.posture(np.empty(0))
    assert empty.hands.shape == (0, 2, 3)
    assert empty.heading.shape == (0,)
    assert timeline.segments == []
    assert timeline.end == 0.0
    assert timeline.posture(np.array([3.0])).feet.shape == (1, 2, 3)


def test_before_the_start_and_far_after_the_end():
    """Before the script the body is as at its start, long after it as at its end; only life goes on."""
    timeline = Timeline(Person(position=(3.0, 0.0), script=(Action(walk=Walk(to=(2.0, 1.0))),), variation=Variation(sway=0.0)), 0)
    posture = timeline.posture(np.array([-1e9, -1.0, 0.0, timeline.end, 1e9]))
    np.testing.assert_array_equal(posture.place[:3], np.tile((3.0, 0.0), (3, 1)))
    np.testing.assert_allclose(posture.place[3:], np.tile((2.0, 1.0), (2, 1)), atol=1e-12)
    assert np.ptp(posture.hands[3:], axis=0).max() == 0.0


@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf])
def test_times_that_are_none(bad):
    """NaN and infinity are refused."""
    with pytest.raises(DataError, match="must be finite"):
        Timeline(Person(), 0).posture(np.array([0.0, bad]))


@pytest.mark.parametrize("height", [0.8, 2.3])
@pytest.mark.parametrize("sex", ["male", "female"])
def test_children_and_giants(height, sex):
    """The smallest and the tallest that can be asked for walk, sit, gesture and reach without a joint out of place."""
    script = (
        Action(walk=Walk(to=(2.0, 0.0), speed=0.8)),
        *(Action(gesture=name, variant=VARIANTS.get(name, 1) - 1) for name in GESTURES),
        Action(sit=0.5),
        Action(reach=Reach(to=(1.6, 0.0, 0.6))),
        Action(rise=0.0),
        Action(fidget=4.0),
    )
    person = Person(height=height, sex=sex, position=(3.0, 0.0), script=script)
    timeline = Timeline(person, 1)
    times = np.arange(0.0, timeline.end + 0.5, 0.02)
    pose = Skeleton(Subject.of(person)).pose(timeline.posture(times))
    assert np.isfinite(pose.joint).all()
    assert pose.joint[..., 2].min() > -0.01
    assert pose.joint[..., 2].max() < height * 1.35  # a hand held up
    assert np.linalg.norm(np.diff(pose.hand, axis=0), axis=-1).max() / 0.02 < 5.0 * max(1.0, height / 1.75)


@pytest.mark.parametrize("walk", [Walk(to=(1e-9, 0.0)), Walk(to=(100.0, 100.0), speed=4.0), Walk(to=(0.3, 0.0), speed=0.05)])
def test_extreme_walks(walk):
    """Nanometres, a hundred metres at a run, six seconds for a step: finite, in time, and there in the end."""
    timeline = Timeline(Person(position=(0.0, 0.0), heading=2.0, script=(Action(walk=walk),)), 0)
    assert finite(timeline, np.linspace(0.0, timeline.end, 500))
    np.testing.assert_allclose(timeline.posture(np.array([timeline.end])).place[0], walk.to, atol=1e-9)
    feet = timeline.posture(np.array([timeline.end])).feet
    assert np.abs(feet).max() * LEG * 1.75 < 1e-9  # side by side again


def test_running_feet_are_fast_but_finite():
    """At 4 m/s feet go at some three times that, and still land."""
    person = Person(position=(20.0, 0.0), script=(Action(walk=Walk(to=(2.0, 0.0), speed=4.0)),))
    timeline = Timeline(person, 0)
    times = np.arange(0.0, timeline.end, 0.005)
    pose = Skeleton(Subject.of(person)).pose(timeline.posture(times))
    assert np.linalg.norm(np.diff(pose.joint, axis=0), axis=-1).max() / 0.005 < 20.0


@pytest.mark.parametrize("duration", [0.5, 0.6, 1.0, 3600.0])
def test_short_and_long_fidgets(duration):
    """Too short for any movement, or an hour of them."""
    timeline = Timeline(Person(script=(Action(gesture="push"), Action(fidget=duration))), 0)
    assert finite(timeline, np.linspace(0.0, min(timeline.end, 100.0), 300))
    assert timeline.end >= duration


def test_a_hand_for_the_shoulder_and_through_the_back():
    """Places at the shoulder, behind, below the floor and far away can be pointed at, and nothing divides by zero."""
    for to in ((2.5, 0.19, 1.4), (3.5, 0.0, 1.0), (2.5, 0.0, -3.0), (-90.0, 90.0, 90.0), (2.5, -0.19, 1.397)):
        timeline = Timeline(Person(position=(2.5, 0.0), script=(Action(reach=Reach(to=to, hold=0.5)),)), 0)
        assert finite(timeline, np.linspace(0.0, timeline.end, 50))


def test_holds_and_stays_of_no_time():
    """Zero seconds of standing, sitting, rising and holding leave no segment without length."""
    script = (Action(stand=0.0), Action(sit=0.0), Action(rise=0.0), Action(reach=Reach(to=(2.0, 0.0, 1.2), hold=0.0)))
    timeline = Timeline(Person(script=script), 0)
    assert all(s.end > s.start for s in timeline.segments)
    assert finite(timeline, [s.start for s in timeline.segments])


@pytest.mark.parametrize(("speed", "pause"), [((0.05, 0.05), (5.0, 5.0)), ((5.0, 5.0), (0.0, 0.0)), ((0.05, 5.0), (0.0, 5.0))])
def test_the_slowest_and_the_fastest_moves(speed, pause):
    """Hands that crawl or dash, with no pause or a long one, through all kinds of steps: no segment without length, nothing infinite."""
    steps = (Action(gesture="push"), Action(gesture="wave"), Action(fidget=3.0), Action(stand=1.0), Action(sit=0.5), Action(gesture="pull"))
    moves = Moves(speed=speed, pause=pause)
    timeline = Timeline(Person(script=(*steps, Action(rise=0.0), Action(stand=0.0)), moves=moves), 0)
    assert all(s.end > s.start for s in timeline.segments)
    assert finite(timeline, np.linspace(0.0, timeline.end, 400))


def test_a_thousand_steps():
    """A long script is laid out without gaps, and any time of it is as cheap as at its start."""
    script = tuple(Action(gesture=GESTURES[k % 10]) if k % 2 else Action(walk=Walk(to=(2.0 + (k % 3), 0.5 * (k % 5)))) for k in range(1000))
    timeline = Timeline(Person(position=(3.0, 0.0), script=script), 0)
    assert timeline.segments[-1].end == timeline.end > 2000.0
    assert finite(timeline, np.random.default_rng(0).uniform(0.0, timeline.end, 500))
    assert np.abs(timeline.posture(np.linspace(0.0, timeline.end, 500)).heading).max() < 1e4


@settings(max_examples=40, deadline=None)
@given(
    name=st.sampled_from(GESTURES),
    size=st.floats(0.4, 1.2),
    tilt=st.floats(-1.6, 1.6),
    duration=st.floats(0.2, 10.0),
    arm=st.sampled_from(["left", "right"]),
    spread=st.floats(0.0, 0.1),
    pace=st.floats(0.0, 0.5),
    seed=st.integers(0, 2**62),
)
def test_any_knobs_of_a_gesture(name, size, tilt, duration, arm, spread, pace, seed):
    """Whatever a scene may ask of a gesture: within reach, finite, one stroke of a sensible length."""
    person = Person(
        arm=arm,
        variation=Variation(path=spread, pace=pace, size=0.3, start=1.0, sway=3.0),
        script=(Action(gesture=name, size=size, tilt=tilt, duration=duration),),
    )
    timeline = Timeline(person, seed)
    times = np.linspace(0.0, timeline.end, 200)
    hands = timeline.posture(times).hands
    assert np.isfinite(hands).all()
    assert np.sqrt((hands**2).sum(-1)).max() < 0.9901
    stroke = next(s for s in timeline.segments if s.kind == "gesture")
    assert 0.2 - 1e-9 <= stroke.end - stroke.start <= 2.0 * duration + 1e-9


@pytest.mark.long
@settings(max_examples=15, deadline=None)
@given(angle=st.floats(-math.pi, math.pi), distance=st.floats(0.0, 6.0), speed=st.floats(0.3, 1.2), heading=st.floats(-6.0, 6.0))
def test_any_walk_is_continuous(angle, distance, speed, heading):
    """In every direction, over every distance: nothing in the posture jumps from one millisecond to the next."""
    to = (distance * math.cos(angle), distance * math.sin(angle))
    timeline = Timeline(Person(position=(0.0, 0.0), heading=heading, script=(Action(walk=Walk(to=to, speed=speed)),)), 0)
    times = np.arange(0.0, timeline.end + 0.1, 1e-3)
    posture = timeline.posture(times)
    assert np.abs(np.diff(posture.place, axis=0)).max() < 1.3e-3
    assert np.abs(np.diff(posture.heading)).max() < 9e-3  # who turns about within the first step of a walk does it at up to 7 rad/s
    assert np.abs(np.diff(posture.feet, axis=0)).max() < 6e-3
    assert np.abs(np.diff(posture.hands, axis=0)).max() < 6e-3
    assert posture.feet[..., 2].min() >= 0.0


def test_drawing_at_the_limits():
    """The fastest and the largest drawing stays within reach and finite."""
    for shape in ("circle", "line_up", "line_side", "eight"):
        timeline = Timeline(Person(height=1.5, script=(Action(draw=Draw(shape=shape, duration=0.5, size=0.35, speed=3.0)),)), 0)
        hands = timeline.posture(np.linspace(0.0, timeline.end, 200)).hands
        assert np.sqrt((hands**2).sum(-1)).max() < 0.9901
