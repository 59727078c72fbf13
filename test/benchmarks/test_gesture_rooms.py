"""Gestures in random rooms: the physical limit against the radar equation, what becomes of gestures, and figures that add up."""

import dataclasses
import math

import numpy as np
import pytest

from benchmarks.gesture_rooms import Scored, Stroke, _sits, bands, by_rooms, fate, summary
from benchmarks.hand_limit import HAND, LEVEL, detectable_level, hand_snr
from radar_core import GESTURES
from radar_dsp import BasebandConfig
from radar_dsp.windows import make_window
from radar_lab.evaluation.scoring import RecognisedGesture, TruthSegment
from radar_sim import Action, Effects, NoiseConfig, Person, Scene, Simulator
from radar_sim.effects.noise import power
from radar_sim.effects.physics import amplitudes
from radar_sim.propagation.base import IMPEDANCE

STROKE = Stroke("push", "right", 20.0, 2.0, 0.1, 0.2, 3.0, 2, 1.2, "design", False, "right")


def scene(distance=2.0, noise=15.0):
    """One person who pushes once."""
    person = Person(position=(distance, 0.0), script=(Action(gesture="push"),))
    return Scene(duration=3.0, people=(person,), effects=Effects(noise=NoiseConfig(noise_figure=noise)))


def levels_of(simulator, frames=range(20, 120, 10)):
    """Truths of frames, and the level of the hand in each."""
    truths = [simulator.process(number).truth for number in frames]
    return truths, np.array([hand_snr(simulator, truth.sequence, 0, truth.hand_position[0]) for truth in truths])


def test_the_level_is_that_of_the_radar_equation():
    """Facets within a cell add up between no phase at all and all in phase; windows cost what their sums say."""
    simulator = Simulator(scene())
    w, config = simulator.info.waveform, BasebandConfig().spectrum
    gain = (make_window(config.speed_window, w.n_chirp).sum() * make_window(config.range_window, w.n_sample).sum()) ** 2
    truths, levels = levels_of(simulator)
    for truth, level in zip(truths, levels, strict=True):
        echoes = simulator.echoes(truth.sequence)
        place = simulator.info.mount.from_room(truth.hand_position[0])
        volts = amplitudes(echoes.select(np.flatnonzero(((echoes.out.position - place) ** 2).sum(-1) < HAND**2)))
        most = 10 * math.log10(volts.sum() ** 2 * gain / (power(simulator.scene.effects.noise, simulator.info) * IMPEDANCE))
        assert most - 25 < level < most + 0.1


def test_noise_and_distance_move_the_level_by_what_physics_says():
    """A receiver of 6 dB more noise sees the hand 6 dB lower; twice as far away about 12 dB lower."""
    near, noisy, far = (np.median(levels_of(Simulator(own))[1]) for own in (scene(), scene(noise=21.0), scene(4.0)))
    assert near - noisy == pytest.approx(6.0, abs=1e-6)
    assert 7.0 < near - far < 17.0


def test_another_person_is_not_the_hand():
    """Who stands beside the hand adds nothing to it."""
    alone, beside = scene(), scene()
    beside = dataclasses.replace(beside, people=(*beside.people, Person(id=2, position=(2.0, 0.3))))
    one, two = (levels_of(Simulator(own))[1] for own in (alone, beside))
    np.testing.assert_allclose(one, two, atol=1e-9)


def test_a_hidden_hand_has_no_level():
    """Who is behind somebody is below every level."""
    own = scene()
    assert hand_snr(Simulator(own), 10, 0, np.array([2.0, 1.5, 1.0])) == -math.inf


def test_a_stroke_is_detectable_by_the_share_of_its_frames():
    """A near hand is, by far; with 45 dB more noise it is not."""
    for noise, seen in ((15.0, True), (60.0, False)):
        simulator = Simulator(scene(noise=noise))
        truths, levels = levels_of(simulator, range(30, 94, 4))
        reached = detectable_level(simulator, 0, truths)
        assert np.mean(levels >= reached - 1e-9) >= 0.3
        assert (reached >= LEVEL) == seen


def test_what_becomes_of_a_gesture():
    """An event of the right name, of another, one called random, none, or nobody followed."""
    push, pull, random = (GESTURES.index(name) for name in ("push", "pull", "random"))
    segment = TruthSegment(1, push, 0, 10)
    event = {label: RecognisedGesture(1, label, 0, 10) for label in (push, pull, random)}
    assert fate(segment, event[push], True) == fate(segment, event[push], False) == "right"
    assert fate(segment, event[pull], True) == "other name"
    assert fate(segment, event[random], True) == "called random"
    assert fate(segment, None, True) == "no event"
    assert fate(segment, event[random], False) == fate(segment, None, False) == "no track"


def test_who_sits():
    """Between sitting down and rising."""
    script = (Action(gesture="push"), Action(sit=0.5), Action(gesture="pull"), Action(rise=0.5), Action(gesture="wave"))
    person = Person(script=script)
    assert [_sits(person, index) for index in range(4)] == [False, True, False, False]


def test_figures_add_up():
    """Shares of strokes of all rooms, those that count for each figure, and false gestures per minute."""
    weak = dataclasses.replace(STROKE, level=5.0, fate="no event")
    near = dataclasses.replace(STROKE, distance=1.0, fate="other name")
    turned = dataclasses.replace(STROKE, turn=math.radians(40), radar="xwr18xx")
    found = summary([Scored((STROKE, weak), 1, 1.0), Scored((near, turned), 0, 1.0)])
    assert (found["strokes"], found["detectable"]) == (4, 0.75)
    assert found["right_of_all"] == 0.5
    assert found["right_of_detectable"] == pytest.approx(2 / 3)
    assert (found["right_near"], found["right_near_strokes"]) == (0.0, 1)
    assert (found["right_turned_30_45"], found["right_ti"]) == (1.0, 1.0)
    assert found["false_per_minute"] == 0.5
    assert found["false_per_minute_interval"][0] < 0.5 < found["false_per_minute_interval"][1]
    assert found["by"]["physics"]["too weak"]["no event"] == 1
    for values in found["by"].values():
        assert sum(own["strokes"] for own in values.values()) == 4


def test_bands_hold_every_stroke():
    """Also at and beyond the edges."""
    for distance, band in ((0.5, "0.8 to 1.2 m"), (1.2, "1.2 to 1.7 m"), (6.5, "4.5 to 6 m")):
        assert bands(dataclasses.replace(STROKE, distance=distance))["distance"] == band


def test_an_interval_is_by_rooms():
    """Equal rooms have no spread; without a stroke there is no interval."""
    assert by_rooms([[True, False]] * 5) == [0.5, 0.5]
    low, high = by_rooms([[True] * 4, [False] * 4, [True] * 4, [False] * 4])
    assert low < 0.5 < high
    assert by_rooms([[], []]) is None
