"""The whole chain on a simulated scene, against what the scene's script says."""

from __future__ import annotations

import numpy as np
import pytest

from radar_core import GESTURES
from radar_gestures.pipeline import Pipeline, PipelineConfig
from radar_gestures.scoring import RecognisedGesture, nearest_person, score_gestures, truth_segments
from radar_sim import Simulator, load_scene


@pytest.fixture(scope="module")
def played():
    """The short scene, once: frames, truths and results."""
    simulator = Simulator(load_scene("short"))
    pipeline = Pipeline(simulator.info)
    simulated = [simulator.process(i) for i in range(simulator.n_frames)]
    return simulator.info, simulated, [pipeline.process(s.frame) for s in simulated]


def test_the_scripted_gestures_are_recognised(played):
    _, simulated, results = played
    found = [
        RecognisedGesture(nearest_person(s.truth, r.tracks.find(g.track_id).position), g.label, g.start_ns, g.end_ns)
        for s, r in zip(simulated, results, strict=True)
        for g in r.gestures
    ]
    segments = truth_segments(s.truth for s in simulated)
    assert [GESTURES[s.label] for s in segments] == ["push", "swipe_right"]
    score = score_gestures(segments, found)
    assert (score.hits, score.false_alarms) == (2, 0)


def test_results_carry_the_stamps_of_their_frame(played):
    info, simulated, results = played
    for s, r in zip(simulated, results, strict=True):
        assert r.cloud.stamp_ns == r.tracks.stamp_ns == s.truth.stamp_ns
        assert r.cloud.frame_id == info.frame_id
        for gesture in r.gestures:
            assert gesture.stamp_ns == r.cloud.stamp_ns
            assert gesture.start_ns < gesture.end_ns < gesture.stamp_ns


def test_ready_clouds_give_the_same_results(played):
    """A source that sends clouds joins after the baseband; what follows is identical."""
    info, _, results = played
    pipeline = Pipeline(info)
    for expected in results:
        got = pipeline.process_cloud(expected.cloud)
        assert [t.id for t in got.tracks.tracks] == [t.id for t in expected.tracks.tracks]
        assert [(g.label, g.start_ns) for g in got.gestures] == [(g.label, g.start_ns) for g in expected.gestures]
        for a, b in zip(got.gestures, expected.gestures, strict=True):
            np.testing.assert_array_equal(a.features, b.features)


def test_a_trigger_gesture_starts_the_hand(played):
    """With "push" as the trigger the hand track begins `trigger_delay` after the push was decided, and belongs to who pushed."""
    info, simulated, results = played
    from radar_tracking import HandConfig

    pipeline = Pipeline(info, PipelineConfig(hand=HandConfig(trigger="push", trigger_delay=0.1)))
    push = next(g for r in results for g in r.gestures if g.name == "push")
    hands = [(s.truth.stamp_ns, r.hand) for s in simulated for r in [pipeline.process(s.frame)]]
    first = next((stamp, hand) for stamp, hand in hands if hand is not None)
    assert first[0] >= push.stamp_ns + 100_000_000
    assert first[1].parent_id == push.track_id
    assert pipeline.hand.config.trigger == "push"
