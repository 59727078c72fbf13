"""Streams of real people for the networks on streams: who is held out, how slots are labelled, and how figures are counted, by hand."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.stream_model import counted, events
from benchmarks.stream_real import DAILY, DEVELOP, FIGURE, RealStream, Track, learned, people_of, streams_of
from radar_core import GESTURES, DataError
from radar_gestures.stream.network import StreamNet
from radar_gestures.stream.slots import NAMES, SLOT_NS

PUSH, PULL = GESTURES.index("push"), GESTURES.index("pull")
FAST = NAMES.index("points at 1.7")


def track(fast=(), n=200):
    """Slots from 0 on; those named have a fast point."""
    features = np.zeros((n, len(NAMES)), np.float32)
    features[list(fast), FAST] = 1.0
    return Track(np.arange(n), features)


def stream(labels, spans, tracks, hours=0.5):
    return RealStream("mhomeges", 800, False, tuple(labels), tuple((a * SLOT_NS, b * SLOT_NS) for a, b in spans), hours, tuple(tracks))


def test_a_segment_is_labelled_from_its_first_fast_slot_to_its_last():
    """Slots 40 to 79 are the push, fast from 50 to 60; slots 100 to 139 hold nothing that is seen, and count nothing."""
    one = stream(("push", "pull"), ((40, 79), (100, 139)), [track([*range(50, 61), 90])])
    (sequence,) = one.sequences()
    assert np.flatnonzero(sequence.label).tolist() == list(range(50, 61))
    assert set(sequence.label[50:61].tolist()) == {PUSH}
    assert (sequence.weight[[48, 49, 50, 51, 59, 60, 61, 62]] == np.float32(0.3)).all()
    assert (sequence.weight[[10, 47, 55, 63, 90]] == 1.0).all()
    assert not sequence.weight[101:139].any()
    assert sequence.stroke[[39 - 5, 45, 75, 120, 150]].tolist() == [-1, 0, 0, 1, -1]


def test_short_tracks_teach_nothing():
    assert not list(stream((), (), [track(n=9)]).sequences())
    assert len(list(stream((), (), [track(n=10)]).sequences())) == 1


class Sure:
    """Says what a table says of each slot, as late as networks do."""

    delay, reject, labels = 3, 0.6, GESTURES
    score = StreamNet.score

    def __init__(self, said):
        self._said = said  # (first, end, label, probability)

    def probabilities(self, features):
        told = np.zeros((len(features), len(GESTURES)))
        told[:, 0] = 1.0
        for first, end, label, sure in self._said:
            rows = slice(first + self.delay, end + self.delay)
            told[rows] = 0.0
            told[rows, label], told[rows, 0] = sure, 1.0 - sure
        return told


def test_events_are_named_where_they_are_and_those_below_the_limit_left_out():
    one = stream((), (), [track()])
    model = Sure([(20, 30, PUSH, 0.9), (60, 70, PULL, 0.55)])
    assert list(events(model, one)) == [(20 * SLOT_NS, 30 * SLOT_NS, "push")]


def test_figures_of_segments_counted_by_hand():
    """A push named rightly, one named pull, one missed; a clap called push, a clap called nothing; and one event in a rest."""
    spans = ((20, 40), (50, 70), (80, 100), (110, 130), (140, 160))
    one = stream(("push", "push", "push", "random", "random"), spans, [track()])
    model = Sure([(25, 35, PUSH, 0.9), (55, 65, PULL, 0.9), (115, 125, PUSH, 0.9), (175, 185, PULL, 0.9)])
    found = counted(model, [one])
    assert found["known"] == 3
    assert found["right"] == found["other_name"] == pytest.approx(1 / 3)
    assert found["unknown"] == 2
    assert found["unknown_named"] == 0.5
    assert found["false_per_hour"] == 2 / 0.5  # the clap's and the one in the rest
    assert found["hours"] == 0.5


def test_an_event_that_ends_long_after_its_segment_is_not_of_it():
    late = Sure([(35, 52, PUSH, 0.9)])
    found = counted(late, [stream(("push",), ((20, 40),), [track()])])
    assert found["right"] == 0.0
    assert found["false_per_hour"] == 2.0


def test_nobody_is_learned_from_and_in_the_figure():
    for kind in ("mhomeges", "mtranssee", DAILY):
        try:
            people = set(people_of(kind))
        except DataError as error:
            pytest.skip(str(error))
        assert set(FIGURE[kind]) <= people
        assert set(learned(kind)) == people - set(FIGURE[kind])
        assert set(DEVELOP.get(kind, ())) <= set(learned(kind))


def test_a_real_persons_streams_have_their_segments_in_order():
    """Two segments at each distance, once with the tilt taken as 0, once with it found."""
    try:
        made = streams_of("mhomeges", [FIGURE["mhomeges"][0]], None, segments=2, both=True)
    except DataError as error:
        pytest.skip(str(error))
    assert [one.levelled for one in made] == [False, True] * (len(made) // 2)
    for one in made:
        assert len(one.labels) == len(one.spans) == 2
        assert one.spans[0][0] < one.spans[0][1] < one.spans[1][0] < one.spans[1][1]
        assert set(one.labels) <= set(GESTURES)
    assert any(len(track.number) for one in made for track in one.tracks)
