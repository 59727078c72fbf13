"""False gestures in daily life: what is counted, who is judged by whom, and small parts of the recordings where they are."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from benchmarks import gestures_daily as daily
from benchmarks.gestures_end_to_end import NOTHING, Found, Stream, streams
from benchmarks.recordings import folder
from radar_core import DataError
from radar_gestures.activation import ActivationConfig
from radar_gestures.events import Event
from radar_gestures.maps import FeatureMaps
from radar_gestures.stage import TrackEvent
from radar_lab.training.networks import CurveTraining

NAMES = (NOTHING, "clap", "push")
S = 1_000_000_000
MAPS = FeatureMaps(np.zeros(1, np.int64), np.zeros(1, np.float32), *(np.zeros((1, 1), np.float32) for _ in range(4)))


def probabilities(*told: tuple[int, float]) -> NDArray[np.float64]:
    """Probabilities of events, each with a name and how sure it is; the rest is shared."""
    found = np.array([[(1.0 - sure) / 2] * 3 for _, sure in told]).reshape(-1, 3)
    for row, (name, sure) in zip(found, told, strict=True):
        row[name] = sure
    return found


def event(start: float, rested: float = 0.0, track_id: int = 1) -> TrackEvent:
    """Half a second of motion."""
    return TrackEvent(track_id, Event(round(start * S), round((start + 0.5) * S), round(rested * S)), 0.0, ())


def life(*told: tuple[TrackEvent, int, float]) -> daily.Judged:
    """Half an hour of one person whose events have these names."""
    nobody = daily.Known(*(np.zeros(0, np.int64) for _ in range(2)), *(np.zeros(0) for _ in range(2)), np.zeros(0, np.int64))
    own = daily.Life(7, 0.5, tuple(one for one, _, _ in told))
    return daily.Judged(NAMES, nobody, ((own, probabilities(*((name, sure) for _, name, sure in told))),), 0)


def test_the_event_that_overlaps_a_segment_most_is_its_gesture() -> None:
    """Events in gaps are nobody's; a segment without an event is left out."""
    found = [Found(MAPS, 0, 0.3, 1.0), Found(MAPS, 0, 0.5, 0.2), Found(MAPS, -1, 0.0, 0.1), Found(MAPS, 2, 0.4, 1.5)]
    one, two = Stream(1, 2.0, ("push", "clap", "clap"), tuple(found), 0.1), Stream(2, 2.0, ("clap",), (Found(MAPS, 0, 0.1, 2.0),), 0.1)
    told = probabilities((2, 0.9), (1, 0.8), (2, 0.9), (0, 0.7), (1, 0.6))
    known = daily.known([one, two], told, NAMES)
    assert known.label.tolist() == [2, 1, 1]
    assert known.name.tolist() == [1, 0, 1]
    assert known.score == pytest.approx([0.8, 0.0, 0.6])
    assert known.rested.tolist() == [0.2, 1.5, 2.0]
    assert known.stream.tolist() == [0, 0, 1]


def test_gestures_are_kept_by_how_they_count() -> None:
    """Always: by their score; after a rest: 0 without one; after one that wakes: the lower score of both, 0 where that has a wrong name."""
    label, name = np.array([1, 2, 1, 2]), np.array([1, 2, 2, 1])
    known = daily.Known(label, name, np.array([0.7, 0.9, 0.8, 0.6]), np.array([1.2, 0.4, 1.0, 2.0]), np.array([0, 0, 1, 1]))
    assert daily.scores(known, ActivationConfig(), NAMES).tolist() == [0.7, 0.9, 0.8, 0.6]
    assert daily.scores(known, ActivationConfig(mode="dwell"), NAMES).tolist() == [0.7, 0.0, 0.8, 0.6]
    assert daily.scores(known, ActivationConfig(mode="wake", wake="clap"), NAMES).tolist() == [0.7, 0.7, 0.0, 0.0]
    assert daily.scores(known, ActivationConfig(mode="wake", wake="push"), NAMES).tolist() == [0.7, 0.9, 0.0, 0.0]


def test_false_gestures_are_those_that_count() -> None:
    """Two of four above the limit; after a rest one; those that woke are counted by themselves, and what came while awake."""
    judged = life(
        (event(1.0, 0.5), 1, 0.9), (event(3.0, 1.5), 2, 0.8), (event(5.0, 1.5), 2, 0.4), (event(6.0, 0.5), 0, 0.9),
        (event(30.0, 0.5), 2, 0.95),
    )  # fmt: skip
    assert daily.false_gestures(judged, ActivationConfig(), 0.5) == ([3], 0)
    assert daily.false_gestures(judged, ActivationConfig(mode="dwell"), 0.5) == ([1], 0)
    assert daily.false_gestures(judged, ActivationConfig(mode="wake", wake="clap"), 0.5) == ([1], 1)
    assert daily.false_gestures(judged, ActivationConfig(mode="wake", wake="clap"), 0.3) == ([2], 1)
    assert daily.false_gestures(judged, ActivationConfig(mode="wake", wake="push"), 0.5) == ([0], 2)


def test_a_limit_keeps_what_was_asked_for_or_says_that_it_cannot() -> None:
    """A tenth may be lost; where a fifth is called nothing no limit does."""
    n = 100
    label, name = np.ones(n, np.int64), np.ones(n, np.int64)
    score = np.linspace(0.5, 0.99, n)
    known = daily.Known(label, name, score, np.full(n, 2.0), np.zeros(n, np.int64))
    judged = daily.Judged(NAMES, known, life((event(1.0), 1, 0.52), (event(3.0), 2, 0.95)).lives, n)
    found = daily.at(judged, ActivationConfig(), 0.9)
    assert found is not None
    assert (found["kept"], found["right"], found["false"], found["false_per_hour"]) == (0.9, 0.9, [1], 2.0)
    assert found["false_per_hour_interval"][0] < 2.0 < found["false_per_hour_interval"][1]
    lost = daily.Known(label, name, np.where(np.arange(n) < 20, 0.0, score), known.rested, known.stream)
    assert daily.at(daily.Judged(NAMES, lost, judged.lives, n), ActivationConfig(), 0.9) is None


def test_who_wakes_by_what_is_chosen_by_the_others() -> None:
    """The first two would choose clap by themselves; the other two, and the two of them, say otherwise."""

    def told(right: float, *false: int) -> dict[str, Any]:
        return {"false": list(false), "right": right, "right_interval": [right - 0.1, right + 0.1]}

    found = daily.chosen({"clap": told(0.9, 0, 0, 5), "push": told(0.8, 3, 3, 1), "up": told(0.7, 3, 3, 1)}, 2.0)
    assert found is not None
    assert found["names"] == ["push", "push", "clap"]
    assert found["false_per_hour"] == (3 + 3 + 5) / 2.0
    assert found["right"] == pytest.approx((0.8 + 0.8 + 0.9) / 3)
    assert daily.chosen({}, 2.0) is None


@pytest.fixture(scope="module")
def recorded() -> tuple[list[Stream], list[daily.Life]]:
    """Sixty segments and forty seconds of daily life of each of three people of mHomeGes."""
    people = (804, 805, 806)
    try:
        folder()
    except DataError as error:
        pytest.skip(str(error))
    return streams("mhomeges", 60, None, people), daily.lives(400, None, people)


def test_daily_life_gives_events(recorded: tuple[list[Stream], list[daily.Life]]) -> None:
    """Their times are those of the recording, and nobody rested before the first cloud."""
    _, found = recorded
    assert [one.person for one in found] == [804, 805, 806]
    assert sum(len(one.events) for one in found) > 0
    for one in found:
        assert one.hours == pytest.approx(399 * 0.1 / 3600, rel=0.2)
        starts = [event.event.start_ns for event in one.events]
        assert starts == sorted(starts)
        assert all(0 <= event.event.rested_ns <= 45 * S for event in one.events)


def test_nobody_is_judged_by_a_network_that_knows_them(
    recorded: tuple[list[Stream], list[daily.Life]], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Neither by their gestures nor by their daily life: the network of each turn learns from the others only, and names the two."""
    made, found = recorded
    of_all = [sum(len(one.events) for one in (*made, *found) if one.person == who) for who in (804, 805, 806)]
    taught: list[int] = []

    class Witness:
        def __init__(self, n_labels: int) -> None:
            self.n_labels = n_labels

        def probabilities(self, vectors: NDArray[np.floating]) -> NDArray[np.float64]:
            taught.append(len(vectors))
            return np.full((len(vectors), self.n_labels), 1.0 / self.n_labels)

    def train(changed: NDArray[np.float32], label: NDArray[np.int64], *, labels: tuple[str, ...], **_: Any) -> Witness:
        taught.append(len(label))
        return Witness(len(labels))

    monkeypatch.setattr(daily, "train_net", train)
    judged = daily.judge(made, found, CurveTraining(passes=1), 1, lambda _, work: work())
    assert taught == [of_all[2], of_all[0] + of_all[1], of_all[0] + of_all[1], of_all[2]]
    assert judged.names[0] == NOTHING
    assert sum(len(told) for _, told in judged.lives) == sum(len(one.events) for one in found)
    assert judged.segments == sum(len(one.labels) for one in made)
