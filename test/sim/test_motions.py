"""What people do: directions, speeds and sizes of gestures as a radar in front of them sees them; walking, sitting, reaching, drawing."""

import dataclasses
import itertools
import math
from functools import cache

import numpy as np
import pytest

from radar_core import GESTURES, ConfigError
from radar_sim.bodies.base import BONES, LEG, REACH
from radar_sim.bodies.skeleton import Skeleton
from radar_sim.bodies.subject import Subject
from radar_sim.motions.arm import elbow
from radar_sim.motions.curves import bump, cruise, minimum_jerk, through, window, within_reach
from radar_sim.motions.gait import EASE
from radar_sim.motions.script import Timeline
from radar_sim.motions.strokes import DRAW_LENGTH, ROUNDING, STROKES, draw_position, library_hash, library_samples, random_stroke
from radar_sim.people import GESTURE_DURATION, VARIANTS, Action, Draw, Person, Reach, Variation, Vital, Walk

RADAR = np.array([0.0, 0.0, 1.2])
STEP = 0.005
ALIKE = Variation(path=0.0)
WAYS = [(name, variant) for name in GESTURES for variant in range(VARIANTS.get(name, 1))]
FEET = [BONES.index("foot_l"), BONES.index("foot_r")]
BOTH_ARMS = pytest.mark.parametrize("arm", ["right", "left"])
# (x, y) and heading: before the radar, at its sides facing it, and 20 degrees aside facing along its axis
PLACES = pytest.mark.parametrize(
    ("place", "heading"),
    [((2.4, 0.0), None), ((2.3, -0.9), None), ((1.5, 0.8), None), ((2.25, 0.82), math.pi), ((2.25, -0.82), math.pi)],
)


@cache
def skeleton(height: float, sex: str) -> Skeleton:
    return Skeleton(Subject.of(Person(height=height, sex=sex)))


def pose_of(timeline: Timeline, times):
    person = timeline.person
    return skeleton(person.height, person.sex).pose(timeline.posture(times))


def act(*script: Action, seed=1, **person):
    """Timeline of a script, times over all of it and a second more, and the poses."""
    timeline = Timeline(Person(script=script, **person), seed)
    times = np.arange(0.0, timeline.end + 1.0, STEP)
    return timeline, times, pose_of(timeline, times)


def during(timeline: Timeline, times, kind: str):
    """Which of the times belong to segments of a kind."""
    inside = np.zeros(len(times), bool)
    for segment in timeline.segments:
        if segment.kind == kind:
            inside |= (times >= segment.start) & (times < segment.end)
    return inside


def perform(gesture: str, *, arm="right", place=(2.4, 0.0), heading=None, variation=ALIKE, seed=1, **action):
    """Places of the acting hand, of all joints, and a mask of the stroke, for one gesture."""
    timeline, times, pose = act(Action(gesture=gesture, **action), arm=arm, position=place, heading=heading, variation=variation, seed=seed)
    return pose.hand[:, 0 if arm == "left" else 1], pose.joint, during(timeline, times, "gesture")


def radial(points: np.ndarray, step: float = STEP) -> np.ndarray:
    """Range rate seen by the radar [m/s] of points (times, ..., 3)."""
    return np.gradient(np.linalg.norm(points - RADAR, axis=-1), step, axis=0)


def azimuth(points: np.ndarray) -> np.ndarray:
    return np.arctan2(points[..., 1], points[..., 0])


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


def test_a_standing_person_is_never_quite_still():
    """Breath and sway: trunk and head move by millimetres and centimetres per second; feet stand; without sway nothing moves."""
    _, _, pose = act(Action(stand=20.0), position=(2.5, 0.0))
    rate = radial(pose.joint[:, [BONES.index("spine_03"), BONES.index("head")]])
    assert 0.005 < rate.std() < 0.05
    assert np.abs(rate).max() < 0.1
    assert np.ptp(pose.joint[:, FEET], axis=0).max() < 1e-6
    assert 0.005 < np.ptp(pose.breath) < 0.007
    _, _, statue = act(Action(stand=5.0), variation=Variation(sway=0.0))
    assert np.ptp(statue.joint, axis=0).max() == 0.0


def test_breath_and_pulse_have_the_rates_that_the_scene_names():
    """The strongest lines of the chest below and above 0.7 Hz, and their sizes; nobody else moves, and without them nothing changes."""
    vital = Vital(breath_rate=0.2, breath=0.005, heart_rate=1.4, heart=0.0004)
    _, times, pose = act(Action(stand=60.0), variation=Variation(sway=0.0), vital=vital)
    assert np.ptp(pose.joint, axis=0).max() == 0.0
    size = np.abs(np.fft.rfft((pose.breath - pose.breath.mean()) * np.hanning(len(times)))) * 4 / len(times)
    rate = np.fft.rfftfreq(len(times), times[1] - times[0])
    slow = rate < 0.7
    assert rate[np.where(slow, size, 0).argmax()] == pytest.approx(0.2, abs=0.02)
    assert rate[np.where(slow, 0, size).argmax()] == pytest.approx(1.4, abs=0.02)
    assert size[slow].max() == pytest.approx(0.005, rel=0.2)
    assert size[~slow].max() == pytest.approx(0.0004, rel=0.2)


def test_walking():
    """A walk goes straight at its speed, ends where and when it says, and turns the person along and back."""
    timeline, times, pose = act(Action(walk=Walk(to=(2.0, -1.0), speed=1.2)), Action(stand=2.0), position=(4.0, 1.0))
    walk = timeline.segments[0]
    posture = timeline.posture(times)
    speed = np.linalg.norm(np.gradient(posture.place, STEP, axis=0), axis=-1)
    assert np.median(speed[times < walk.end]) == pytest.approx(1.2, rel=1e-3)
    assert speed.max() < 1.21
    assert walk.end == pytest.approx(math.sqrt(8.0) / 1.2 + 0.4)
    np.testing.assert_allclose(posture.place[-1], (2.0, -1.0), atol=1e-9)
    assert math.cos(posture.heading[len(times) // 4] - math.atan2(-2.0, -2.0)) == pytest.approx(1.0)
    assert math.cos(posture.heading[-1] - math.atan2(1.0, -2.0)) == pytest.approx(1.0)
    assert np.abs(np.diff(posture.heading)).max() / STEP < 5.0  # no jumps
    np.testing.assert_allclose(pose.centre[-1, :2], (2.0, -1.0), atol=0.1)


@pytest.mark.parametrize("height", [1.5, 1.75, 1.95])
@pytest.mark.parametrize("speed", [0.6, 1.0, 1.4])
def test_feet_stand_and_swing(height, speed):
    """A foot on the floor does not slide, none goes through the floor, and a foot in the air is slower than 5 m/s."""
    timeline, times, pose = act(Action(walk=Walk(to=(1.5, 0.5), speed=speed)), position=(5.0, 0.0), height=height)
    lift = timeline.posture(times).feet[..., 2] * LEG * height
    ankles = pose.joint[:, FEET]
    assert lift.min() == 0.0
    assert (ankles[..., 2] - ankles[-1, :, 2]).min() > -1e-3
    for foot in (0, 1):
        down = np.flatnonzero(np.diff(np.concatenate([[False], lift[:, foot] == 0.0, [False]]).astype(int)))
        slides = [np.ptp(ankles[a:b, foot, :2], axis=0).max() for a, b in zip(down[::2], down[1::2], strict=True)]
        assert len(slides) >= 3
        assert max(slides) < 0.02
    assert np.linalg.norm(np.gradient(ankles, STEP, axis=0), axis=-1).max() < 5.0
    assert 0.06 < lift.max() < 0.2


def test_gait():
    """At 1 m/s a stride is 1.4 m, arms swing against the legs, and the pelvis bobs by centimetres, twice a stride."""
    timeline, times, pose = act(Action(walk=Walk(to=(1.0, 0.0))), position=(6.0, 0.0), variation=Variation(sway=0.0))
    steady = (times > 1.5) & (times < 4.0)
    ankles, hands = pose.joint[:, FEET, 0] - pose.centre[:, None, 0], pose.hand[..., 0] - pose.centre[:, None, 0]
    landings = pose.joint[:, FEET[0], 0][np.flatnonzero(np.diff((timeline.posture(times).feet[:, 0, 2] == 0).astype(int)) == 1) + 1]
    assert -np.diff(landings)[:-1] == pytest.approx(1.4, abs=0.1)
    for side in (0, 1):
        assert np.corrcoef(ankles[steady, side], hands[steady, side])[0, 1] < -0.8
        assert 0.3 < np.ptp(hands[steady, side]) < 0.7
    bob = pose.joint[steady, 0, 2]
    assert 0.02 < np.ptp(bob) < 0.07
    crossings = np.flatnonzero(np.diff(np.sign(bob - bob.mean())) > 0)
    assert np.diff(crossings).mean() * STEP == pytest.approx(0.7, abs=0.05)


def test_short_and_zero_walks():
    """A step of centimetres, and a walk to where one is, are walks too."""
    for to in ((2.55, 0.0), (2.5, 0.0)):
        timeline, _, pose = act(Action(walk=Walk(to=to)), position=(2.5, 0.0))
        assert timeline.segments[0].end == pytest.approx(0.8)
        np.testing.assert_allclose(pose.joint[-1, FEET, 0].mean(), to[0] - EASE[0] * 1.75, atol=0.02)


def test_sitting():
    """Down to a seat 0.45 m high with the trunk bent forward, feet where they were, gestures, and up again; all of it no event."""
    timeline, times, pose = act(Action(sit=2.0), Action(gesture="push"), Action(stand=2.0), Action(rise=1.0), position=(2.5, 0.0))
    hips = pose.joint[:, [BONES.index("thigh_l"), BONES.index("thigh_r")], 2].mean(1)
    seated = (times > 2.1) & (times < 4.0)
    assert hips[seated] == pytest.approx(0.54, abs=0.03)  # the joint is 9 cm over the seat
    assert hips[-1] == pytest.approx(hips[0], abs=1e-6)
    assert np.ptp(pose.joint[:, FEET], axis=0).max() < 0.02
    assert pose.joint[seated, 0, 0].min() > 2.5 + 0.3  # the person faces -x
    pitch = timeline.posture(times).trunk[:, 0]
    assert pitch[during(timeline, times, "sit")].max() > 0.4
    assert abs(pitch[seated]).max() < 0.15
    still = ~during(timeline, times, "gesture")
    assert np.abs(radial(pose.joint))[still].max() < 0.8
    assert np.abs(radial(pose.hand))[still].max() < 0.8
    thigh = 0.5 * (pose.joint[:, BONES.index("thigh_r")] + pose.joint[:, BONES.index("calf_r")])
    resting = (times > 2.1) & (times < 3.9)
    assert np.linalg.norm(pose.hand[resting, 1] - thigh[resting], axis=-1).max() < 0.2


def test_children_sit_lower():
    """Whose hips are not above an adult's seat sits on a smaller one."""
    _, times, pose = act(Action(sit=2.0), height=0.9)
    hips = pose.joint[:, BONES.index("thigh_l"), 2]
    assert hips[times > 2.5][0] < 0.8 * hips[0]


@pytest.mark.parametrize("seed", range(3))
def test_fidgeting_is_no_event(seed):
    """Hands, trunk and feet move, all below 0.7 m/s; in the end everything is as before."""
    for script in ((Action(fidget=15.0),), (Action(sit=0.5), Action(fidget=15.0))):
        timeline, times, pose = act(*script, seed=seed, position=(2.3, 0.3))
        inside = during(timeline, times, "fidget")
        assert np.abs(radial(pose.joint))[inside].max() < 0.7
        assert np.abs(radial(pose.hand))[inside].max() < 0.7
        assert np.ptp(pose.hand[inside], axis=0).max(-1).min() > 0.1
        if len(script) == 1:
            assert np.ptp(pose.joint[inside][:, FEET], axis=0).max() > 0.02
            np.testing.assert_allclose(pose.joint[-1, FEET], pose.joint[0, FEET], atol=1e-3)


@BOTH_ARMS
def test_reaching(arm):
    """The hand comes to a place in the room to the centimetre, stays, and shakes at 2.5 Hz; too far away it points there."""
    to = (2.0, 0.15, 1.3)
    still = Variation(sway=0.0)
    timeline, times, pose = act(Action(reach=Reach(to=to, hold=2.0)), position=(2.45, 0.0), arm=arm, variation=still)
    hold, hand = during(timeline, times, "reach"), pose.hand[:, 0 if arm == "left" else 1]
    np.testing.assert_allclose(hand[hold], np.broadcast_to(to, hand[hold].shape), atol=0.01)
    timeline, times, pose = act(Action(reach=Reach(to=to, hold=2.0, shake=0.05)), position=(2.45, 0.0), arm=arm, variation=still)
    up = pose.hand[:, 0 if arm == "left" else 1, 2][during(timeline, times, "reach")] - to[2]
    assert np.ptp(up) == pytest.approx(0.1, abs=0.01)
    assert (np.diff(np.sign(up[np.abs(up) > 0.005])) != 0).sum() == pytest.approx(2 * 2.5 * 2.0, abs=1)
    far = np.array([0.5, 0.3, 1.2])
    _, times, pose = act(Action(reach=Reach(to=tuple(far), hold=2.0)), position=(2.45, 0.0), arm=arm, variation=still)
    shoulder = pose.joint[:, BONES.index("upperarm_l" if arm == "left" else "upperarm_r")]
    hand = pose.hand[:, 0 if arm == "left" else 1]
    row = np.argmin(np.linalg.norm(hand - far, axis=-1))
    arm_along, wanted = hand[row] - shoulder[row], far - shoulder[row]
    assert arm_along @ wanted / np.linalg.norm(arm_along) / np.linalg.norm(wanted) > 0.999
    assert np.linalg.norm(arm_along) > 0.97 * REACH * 1.75


def test_shaking_hands():
    """Two people of different size reach for one place at the same time: their hands meet and go up and down together."""
    reach = Action(reach=Reach(to=(2.4, 0.0, 1.05), hold=2.0, shake=0.05), at=1.0)
    one = act(reach, position=(2.4, -0.4), heading=math.pi / 2, height=1.8)
    two = act(reach, position=(2.4, 0.4), heading=-math.pi / 2, height=1.65, sex="female", id=2)
    n = min(len(one[1]), len(two[1]))
    apart = np.linalg.norm(one[2].hand[:n, 1] - two[2].hand[:n, 1], axis=-1)
    both = during(one[0], one[1][:n], "reach") & during(two[0], two[1][:n], "reach")
    assert both.sum() * STEP > 1.5
    assert apart[both].max() < 0.13  # each sways by itself, and one begins to shake a little earlier


@pytest.mark.parametrize("shape", ["circle", "line_up", "line_side", "eight"])
def test_drawing(shape):
    """The hand goes round the shape at the speed and the size it says."""
    timeline, _, _ = act(Action(draw=Draw(shape=shape, duration=4.0, size=0.25, speed=0.6)), position=(2.4, 0.0))
    draw = next(s for s in timeline.segments if s.kind == "draw")
    hand = pose_of(timeline, np.arange(draw.start + 0.6, draw.end - 0.6, STEP)).hand[:, 1]
    speed = np.linalg.norm(np.gradient(hand, STEP, axis=0), axis=-1)
    assert speed.mean() == pytest.approx(0.6, rel=0.1)
    spans = np.ptp(hand, axis=0)[1:]
    wanted = {"circle": (0.5, 0.5), "line_up": (0.0, 0.5), "line_side": (0.5, 0.0), "eight": (0.25, 0.5)}[shape]
    np.testing.assert_allclose(spans, wanted, atol=0.06)  # the trunk goes a little with the arm, and sways


LONG = (
    Action(walk=Walk(to=(2.2, 0.4))),
    *(Action(gesture=name, variant=variant) for name, variant in WAYS),
    Action(draw=Draw(shape="eight")),
    Action(stand=3.0),
    Action(walk=Walk(to=(3.0, -0.5))),
    Action(sit=1.0),
    Action(gesture="wave"),
    Action(fidget=6.0),
    Action(rise=0.5),
    Action(draw=Draw(shape="line_side")),
    Action(walk=Walk(to=(3.05, -0.5))),
    Action(reach=Reach(to=(2.6, -0.3, 1.1), shake=0.03)),
    Action(gesture="push"),
    Action(fidget=8.0),
)
"""Whatever a body can do, one after the other."""


def channels(timeline: Timeline, times) -> np.ndarray:
    """Everything in a posture, in metres and radians, shape (T, 24)."""
    p, height = timeline.posture(times), timeline.person.height
    n = len(times)
    hands, feet = p.hands.reshape(n, 6) * REACH * height, p.feet.reshape(n, 6) * LEG * height
    return np.column_stack([p.place, p.heading, hands, feet, p.pelvis * LEG * height, p.trunk, p.head, p.breath])


@BOTH_ARMS
def test_motion_is_smooth(arm):
    """Places, speeds and accelerations are continuous, within a step and from step to step; no joint is faster than 5 m/s."""
    timeline = Timeline(Person(position=(4.0, 0.0), arm=arm, script=LONG), 3)
    jumps = []
    for step in (2e-3, 1e-3):
        # Across every border, and at random in between: an acceleration that jumps differs by as much however short the step is.
        borders = [s.start for s in timeline.segments]
        middle = np.concatenate([borders, np.random.default_rng(0).uniform(0, timeline.end, 1500)])
        x = channels(timeline, (middle[:, None] + step * np.arange(-1.5, 2.0)).ravel()).reshape(len(middle), 4, -1)
        acceleration = np.diff(x, 2, axis=1) / step**2
        jumps.append(np.abs(np.diff(acceleration, axis=1)).max())
    assert jumps[1] < 0.65 * jumps[0]  # half, for what is smooth
    assert jumps[1] < 6.0  # a stroke of 0.5 s has a jerk of some 1000 m/s^3
    times = np.arange(0.0, timeline.end, 0.01)
    pose = pose_of(timeline, times)
    assert np.linalg.norm(np.diff(pose.joint, axis=0), axis=-1).max() / 0.01 < 5.0
    assert np.linalg.norm(np.diff(pose.hand, axis=0), axis=-1).max() / 0.01 < 5.0


def test_times_in_any_order():
    """A posture is a function of its time alone: several radars ask for the same person at different times, in any order."""
    timeline = Timeline(Person(position=(4.0, 0.0), script=LONG), 3)
    times = np.random.default_rng(1).uniform(-1.0, timeline.end + 2.0, 300)
    together = channels(timeline, times)
    single = np.concatenate([channels(timeline, times[k : k + 1]) for k in range(0, 300, 10)])
    np.testing.assert_array_equal(single, together[::10])
    again = channels(Timeline(Person(position=(4.0, 0.0), script=LONG), 3), np.sort(times))
    np.testing.assert_array_equal(again, together[np.argsort(times)])


def test_segments_follow_without_gaps():
    """Segments cover the script from time 0 to its end; gestures are counted and know their variant."""
    timeline = Timeline(Person(position=(4.0, 0.0), script=LONG), 0)
    segments = timeline.segments
    assert segments[0].start == 0.0
    assert all(a.end == b.start for a, b in itertools.pairwise(segments))
    assert timeline.end == segments[-1].end
    gestures = [s for s in segments if s.kind == "gesture"]
    assert [s.index for s in gestures] == list(range(len(gestures)))
    assert [(GESTURES[s.gesture], s.variant) for s in gestures[: len(WAYS)]] == WAYS
    assert timeline.at(gestures[2].start) is gestures[2]
    assert timeline.at(timeline.end + 1.0) is None


@pytest.mark.parametrize(
    ("script", "message"),
    [
        (
            (Action(walk=Walk(to=(3.0, 0.0))), Action(gesture="push", at=1.0)),
            "person 1, step 2 of the script cannot start at 1 s.*until .* s",
        ),
        ((Action(stand=2.0), Action(walk=Walk(to=(3.0, 0.0)), at=1.0)), "step 2 .* until 2.00 s; start it then or later"),
        ((Action(sit=1.0), Action(walk=Walk(to=(3.0, 0.0)))), "step 2 .*walk while sitting; rise first"),
        ((Action(sit=1.0), Action(sit=1.0)), "step 2 .*sits already"),
        ((Action(rise=1.0),), "step 1 .*stands already"),
    ],
)
def test_what_cannot_follow_is_refused(script, message):
    """Steps that come too early or need another posture name themselves and what to do."""
    with pytest.raises(ConfigError, match=message):
        Timeline(Person(script=script), 0)


def test_an_at_is_kept():
    """A stroke starts when its ``at`` says, be there time to spare or a little hurry needed."""
    script = (Action(gesture="push", at=3.0), Action(gesture="pull", at=4.3), Action(walk=Walk(to=(3.0, 0.0)), at=8.0))
    segments = Timeline(Person(script=script), 0).segments
    starts = [s.start for s in segments if s.kind in ("gesture", "walk")]
    np.testing.assert_allclose(starts, (3.0, 4.3, 8.0), atol=1e-9)


def test_curves():
    """Ramps go from 0 to 1, bumps back to 0, and a curve through places starts at the first and ends at the last."""
    assert [minimum_jerk(u) for u in (-1.0, 0.0, 0.5, 1.0, 2.0)] == [0.0, 0.0, 0.5, 1.0, 1.0]
    assert [bump(u) for u in (-1.0, 0.0, 0.5, 1.0, 2.0)] == [0.0, 0.0, 1.0, 0.0, 0.0]
    assert cruise(0.5, 0.2) == pytest.approx((0.5, 1.0))
    assert window(1.0, 2.0, 0.5) == 1.0
    assert window(0.0, 0.0, 0.5) == 0.0
    path = through([(0.0, 0.0, 0.0), (1.0, 0.0, 0.0), (1.0, 1.0, 0.0)], 0.6)
    assert path(0.0) == (0.0, 0.0, 0.0)
    assert path(1.0) == pytest.approx((1.0, 1.0, 0.0))
    assert within_reach((0.5, 0.0, 0.5)) == (0.5, 0.0, 0.5)
    assert math.hypot(*within_reach((30.0, -40.0, 0.0))) == pytest.approx(0.99)
