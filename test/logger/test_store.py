"""Sessions: what was acknowledged is there, whatever happened; what is damaged costs a line."""

from __future__ import annotations

import os
import resource
import shutil
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from sessions import INFO, assert_same, contents, make_event, torn_folders

from radar_app.logger.store import JOURNAL, REACH, SessionStore, read_session
from radar_core import ConfigError, DataError, Pose, RadarInfo

EVENTS = [make_event(seed) for seed in range(3)]
OPERATIONS = st.lists(
    st.one_of(
        st.tuples(st.just("add"), st.integers(0, 2)),
        st.tuples(st.sampled_from(["push", "wave", "clap"]), st.integers(0, 5)),
        st.tuples(st.just("undo"), st.just(0)),
        st.tuples(st.sampled_from(["discard", "open"]), st.integers(0, 5)),
    ),
    min_size=3,
    max_size=10,
).map(lambda rest: [("add", 0), ("push", 0), *rest])


class Model:
    """What the store has acknowledged, kept in the simplest way."""

    def __init__(self):
        self.added, self.decisions, self.gone = {}, [], set()

    def apply(self, store, operation):
        """Do one operation on the store; what it says is what it has to do. Gives the store, which may be another one then."""
        what, which = operation
        waiting = [number for number in self.added if number not in dict(self.decisions)]
        if what == "add":
            self.added[store.add(EVENTS[which])] = which
        elif what == "open":
            store.close()
            dropped = {number for number, label in self.decisions if not label}
            self.decisions = [one for one in self.decisions if one[0] not in dropped]
            self.gone |= dropped
            for number in dropped:
                del self.added[number]
            return SessionStore(store.folder)
        elif what == "undo":
            made = store.undo()
            assert (None if made is None else (made.event, made.gesture)) == (self.decisions.pop() if self.decisions else None)
        elif waiting:
            number = waiting[which % len(waiting)]
            store.discard(number) if what == "discard" else store.label(number, what)
            self.decisions.append((number, "" if what == "discard" else what))
        return store

    def holds(self, store):
        """The store says what was acknowledged; events are whole."""
        assert [(one.event, one.gesture) for one in store.decisions if one.event not in self.gone] == self.decisions
        assert list(store.pending) == [number for number in self.added if number not in dict(self.decisions)]
        for number, which in self.added.items():
            assert_same(store.event(number), EVENTS[which])


@pytest.mark.long
@settings(max_examples=25, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(operations=OPERATIONS, cut=st.floats(0.0, 1.0), zeros=st.booleans(), noise=st.binary(max_size=3))
def test_nothing_acknowledged_is_lost(tmp_path, operations, cut, zeros, noise):
    """Random operations, the last of which a crash cuts off at any byte: all before it stands, the session opens, and it goes on."""
    folder = tmp_path / "session"
    shutil.rmtree(folder, ignore_errors=True)
    store, model = SessionStore(folder), Model()
    for operation in operations:
        before, sure = contents(folder), Model()
        sure.added, sure.decisions, sure.gone = dict(model.added), list(model.decisions), set(model.gone)
        store = model.apply(store, operation)
    model.holds(store)
    store._journal.close()  # as a kill would: nothing is tidied up
    torn_folders(before, contents(folder), tmp_path / "torn", cut, zeros)
    again = SessionStore(tmp_path / "torn")
    try:
        after = Model()  # the last operation happened, or it did not
        after.added = {number: which for number, which in model.added.items() if number in again.pending or number in sure.added}
        expected = [(one.event, one.gesture) for one in again.decisions if one.event not in model.gone | sure.gone]
        assert expected in (sure.decisions, model.decisions)
        assert len(again.told) <= 2
        for number in set(sure.added) & set(model.added):
            assert_same(again.event(number), EVENTS[sure.added[number]])
        number = again.add(EVENTS[0])
        assert number not in sure.added
        again.label(number, "push")
        assert again.undo().event == number
        assert not list((tmp_path / "torn").glob("*.part"))
    finally:
        again.close()
    with (tmp_path / "torn" / JOURNAL).open("ab") as journal:  # rubbish behind the last line
        journal.write(noise)
    session = read_session(tmp_path / "torn")
    assert bool(session.told) == bool(noise)
    SessionStore(tmp_path / "torn").close()
    assert read_session(tmp_path / "torn").told == ()


def test_an_event_comes_back_to_the_bit(tmp_path):
    event = make_event(4)
    store = SessionStore(tmp_path, "anna")
    number = store.add(event)
    assert_same(store.event(number), event)
    assert store.event(number).frames == ()
    for mine, theirs in zip(store.event(number, raw=True).frames, event.frames, strict=True):
        np.testing.assert_array_equal(mine.cube, theirs.cube)
        np.testing.assert_array_equal(mine.missing, theirs.missing)
        assert (mine.stamp_ns, mine.sequence, mine.frame_id) == (theirs.stamp_ns, theirs.sequence, theirs.frame_id)
    bare = store.add(make_event(5, frames=0))
    assert store.event(bare, raw=True).frames == ()
    store.label(number, "clap")
    store.close()
    session = read_session(tmp_path)
    assert session.radar == INFO
    assert [(one.event, one.gesture, one.subject) for one in session.labels] == [(number, "clap", "anna")]


def test_decisions_make_sense(tmp_path):
    """One decision for an event, of a name that can be one; who performs stays until somebody else is named."""
    store = SessionStore(tmp_path, "anna")
    number = store.add(EVENTS[0])
    with pytest.raises(ConfigError, match="use small letters"):
        store.label(number, "Thumb up!")
    with pytest.raises(DataError, match="there is no event 17"):
        store.label(17, "push")
    store.label(number, "push")
    with pytest.raises(ConfigError, match=f"event {number} is push already; undo that first"):
        store.discard(number)
    assert store.undo().gesture == "push"
    assert store.undo() is None
    with pytest.raises(DataError, match="another process has this session open"):
        SessionStore(tmp_path)
    with pytest.raises(DataError, match="another than when this session began"):
        store.add(make_event(1, info=RadarInfo(waveform=INFO.waveform, mount=Pose(z=2.0))))
    assert len(list(tmp_path.glob("event_*"))) == 1
    store.close()
    again = SessionStore(tmp_path)
    assert again.subject == "anna"
    assert (again.pending, again.decisions) == ((number,), ())
    again.close()
    store.close()


def test_discarded_events_can_be_brought_back_while_they_are_few(tmp_path):
    store = SessionStore(tmp_path)
    for k in range(REACH + 2):
        assert store.discard(store.add(EVENTS[0])).event == k
    assert len(list(tmp_path.glob("event_*"))) == REACH
    assert [store.undo().event for _ in range(REACH)] == list(range(REACH + 1, 1, -1))
    assert store.undo() is None
    assert len(store.pending) == REACH
    store.discard(store.pending[-1])
    store.close()
    assert len(list(tmp_path.glob("event_*"))) == REACH - 1
    again = SessionStore(tmp_path)
    assert again.add(EVENTS[0]) == REACH + 2  # numbers are never used twice
    again.close()


def test_what_is_damaged_costs_a_line(tmp_path):
    """A byte in the middle of the journal, an event's file that somebody deleted, one that is cut off, and a line of the future."""
    store = SessionStore(tmp_path)
    for name in ("push", "pull", "wave", "rotate"):
        store.label(store.add(EVENTS[0]), name)
    store._journal.append({"did": "sung", "event": 0})
    store.close()
    journal = tmp_path / JOURNAL
    lines = journal.read_bytes().splitlines(keepends=True)
    assert b"push" in lines[2]
    lines[2] = lines[2].replace(b"push", b"pusx")
    journal.write_bytes(b"".join(lines))
    (tmp_path / "event_00002.npz").unlink()
    cut = tmp_path / "event_00003.npz"
    cut.write_bytes(cut.read_bytes()[:-50])
    told = read_session(tmp_path).told
    assert any(f"{JOURNAL}:3: this line is damaged" in line for line in told)
    assert any("nothing is called 'sung'" in line for line in told)
    assert any("the file of event 2 (wave) is missing" in line for line in told)
    again = SessionStore(tmp_path)
    assert sorted(again.told) == sorted(told)
    assert again.pending == (0,)
    assert_same(again.event(1), EVENTS[0])
    with pytest.raises(DataError, match=r"event_00003\.npz: cannot be read"):
        again.event(3)
    again.close()
    store = SessionStore(tmp_path / "new")
    store._journal.append({"did": "opened", "format": 99, "subject": ""})
    store.close()
    with pytest.raises(DataError, match="has format 99, this version reads 1"):
        SessionStore(tmp_path / "new")
    with pytest.raises(DataError, match="holds no session"):
        read_session(tmp_path / "none")
    (tmp_path / "file").write_text("")
    with pytest.raises(DataError, match="this folder cannot be made"):
        SessionStore(tmp_path / "file" / "session")


def test_a_full_disk_costs_a_line(tmp_path):
    """An event and a label that do not fit: one line, nothing of them is left, and it goes on when there is room.

    The limit of the size of files stands for the disk: the write that goes beyond it gets through in part, as on a full disk.
    """
    store = SessionStore(tmp_path, "anna")
    number = store.add(EVENTS[0])
    before = contents(tmp_path)
    old = resource.getrlimit(resource.RLIMIT_FSIZE)
    try:
        resource.setrlimit(resource.RLIMIT_FSIZE, (2000, old[1]))
        with pytest.raises(DataError, match=r"event_00001\.npz: cannot be written \(File too large\); make room"):
            store.add(EVENTS[1])
        assert contents(tmp_path) == before
        resource.setrlimit(resource.RLIMIT_FSIZE, (len(before[JOURNAL]) + 20, old[1]))
        with pytest.raises(DataError, match=r"session\.journal: cannot be written \(File too large\)"):
            store.label(number, "push")
        assert contents(tmp_path) == before
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, old)
    assert store.pending == (number,)
    store.label(number, "push")
    later = store.add(EVENTS[1])
    store.close()
    session = read_session(tmp_path)
    assert [(one.event, one.gesture) for one in session.labels] == [(number, "push")]
    assert session.told == ()
    assert later in session.files


WORKER = """
import sys
sys.path.insert(0, sys.argv[2])
from sessions import make_event
from radar_app.logger.store import SessionStore
store = SessionStore(sys.argv[1], "anna")
event, names = make_event(1), ("push", "pull", "clap")
for k in range(10_000):
    number = store.add(event)
    print("added", number, flush=True)
    if k % 5 == 4:
        store.discard(number)
        print("discarded", number, flush=True)
    else:
        store.label(number, names[k % 3])
        print("labelled", number, names[k % 3], flush=True)
    if k % 7 == 6:
        print("undone", store.undo().event, flush=True)
"""


@pytest.mark.long
def test_kill_9_loses_nothing_acknowledged(tmp_path):
    """A process that adds and labels is killed after a number of lines; what it had printed is there, again and again."""
    acknowledged, added = {}, set()
    for round_, lines in enumerate((7, 33)):
        place = str(Path(__file__).parent)
        process = subprocess.Popen([sys.executable, "-c", WORKER, str(tmp_path), place], stdout=subprocess.PIPE, text=True)
        for _ in range(lines):
            word, number, *label = process.stdout.readline().split()
            if word == "added":
                added.add(int(number))
            else:
                acknowledged[int(number)] = {"labelled": " ".join(label), "discarded": "", "undone": None}[word]
        os.kill(process.pid, signal.SIGKILL)
        rest = process.stdout.read().splitlines()  # what it had said before it died
        assert process.wait() == -signal.SIGKILL
        for line in rest:
            word, number, *label = line.split()
            if word == "added":
                added.add(int(number))
            else:
                acknowledged[int(number)] = {"labelled": " ".join(label), "discarded": "", "undone": None}[word]
        store = SessionStore(tmp_path)
        try:
            stands = {one.event: one.gesture for one in store.decisions}
            lost = {number: label for number, label in acknowledged.items() if stands.get(number) != label}
            # Only what the process had begun and not said may differ: the last event it dealt with.
            assert set(lost) <= {max(added)}, (round_, lost)
            kept = {number for number in added if number in store.pending or acknowledged.get(number)}
            for number in kept:
                assert_same(store.event(number), make_event(1))
            assert store.subject == "anna"
        finally:
            store._journal.close()
    assert len(added) >= 20
