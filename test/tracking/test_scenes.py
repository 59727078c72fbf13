"""From simulated raw frames through the baseband to people and a hand, against the simulator's truth."""

import numpy as np
import pytest
from scoring import Score

from radar_dsp import Baseband, BasebandConfig
from radar_sim import Simulator, load_scene
from radar_tracking import HandTracker, PeopleTracker, TrackedCloud

BRIEF = 100  # clouds: the people of the demo first walk in from the edge of the unambiguous range

pytestmark = pytest.mark.long


@pytest.fixture(scope="module")
def demo():
    """The demo: every cloud in the room, its tracks, the truth."""
    simulator, tracker = Simulator(load_scene("demo")), PeopleTracker()
    baseband = Baseband(BasebandConfig(), simulator.info)
    run = []
    for k in range(simulator.n_frames):
        made = simulator.process(k)
        cloud = baseband.process(made.frame).to_room(simulator.info.mount)
        run.append((cloud, tracker.process(cloud), made.truth))
    return run


def test_the_people_of_the_demo_keep_their_identities(demo):
    """Two people walk in and gesture for half a minute: followed for 97 % of the time, one identity each, within a body's radius."""
    score = Score()
    for _, tracks, truth in demo[BRIEF:]:
        score.add(truth.position, tracks)
    assert score.tracked >= 0.97
    assert score.switches == 0
    assert score.false_clouds <= 0.03 * score.clouds
    assert score.rms < 0.25


def test_points_of_the_hand_belong_to_the_right_person(demo):
    """What gesture recognition lives on: 95 % of the points around a gesturing hand carry the id of its owner."""
    score, right, total = Score(), 0, 0
    for cloud, tracks, truth in demo:
        score.add(truth.position, tracks)
        for person in np.flatnonzero((truth.gesture != 255) & ~truth.walking):
            near = np.linalg.norm(cloud.position - truth.hand_position[person], axis=1) < 0.2
            right += np.count_nonzero(tracks.point_track_id[near] == score.last.get(person, -2))
            total += np.count_nonzero(near)
    assert total > 500
    assert right / total > 0.95


def test_the_drawing_hand_of_the_demo(demo):
    """Started when the truth says so: within 0.15 m rms of the true hand while it draws circles, and active for 90 % of that."""
    tracker, parent, score, errors, drawing = HandTracker(), None, Score(), [], 0
    for cloud, tracks, truth in demo:
        score.add(truth.position, tracks)
        person = np.flatnonzero(truth.drawing)
        if parent is None and len(person):
            parent = score.last[int(person[0])]
            tracker.start(parent, cloud.stamp_ns)
        hand = tracker.process(TrackedCloud(cloud, tracks))
        if len(person):
            drawing += 1
            if hand is not None and hand.active:
                errors.append(np.sum((hand.position - truth.hand_position[person[0]]) ** 2))
    assert len(errors) >= 0.9 * drawing
    assert np.sqrt(np.mean(errors)) < 0.15
