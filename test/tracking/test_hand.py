"""Hand tracking on synthetic clouds with truth, and the rules of starting and ending."""

import numpy as np
import pytest
from blobs import FRAME_NS, Blobs, Person, make_cloud, standing

from radar_core import ConfigError
from radar_tracking import HandConfig, HandTrack, HandTracker, PeopleTracker, TrackedCloud
from radar_tracking.hand import SplitConfig, ValueConfig

SECOND = 50  # clouds


def circle(radius: float, speed: float, reach: float = 0.5):
    """A hand that draws circles upright in front of the right shoulder."""
    rate = speed / radius
    return lambda t: np.array([-reach, 0.1 + radius * np.cos(rate * t), 0.3 + radius * np.sin(rate * t)])


def line(half: float, speed: float, direction: tuple[float, float, float]):
    """A hand that goes to and fro on a line in front of the right shoulder (sine: `speed` in its middle)."""
    along = np.array(direction) / np.linalg.norm(direction)
    return lambda t: np.array([-0.45, 0.1, 0.3]) + along * half * np.sin(speed / half * t)


def run(blobs: Blobs, n: int, hand: HandTracker) -> list[tuple[int, HandTrack]]:
    """Feed n clouds through both trackers; what came, with the number of its cloud."""
    people, found = PeopleTracker(), []
    for k in range(n):
        cloud = blobs.cloud(k)
        result = hand.process(TrackedCloud(cloud, people.process(cloud)))
        if result is not None:
            found.append((k, result))
    return found


DRAWN = {
    "circle 0.15 m, 0.5 m/s": circle(0.15, 0.5),
    "circle 0.25 m, 1.2 m/s": circle(0.25, 1.2),
    "line up and down": line(0.25, 1.0, (0, 0, 1)),
    "line sideways": line(0.25, 1.0, (0, 1, 0)),
    "line to and fro": line(0.15, 0.8, (1, 0, 0)),
}


@pytest.mark.parametrize("path", DRAWN.values(), ids=DRAWN.keys())
def test_the_hand_is_followed(path):
    """Started after a second; from half a second later to the end within 0.15 m rms of the true hand, and never lost."""
    blobs, hand = Blobs([Person(standing(2.4, 0.0), path)]), HandTracker()
    hand.start(None, SECOND * FRAME_NS)
    found = run(blobs, 5 * SECOND, hand)
    assert all(track.active for _, track in found)
    assert found[-1][0] == 5 * SECOND - 1
    error = np.array([track.position - blobs.hand(k) for k, track in found if k > 1.6 * SECOND])
    assert len(error) > 3 * SECOND
    assert np.sqrt((error**2).sum(axis=1).mean()) < 0.15


@pytest.mark.parametrize(("axis", "direction"), [("height", (0, 0, 1)), ("lateral", (0, 1, 0))])
def test_the_value_follows_the_hand(axis, direction):
    """A stroke of 0.5 m of a range of 0.8 m: values correlate with the true offset, stay in 0..1, and use at least 0.35 of it."""
    blobs = Blobs([Person(standing(2.4, 0.0), line(0.25, 0.8, direction))])
    hand = HandTracker(HandConfig(value=ValueConfig(axis=axis)))
    hand.start(1, SECOND * FRAME_NS)
    found = [(k, t) for k, t in run(blobs, 6 * SECOND, hand) if k > 2 * SECOND]
    value = np.array([t.value for _, t in found])
    truth = np.array([blobs.hand(k) @ np.array(direction) for k, _ in found])
    assert value.min() >= 0
    assert value.max() <= 1
    assert np.corrcoef(value, truth)[0, 1] > 0.85
    assert np.ptp(value) > 0.35


def gesturing() -> Blobs:
    """Somebody whose hand can be followed."""
    return Blobs([Person(standing(2.4, 0.0), circle(0.2, 0.8))])


def test_a_trigger_takes_effect_by_its_stamp():
    """Told early or late, before any cloud at stamp + 0.1 s: the result is the same to the bit."""
    results = []
    for told in (0, 20, 24):
        blobs, hand, people, found = gesturing(), HandTracker(), PeopleTracker(), []
        for k in range(2 * SECOND):
            if k == told:
                hand.gesture("rotate", 1, 20 * FRAME_NS)
            cloud = blobs.cloud(k)
            track = hand.process(TrackedCloud(cloud, people.process(cloud)))
            found.append(b"" if track is None else track.position.tobytes() + track.covariance.tobytes())
        assert not any(found[: 20 + 5])
        assert found[20 + 10]
        results.append(found)
    assert results[0] == results[1] == results[2]


def test_other_gestures_start_nothing():
    """Only the configured one does; with an empty name none."""
    for config, name in ((HandConfig(), "push"), (HandConfig(trigger=""), "rotate"), (HandConfig(trigger=""), "")):
        hand = HandTracker(config)
        hand.gesture(name, 1, SECOND * FRAME_NS)
        assert not run(gesturing(), 2 * SECOND, hand)


@pytest.mark.parametrize("toggle", [False, True])
def test_the_same_gesture_ends_it_if_wished(toggle):
    """The last message says so, once; drawing circles may look like the trigger, so off by default."""
    hand = HandTracker(HandConfig(toggle=toggle))
    hand.gesture("rotate", 1, SECOND * FRAME_NS)
    hand.gesture("rotate", 1, 3 * SECOND * FRAME_NS)
    found = run(gesturing(), 5 * SECOND, hand)
    assert sum(not t.active for _, t in found) == toggle
    assert found[-1][1].active != toggle
    assert hand.active != toggle
    if toggle:
        assert found[-1][0] == 3 * SECOND + 5


def test_stop_ends_it_with_the_next_cloud():
    """A service call: one closing message, then silence, then it can start again."""
    blobs, people, hand, states = gesturing(), PeopleTracker(), HandTracker(), []
    hand.start(1, SECOND * FRAME_NS)
    for k in range(4 * SECOND):
        if k == 2 * SECOND:
            hand.stop()
        if k == 3 * SECOND:
            hand.start(None, 3 * SECOND * FRAME_NS)
        cloud = blobs.cloud(k)
        track = hand.process(TrackedCloud(cloud, people.process(cloud)))
        states.append(None if track is None else track.active)
    assert states[2 * SECOND - 1] is True
    assert states[2 * SECOND] is False
    assert not any(states[2 * SECOND + 1 : 3 * SECOND])
    assert states[-1] is True


def test_a_lost_hand_coasts_and_ends():
    """The person goes (no point at all): it coasts for `lost_after`, says goodbye once, and never leaves the arm's reach."""
    blobs, people, hand = gesturing(), PeopleTracker(), HandTracker(HandConfig(lost_after=0.6))
    hand.start(1, SECOND * FRAME_NS)
    after, seen = [], None
    for k in range(4 * SECOND):
        cloud = blobs.cloud(k) if k < 2 * SECOND else make_cloud(np.empty((0, 3)), k)
        track = hand.process(TrackedCloud(cloud, people.process(cloud)))
        seen = track if track is not None and track.unseen == 0 else seen
        if k >= 2 * SECOND:
            after.append(track)
    told = [t for t in after if t is not None]
    assert [t.active for t in told] == [True] * (len(told) - 1) + [False]
    assert told[-1].unseen == pytest.approx(0.6, abs=0.021)
    assert np.linalg.norm(told[-1].position - seen.position) < 0.5
    assert not hand.active


@pytest.mark.parametrize("side", [1.0, -1.0], ids=["left", "right"])
def test_a_hand_that_was_hidden_is_found_again(side):
    """Either hand, hidden for 0.3 s at up to 1 m/s (by then up to 0.3 m from where it was lost): within 0.15 m again 0.3 s later."""
    path = circle(0.2, 1.0)
    blobs, people, hand = Blobs([Person(standing(2.4, 0.0), lambda t: path(t) * [1, side, 1])]), PeopleTracker(), HandTracker()
    hand.start(None, SECOND * FRAME_NS)
    hidden, errors = (2 * SECOND, 2 * SECOND + 15), []
    for k in range(5 * SECOND):
        cloud = blobs.cloud(k)
        if hidden[0] <= k < hidden[1]:
            cloud = cloud.select(np.linalg.norm(cloud.position - blobs.hand(k), axis=1) > 0.25)
        track = hand.process(TrackedCloud(cloud, people.process(cloud)))
        if k > SECOND + 25 and not hidden[0] <= k < hidden[1] + 15:
            assert track is not None
            assert track.active
            errors.append(track.position - blobs.hand(k))
    assert np.sqrt((np.array(errors) ** 2).sum(axis=1).mean()) < 0.15


def test_nobody_there():
    """Started for somebody who does not exist, or in an empty room: nothing happens, nothing is promised."""
    for who in (None, 77):
        hand = HandTracker()
        hand.start(who, 0)
        assert not run(Blobs([], clutter=0.0), SECOND, hand)
        assert not hand.active


def test_a_body_is_not_a_hand():
    """Somebody stands and sways, arms down: whatever is found ends, or stays outside the body's axis."""
    hand = HandTracker()
    hand.start(None, SECOND * FRAME_NS)
    blobs = Blobs([Person(standing(2.4, 0.0))], clutter=0.0)
    found = run(blobs, 6 * SECOND, hand)
    near = [np.hypot(*(t.position - blobs.truth(k)[0])[:2]) < 0.05 for k, t in found if t.active]
    assert np.mean(near) < 0.2 if near else True


def test_knobs_that_contradict_each_other():
    """An empty value range, a gate beyond the reach."""
    with pytest.raises(ConfigError, match=r"ValueConfig\.low"):
        ValueConfig(low=0.1, high=0.1)
    with pytest.raises(ConfigError, match="gate"):
        SplitConfig(gate=1.0, reach=0.5)


@pytest.mark.parametrize(("late", "followed"), [(1.0, True), (3.0, False)])
def test_a_start_waits_two_seconds_for_somebody(late, followed):
    """Who is asked for when nobody is known yet is followed as soon as somebody is; later nobody expects it any more."""
    blobs, people, hand, found = gesturing(), PeopleTracker(), HandTracker(), []
    hand.start(None, 0)
    first = round(late * SECOND)
    for k in range(first + SECOND):
        cloud = blobs.cloud(k) if k >= first else make_cloud(np.empty((0, 3)), k)
        found.append(hand.process(TrackedCloud(cloud, people.process(cloud))))
    assert not any(found[:first])
    assert any(found) == followed


def test_a_stop_also_ends_the_waiting():
    blobs, people, hand = gesturing(), PeopleTracker(), HandTracker()
    hand.start(None, 0)
    for k in range(2 * SECOND):
        if k == SECOND // 4:
            hand.stop()
        cloud = blobs.cloud(k) if k >= SECOND // 2 else make_cloud(np.empty((0, 3)), k)
        assert hand.process(TrackedCloud(cloud, people.process(cloud))) is None
