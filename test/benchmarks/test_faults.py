"""The table of faults, and what is made of what was seen; the faults themselves are the benchmark's, whose quick run is checked."""

import re

import pytest

from benchmarks import faults, faults_boards, faults_files, faults_machine, faults_network, faults_nodes, faults_peers
from benchmarks.faults_rows import Fault, Seen, refused, told
from radar_core import ConfigError


def table():
    """All rows of all groups."""
    return (
        *faults_files.FAULTS,
        *faults_boards.faults(),
        *faults_peers.FAULTS,
        *faults_nodes.NODES,
        *faults_nodes.TRANSPORT,
        *faults_machine.faults(),
        *faults_network.drivers(),
        *faults_network.machines(),
    )


def test_the_table():
    """At least sixty faults with names of their own, means, and words that are regular expressions."""
    rows = table()
    assert len(rows) >= 60
    assert len({row.name for row in rows}) == len(rows)
    assert all(row.means and re.compile(row.words) and row.most <= 8 for row in rows)


def fault(words="broken"):
    return Fault("a fault", "by hand", words, lambda: Seen(True))


def test_figures_of_rows():
    """What died, what nobody named or somebody named too often, and what was lost, each counted."""
    seen = (Seen(True, ["x is broken"], 0, 2.0), Seen(False, ["x"], 3, 9.0, "died"), Seen(True, 5 * ["broken"], 0, 4.0))
    found = faults.figures([told("files", fault(), one) for one in seen])
    assert (found["faults"], found["survived_fraction"], found["unnamed"], found["lost_acknowledged"]) == (3, 2 / 3, 2, 3)
    assert (found["recover_s_median"], found["recover_s_worst"]) == (3.0, 4.0)
    assert found["not_survived"] == ["a fault: died"]


def test_who_refuses_and_who_does_not():
    """An error of ours is a refusal; another one, or none, is not."""

    def say(error):
        raise error

    assert refused(lambda: say(ConfigError("no\nnever"))) == Seen(True, ["no", "never"])
    assert not refused(lambda: say(KeyError("x"))).survived
    assert not refused(lambda: None).survived


def test_the_same_words_stand_apart():
    """A node says the same only every five seconds."""
    rows = tuple(fault(words) for words in "aaaabbc")
    words = "".join(one.words for one in faults.spread(rows))
    assert sorted(words) == sorted("aaaabbc")
    assert "aaa" not in words


@pytest.mark.long
@pytest.mark.skipif(not faults_network.permitted(), reason="no network namespaces or virtual cables here")
@pytest.mark.parametrize("row", faults_network.drivers(), ids=lambda row: row.name)
def test_the_interface_to_a_board_goes_away(row):
    """The driver says which, once, and measures again when it is back; the machine's own interfaces are none of its."""
    seen = row.inject()
    assert seen.survived, seen.note
    assert told("driver", row, seen)["named"] == 1


def test_a_group_that_there_is_not():
    """The message names those that there are."""
    with pytest.raises(ConfigError, match="no group weather; choose of files, driver, peers"):
        faults.run(quick=True, parts="weather")
