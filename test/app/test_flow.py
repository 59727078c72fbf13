"""Who hears nothing although all before it in the graph go on is found, and nobody else is."""

import time
from itertools import accumulate

import pytest

from radar_app.flow import Flows

GRAPH = ("driver", "baseband", "tracking", "hand", "osc")
STEP = 0.2  # s: between two looks
RATE = 20  # messages in a second


class Graph:
    """Nodes that tell how many messages they have handled; ``deaf`` ones get none, ``away`` ones tell nothing."""

    def __init__(self, labels=GRAPH, rate=RATE):
        self.flows, self.rate, self.now = Flows(labels), rate, time.monotonic()
        self.pids = {label: k for k, label in enumerate(labels)}
        self.handled = dict.fromkeys(labels, 0.0)
        self.refused = dict.fromkeys(labels, 0)

    def restart(self, label):
        self.pids[label] += 100
        self.handled[label] = 0.0

    def live(self, seconds, *, deaf=(), away=()):
        """Let time pass; gives who was found, and after how long."""
        found, began = {}, self.now
        while self.now < began + seconds:
            self.now += STEP
            for label in self.handled.keys() - set(deaf):
                self.handled[label] += self.rate * STEP
            told = {label: (self.pids[label], (int(self.handled[label]), self.refused[label])) for label in self.pids if label not in away}
            for label, why in self.flows.look(told, self.now).items():
                assert "heard nothing" in why
                found.setdefault(label, []).append(self.now - began)
        return found


def test_a_node_that_comes_back_and_hears_nothing_is_found_and_nobody_behind_it():
    graph = Graph()
    assert graph.live(30.0) == {}
    graph.restart("baseband")
    assert graph.live(1.5, away=("baseband",), deaf=("baseband", "tracking", "hand", "osc")) == {}
    found = graph.live(11.0, deaf=("baseband", "tracking", "hand", "osc"))
    assert list(found) == ["baseband"]
    assert found["baseband"] == [pytest.approx(10.2, abs=0.5)]
    graph.restart("baseband")
    assert graph.live(30.0) == {}


def test_new_starts_that_do_not_help_are_not_repeated_for_ever():
    """Three, and again when it has worked meanwhile."""
    graph = Graph()
    graph.live(20.0)
    assert len(graph.live(120.0, deaf=("tracking", "hand"))["tracking"]) == 3
    graph.live(20.0)
    assert len(graph.live(120.0, deaf=("tracking", "hand"))["tracking"]) == 3


@pytest.mark.parametrize("silent", ["driver", "baseband"])
def test_who_is_fed_nothing_is_not_at_fault(silent):
    """A driver that was told to be silent, or one that is being started again; and who waits for who is found."""
    graph = Graph()
    graph.live(20.0)
    quiet = GRAPH[GRAPH.index(silent) :]
    assert graph.live(60.0, deaf=quiet, away=(silent,)) == {}
    if silent == "driver":
        assert graph.live(60.0, deaf=quiet) == {}
    assert graph.live(20.0) == {}


def test_who_never_worked_or_refuses_what_comes_is_left_alone():
    graph = Graph()
    assert graph.live(60.0, deaf=("osc",)) == {}
    for _ in range(30):
        graph.refused["hand"] += 1
        assert graph.live(1.0, deaf=("hand", "osc")) == {}


def test_who_gets_messages_seldom_has_more_time():
    """One in forty clouds, at 20 clouds a second: 2 s between two are no silence, nor are 15."""
    graph = Graph()
    for _ in range(10):
        graph.live(1.8, deaf=("hand", "osc"))
        graph.handled["hand"] += 1
        graph.live(STEP, deaf=("hand", "osc"))
    assert graph.live(15.0, deaf=("hand", "osc")) == {}
    assert list(graph.live(60.0, deaf=("hand", "osc"))) == ["hand"]


def test_two_radars_are_told_apart():
    """Each is fed in its own namespace; who fuses them is fed by all."""
    labels = ("left/driver", "left/baseband", "right/driver", "right/baseband", "fusion", "tracking")
    graph = Graph(labels)
    graph.live(20.0)
    assert graph.live(30.0, deaf=("right/driver", "right/baseband")) == {}  # one that was told to be silent
    graph.live(20.0)
    found = graph.live(11.0, deaf=("right/baseband",))
    assert list(found) == ["right/baseband"]


def test_long_work_is_no_silence():
    """Who compiles for half a minute gives no signs of life meanwhile, and has its full time when it goes on."""
    graph = Graph()
    graph.live(20.0)
    behind = ("baseband", "tracking", "hand", "osc")
    assert graph.live(30.0, deaf=behind, away=("baseband",)) == {}
    assert graph.live(9.0, deaf=behind) == {}
    assert list(graph.live(3.0, deaf=behind)) == ["baseband"]


def test_time_in_which_nobody_was_heard_does_not_count():
    """A machine that was suspended for an hour."""
    graph = Graph()
    graph.live(20.0)
    graph.now += 3600.0
    graph.flows.rest(3600.0)
    assert graph.live(9.0, deaf=("baseband", "tracking", "hand", "osc")) == {}
    assert list(graph.live(3.0, deaf=("baseband", "tracking", "hand", "osc"))) == ["baseband"]


def test_counts_without_bounds_over_half_a_day_of_looks():
    """200,000 looks at counts of weeks, and at one that goes back or jumps: nothing is found, and nothing grows."""
    graph = Graph(("driver", "baseband"))
    steps = accumulate([2**62, -(2**61), 5, 1] * 50_000)
    for k, count in enumerate(steps):
        told = {"driver": (1, (abs(count), 0)), "baseband": (2, (k * 2**40, k))}
        assert graph.flows.look(told, graph.now + 0.2 * k) == {}
    assert len(graph.flows._flows) == 2
