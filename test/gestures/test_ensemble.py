"""Events and streams together: who has to agree, who counts first, and what a person who gestures once gives: one gesture."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from test_recognizer import person, sign_model, tracked
from test_stream import push_net

from radar_core import GESTURES, ConfigError
from radar_gestures.activation import ActivationConfig
from radar_gestures.classifiers.ensemble import Ensemble
from radar_gestures.classifiers.model import AUTO, load_model
from radar_gestures.ensemble import EnsembleRecognizer
from radar_gestures.make import make_recognizer
from radar_gestures.stage import GestureConfig
from radar_tracking import TrackStatus

STEP = 20_000_000  # ns
BOTH = Ensemble(sign_model(), push_net())


def silent_net():
    """A network that takes everything for nothing."""
    net = push_net()
    (member,) = net.members
    last, offset = member.last
    (found,) = (dataclasses.replace(member, last=(np.zeros_like(last), offset)),)
    return dataclasses.replace(net, members=(found,))


def wide_net():
    """The network, with two gestures more that it never names."""
    net = push_net()
    (member,) = net.members
    last, offset = member.last
    more = np.pad(last, ((0, 0), (0, 2))), np.pad(offset, (0, 2), constant_values=-9.0)
    return dataclasses.replace(net, members=(dataclasses.replace(member, last=more),), labels=(*GESTURES, "clap", "knock"))


def run(model, speeds, config=None, seconds=3.0, who=lambda now: person(1)):
    """One person whose arm moves at ``speeds``: from, to [s], range rate [m/s]; gives what is recognised."""
    recognizer, found = make_recognizer(config or GestureConfig(), model, None), []
    assert isinstance(recognizer, EnsembleRecognizer)
    for k in range(round(seconds * 1e9 / STEP)):
        now = k * STEP * 1e-9
        speed = sum(value for begin, end, value in speeds if begin <= now < end)
        found += recognizer.process(tracked(k * STEP, [who(now)], [speed], k))
    return found


def tentative(now, age=0.0):
    """Somebody who is nobody yet; ``age``: since the first cloud, at the first cloud [s]."""
    return dataclasses.replace(person(1, status=TrackStatus.TENTATIVE), age=now + age)


def test_what_both_name_is_one_gesture():
    (gesture,) = run(BOTH, [(1.0, 1.6, -1.0)])
    assert (gesture.name, gesture.known) == ("push", True)
    assert gesture.start_ns == pytest.approx(1.0e9, abs=0.1e9)
    assert gesture.end_ns == pytest.approx(1.6e9, abs=0.1e9)


def test_what_the_network_takes_for_nothing_is_random():
    """The features alone say push, and pull."""
    for model, speed in ((Ensemble(sign_model(), silent_net()), -1.0), (BOTH, 1.0)):
        (gesture,) = run(model, [(1.0, 1.6, speed)])
        assert (gesture.name, gesture.known) == ("random", False)
        assert gesture.confidence == gesture.probabilities[0]
        assert gesture.probabilities.argmax() == GESTURES.index("push" if speed < 0 else "pull")
        assert not run(model, [(1.0, 1.6, speed)], GestureConfig(publish_random=False))


def test_what_is_too_slow_for_an_event_the_network_names_alone():
    (gesture,) = run(BOTH, [(1.0, 1.6, -0.75)])
    assert gesture.name == "push"


def test_a_wrong_name_by_features_is_random_and_the_network_s_counts():
    """Features call every approach a pull here."""
    right = sign_model()
    hidden, output = right.weights
    swapped = [GESTURES.index({"push": "pull", "pull": "push"}.get(name, name)) for name in GESTURES]
    wrong = dataclasses.replace(right, weights=(hidden, output[:, swapped]))
    found = run(Ensemble(wrong, push_net()), [(1.0, 1.6, -1.0)])
    assert sorted(gesture.name for gesture in found) == ["push", "random"]


@pytest.mark.parametrize(("temperature", "name"), [(4.0, "push"), (40.0, "random")])
def test_what_features_are_not_sure_of_counts_if_both_together_are(temperature, name):
    """They give 0.58 and 0.12 to push, and would refuse both; the network is sure."""
    unsure = dataclasses.replace(sign_model(), temperature=temperature, reject=0.9)
    found = run(Ensemble(unsure, dataclasses.replace(push_net(), reject=1.0)), [(1.0, 1.6, -1.0)])
    assert [gesture.name for gesture in found] == [name]
    assert found[0].confidence == found[0].probabilities[found[0].label]


def test_who_walks_off_after_a_push_has_pushed():
    """Features alone take whatever somebody does who is elsewhere afterwards for walking, and the network is sure here."""
    away = lambda now: person(1, (2.0 + 0.8 * float(now > 1.65), 0.0, 1.0))  # noqa: E731
    assert [gesture.name for gesture in run(BOTH, [(1.0, 1.6, -1.0)], who=away)] == ["push"]
    doubtful = Ensemble(dataclasses.replace(sign_model(), temperature=4.0), dataclasses.replace(push_net(), reject=1.0))
    assert [gesture.name for gesture in run(doubtful, [(1.0, 1.6, -1.0)], who=away)] == ["random"]


def test_who_gestures_is_somebody():
    """A track that is nobody yet has gestures once it is half a second old, but what is random is nobody's."""
    assert [gesture.name for gesture in run(BOTH, [(1.0, 1.6, -1.0)], who=tentative)] == ["push"]
    assert run(BOTH, [(1.0, 1.6, 1.0)], who=tentative) == []
    assert run(BOTH, [(1.0, 1.6, -1.0)], who=lambda now: tentative(now, age=-2.0)) == []


def test_two_motions_are_two_gestures():
    found = run(BOTH, [(1.0, 1.5, -1.0), (2.2, 2.7, -1.0)], seconds=4.0)
    assert [gesture.name for gesture in found] == ["push", "push"]
    assert found[0].end_ns <= found[1].start_ns


@pytest.mark.parametrize(("wake", "names"), [("push", ["push", "push"]), ("pull", ["random", "random"])])
def test_what_wakes_counts_whoever_named_it(wake, names):
    config = GestureConfig(activation=ActivationConfig(mode="wake", wake=wake))
    found = run(BOTH, [(1.0, 1.6, -1.0), (2.5, 3.1, -0.75)], config, seconds=4.0)
    assert [gesture.name for gesture in found] == names


def test_tracks_that_end_are_forgotten():
    recognizer = make_recognizer(GestureConfig(), BOTH, None)
    for k in range(100):
        recognizer.process(tracked(k * STEP, [person(1)], [-1.0 if 20 <= k < 50 else 0.0], k))
    assert recognizer.track_ids == (1,)
    assert not recognizer.process(tracked(200 * STEP, [], [], 200))
    assert recognizer.track_ids == ()


def test_models_that_do_not_belong_together_are_refused():
    with pytest.raises(ConfigError, match="not models of"):
        Ensemble(push_net(), push_net())
    with pytest.raises(ConfigError, match="not models of"):
        Ensemble(sign_model(), sign_model())
    with pytest.raises(ConfigError, match="only one of these knows clap"):
        Ensemble(sign_model(labels=(*GESTURES, "clap")), push_net())
    with pytest.raises(ConfigError, match="in another order"):
        Ensemble(sign_model(labels=(*GESTURES, "clap", "knock")), dataclasses.replace(wide_net(), labels=(*GESTURES, "knock", "clap")))
    with pytest.raises(ConfigError, match="no file"):
        BOTH.arrays()


def test_ours_are_one_by_name():
    model = load_model(AUTO)
    assert isinstance(model, Ensemble)
    assert model.labels == GESTURES
    events, both = load_model("gestures"), model.probabilities(np.ones(len(model.names)))
    np.testing.assert_array_equal(both, events.probabilities(np.ones(len(model.names))))
