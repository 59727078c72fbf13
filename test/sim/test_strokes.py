"""Directions, speeds and sizes of gestures as a radar in front of the user sees them."""

import dataclasses
import math

import numpy as np
import pytest
from motion_acts import ALIKE, BOTH_ARMS, PLACES, RADAR, STEP, WAYS, azimuth, perform, radial, skeleton

from radar_core import GESTURES
from radar_sim.bodies.base import BONES, REACH
from radar_sim.motions.pace import elbow
from radar_sim.motions.script import Timeline
from radar_sim.motions.strokes import DRAW_LENGTH, ROUNDING, STROKES, draw_position, library_hash, library_samples, random_stroke
from radar_sim.people import GESTURE_DURATION, VARIANTS, Action, Person, Variation


@PLACES
@BOTH_ARMS
@pytest.mark.parametrize("variant", [0, 1])
def test_push_approaches_and_pull_recedes(arm, place, heading, variant):
    """A push is negative, a pull positive, throughout, in both variants (figs. 4.4 and 4.5); 0.3 to 0.6 m at 1.2 to 3 m/s."""
    for name, sign in (("push", -1.0), ("pull", 1.0)):
        hand, _, stroke = perform(name, arm=arm, place=place, heading=heading, variant=variant)
        rate = radial(hand)[stroke]
        assert 1.2 < (sign * rate).max() < 3.0
        assert (sign * rate).min() > -0.1  # sway, and the ends of the stroke
        assert 0.3 < np.ptp(np.linalg.norm(hand[stroke] - RADAR, axis=-1)) < 0.6


@PLACES
@BOTH_ARMS
def test_swipes_go_where_the_user_says(arm, place, heading):
    """To the user's right the azimuth rises, whichever arm and wherever the user stands; up and down are up and down."""
    for name, sign in (("swipe_right", 1.0), ("swipe_left", -1.0)):
        hand, _, stroke = perform(name, arm=arm, place=place, heading=heading)
        change = np.diff(azimuth(hand)[stroke][[0, -1]])[0]
        assert sign * change > math.radians(12)
        assert np.ptp(hand[stroke, 2]) < 0.1
    for name, sign in (("swipe_up", 1.0), ("swipe_down", -1.0)):
        hand, _, stroke = perform(name, arm=arm, place=place, heading=heading)
        assert sign * np.diff(hand[stroke, 2][[0, -1]])[0] > 0.5
        assert np.ptp(azimuth(hand)[stroke]) < math.radians(12)


@BOTH_ARMS
def test_swipes_change_sign_at_boresight(arm):
    """A swipe sideways before the radar first comes nearer, then recedes (figs. 4.6 and 4.7)."""
    for name in ("swipe_right", "swipe_left"):
        hand, _, stroke = perform(name, arm=arm)
        rate = radial(hand)[stroke]
        assert rate[: np.argmax(rate)].min() < -0.8
        assert rate.max() > 0.8
        assert np.argmin(rate) < np.argmax(rate)


def test_an_oblique_swipe_is_one_sided():
    """Far to the side, facing along the radar's axis, a swipe mostly comes nearer or mostly recedes (fig. 4.8); the azimuth still tells."""
    for place, sign in (((2.0, 1.15), 1.0), ((2.0, -1.15), -1.0)):
        hand, _, stroke = perform("swipe_right", place=place, heading=math.pi)
        rate = sign * radial(hand)[stroke]
        assert rate.max() > 2.0 * -rate.min()


@BOTH_ARMS
@pytest.mark.parametrize("variant", [0, 1])
def test_rotate_is_a_full_upright_circle(arm, variant):
    """One full turn; in the plane towards the radar, or in one turned outwards by 40 degrees."""
    hand, _, stroke = perform("rotate", arm=arm, variant=variant)
    ring = hand[stroke] - hand[stroke].mean(0)
    along = ring[:, :2] @ np.linalg.svd(ring[:, :2])[2][0]
    turns = np.unwrap(np.arctan2(ring[:, 2], along))
    assert abs(turns[-1] - turns[0]) == pytest.approx(2 * math.pi, rel=0.05)
    assert np.ptp(hand[stroke, 2]) > 0.4
    outwards = math.degrees(math.atan2(np.ptp(hand[stroke, 1]), np.ptp(hand[stroke, 0])))
    assert outwards == pytest.approx(40.0 * variant, abs=8.0)  # trunk and sway go along


@BOTH_ARMS
def test_push_pull_and_wave(arm):
    """Push-pull: first near, then back. Wave: two to three times to and fro, sideways."""
    hand, _, stroke = perform("push_pull", arm=arm)
    rate = radial(hand)[stroke]
    assert np.argmin(rate) < np.argmax(rate)
    assert abs(np.diff(np.linalg.norm(hand[stroke] - RADAR, axis=-1)[[0, -1]])[0]) < 0.05
    hand, _, stroke = perform("wave", arm=arm)
    side = hand[stroke, 1] - np.median(hand[stroke, 1])
    assert 4 <= (np.diff(np.sign(side[np.abs(side) > 0.05])) != 0).sum() <= 6
    assert 0.4 < np.ptp(side) < 0.7


@pytest.mark.parametrize(("name", "variant"), WAYS)
@BOTH_ARMS
def test_every_gesture_is_one_event(name, variant, arm):
    """Above 0.8 m/s for 0.2 s within the stroke with no rest of 0.2 s (thesis, section 4.2), below it outside; never near 4.2 m/s."""
    for seed in range(3):
        hand, joint, stroke = perform(name, arm=arm, variation=Variation(), seed=seed, variant=variant)
        rate = np.abs(radial(hand))
        fast = np.flatnonzero((rate > 0.8) & stroke)
        assert (fast[-1] - fast[0]) * STEP >= 0.2
        if name != "random":
            assert np.diff(fast).max() * STEP < 0.2
        assert rate[~stroke].max() < 0.8
        assert np.abs(radial(joint))[~stroke].max() < 0.8  # elbows too
        assert np.linalg.norm(np.gradient(hand, STEP, axis=0), axis=-1).max() < 4.2


def test_performances_differ_but_can_be_repeated():
    """Two strokes of one script differ by about the variation; the same seed gives the same ones, another seed others."""
    person = Person(variation=Variation(path=0.03), script=(Action(gesture="push"), Action(gesture="push")))
    grid = np.linspace(0.0, 1.0, 21)
    lines = [Timeline(person, seed) for seed in (1, 1, 2)]
    paths = [[np.array([s.hand(u) for u in grid]) for s in line.segments if s.kind == "gesture"] for line in lines]
    np.testing.assert_array_equal(paths[0], paths[1])
    for one, two in ((paths[0][0], paths[0][1]), (paths[0][0], paths[2][0])):
        assert 0.005 < np.abs(one - two).max() * REACH * 1.75 < 0.3


def test_one_gesture_more_changes_no_other():
    """Performances are drawn one by one: what comes before or in between does not matter."""
    short = Timeline(Person(script=(Action(gesture="push"), Action(gesture="pull"))), 4)
    long = Timeline(Person(script=(Action(fidget=5.0), Action(gesture="push"), Action(stand=3.0), Action(gesture="pull"))), 4)
    for a, b in zip(*([s for s in line.segments if s.kind == "gesture"] for line in (short, long)), strict=True):
        assert a.hand(0.4) == b.hand(0.4)


def test_variation_has_the_spread_it_says():
    """200 pushes: path, pace, size and start are distributed as their knobs say (standard errors of 5 %, asserted to four of them)."""
    variation = Variation(path=0.02, pace=0.1, size=0.08, start=0.3)
    usual = Timeline(Person(variation=ALIKE, script=(Action(gesture="push", at=3.0),)), 0).segments
    still = next(s for s in usual if s.kind == "gesture")
    starts, durations, places, ways = [], [], [], []
    for seed in range(200):
        timeline = Timeline(Person(variation=variation, script=(Action(gesture="push", at=3.0),)), seed)
        stroke = next(s for s in timeline.segments if s.kind == "gesture")
        starts.append(stroke.start - 3.0)
        durations.append((stroke.end - stroke.start) / GESTURE_DURATION["push"])
        places.append(stroke.hand(0.0)[1])
        ways.append(math.dist(stroke.hand(0.0), stroke.hand(1.0)) / math.dist(still.hand(0.0), still.hand(1.0)))
    assert min(starts) >= 0.0
    assert max(starts) <= 0.3 + 1e-9
    assert np.mean(starts) == pytest.approx(0.15, abs=4 * 0.3 / math.sqrt(12 * 200))
    assert np.std(durations) == pytest.approx(0.1, rel=0.2)
    # sideways a push has no size: only the path's shift shows
    assert np.std(places) * REACH * 1.75 == pytest.approx(0.02, rel=0.2)
    # where the arm is nearly stretched the reach takes some of the size away
    assert 0.5 * 0.08 < np.std(ways) < 1.2 * 0.08


def test_chance_never_breaks_a_script():
    """A stroke that starts late or lasts long may delay the next ``at``, but is no reason to refuse it."""
    script = (Action(gesture="push", at=2.0), Action(gesture="pull", at=3.6), Action(gesture="push", at=6.0))
    for seed in range(10):
        timeline = Timeline(Person(variation=Variation(start=0.5, pace=0.3), script=script), seed)
        starts = [s.start for s in timeline.segments if s.kind == "gesture"]
        assert 2.0 - 1e-9 <= starts[0] <= 2.5
        assert 6.0 - 1e-9 <= starts[2] <= 6.5 + 1e-9


@pytest.mark.parametrize("knob", [{"size": 0.8}, {"duration": 0.9}, {"tilt": 0.4}])
def test_strokes_can_be_varied(knob):
    """Size scales the way, duration the speed, and tilt turns a sideways stroke so that its left side comes up."""
    hand, _, stroke = perform("swipe_right", **knob)
    usual, _, usual_stroke = perform("swipe_right")
    width, usual_width = np.ptp(hand[stroke, 1]), np.ptp(usual[usual_stroke, 1])
    if "size" in knob:
        assert width == pytest.approx(0.8 * usual_width, rel=0.05)
    elif "duration" in knob:
        assert stroke.sum() * STEP == pytest.approx(0.9, abs=2 * STEP)
    else:
        assert np.diff(hand[stroke, 2][[0, -1]])[0] == pytest.approx(-math.tan(0.4) * width, rel=0.15)


def test_the_elbow_is_the_skeletons():
    """Moves are timed by an elbow that is where the skeleton has it."""
    rng = np.random.default_rng(0)
    hand = rng.uniform([-0.2, -0.6, -0.9], [0.9, 0.5, 0.6], (200, 3))
    hand = hand[np.linalg.norm(hand, axis=-1) < 0.95]
    timeline = Timeline(Person(variation=Variation(sway=0.0)), 0)
    posture = timeline.posture(np.zeros(len(hand)))
    hands = posture.hands.copy()
    hands[:, 1] = hand
    pose = skeleton(1.75, "male").pose(dataclasses.replace(posture, hands=hands))
    upper, lower = BONES.index("upperarm_r"), BONES.index("lowerarm_r")
    turn = np.array([[math.cos(math.pi), -math.sin(math.pi), 0], [math.sin(math.pi), math.cos(math.pi), 0], [0, 0, 1]])
    joint = (pose.joint[:, lower] - pose.joint[:, upper]) @ turn / (REACH * 1.75)
    np.testing.assert_allclose(joint, elbow(hand), atol=1e-9)


def test_the_library_is_complete_and_within_reach():
    """Every gesture has its variants and a duration, and every stroke and drawing can be reached."""
    assert set(STROKES) | {"random"} == set(GESTURES) == set(GESTURE_DURATION)
    assert {name: len(paths) for name, paths in STROKES.items() if len(paths) > 1} == VARIANTS
    assert max(np.linalg.norm(path, axis=-1).max() for path in library_samples().values()) < 1.0
    rounds = np.array([draw_position(shape, p, 0.35 / (REACH * 1.5)) for shape in DRAW_LENGTH for p in np.linspace(0, 6.3, 64)])
    assert np.linalg.norm(rounds, axis=-1).max() < 1.0


def test_the_library_is_frozen():
    """The hash says which motions a data set holds. If you change a stroke on purpose, put the new value here and make the data anew."""
    assert library_hash() == "70edacad03b3358e0da59f480e98af595989c252ce39472f07d03ba2c0c7dcdc"


def test_the_hash_does_not_depend_on_the_machine():
    """Sines differ by 1e-16 between machines; no sample is nearer than 1e-11 to where rounding would go the other way."""
    for path in library_samples().values():
        steps = path / ROUNDING
        assert np.abs(np.abs(steps - np.floor(steps)) - 0.5).min() * ROUNDING > 1e-11


def test_random_strokes_are_no_gesture_and_differ():
    """Every random stroke starts and ends at rest, stays within reach and is fast towards or away from the radar at least once."""
    grid = np.linspace(0.0, 1.0, 201)
    strokes = [random_stroke(np.random.default_rng(seed)) for seed in range(20)]
    paths = [np.array([stroke(u) for u in grid]) for stroke in strokes]
    for path in paths:
        assert np.linalg.norm(path, axis=-1).max() < 0.94
        speed = np.gradient(path, grid, axis=0) * REACH * 1.75
        assert np.linalg.norm(speed[[0, -1]], axis=-1).max() < 0.02
        assert np.abs(speed[:, 0]).max() > 0.8
    assert min(np.abs(a - b).max() for i, a in enumerate(paths) for b in paths[:i]) > 0.1
