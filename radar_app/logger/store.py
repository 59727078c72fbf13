"""A session of labelled gestures in a folder: what was acknowledged is on the disk, whatever happens to the process or the machine.

The folder holds ``session.journal``, a journal of all decisions, and ``event_00000.npz`` and so on, one detected event each. An event
without a decision waits for one. Nothing is ever changed in place.
"""

from __future__ import annotations

import re
import threading
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from datetime import datetime, timezone
from pathlib import Path
from typing import Any, Final

from radar_app.logger.event import LoggedEvent, read_event, write_event
from radar_app.logger.journal import Journal, read_journal
from radar_core import ConfigError, DataError, RadarInfo, check_label
from radar_core.config import load, plain

JOURNAL: Final = "session.journal"
"""Name of the journal in a session's folder."""
FORMAT: Final = 1
"""Of the journal; one of another format is refused."""
REACH: Final = 10
"""Discarded events that `SessionStore.undo` can bring back; the files of older ones are deleted."""
_EVENT: Final = re.compile(r"event_(\d{5,})\.npz")
_OPENED, _RADAR, _LABELLED, _DISCARDED, _UNDONE = "opened", "radar", "labelled", "discarded", "undone"


@dataclass(frozen=True)
class Decision:
    """What somebody said of an event.

    Attributes
    ----------
    event : int
        Its number.
    gesture : str
        The label; empty: it was discarded.
    subject : str
        Who performed it, a name or a number of the operator's own; empty: it was not said.
    """

    event: int
    gesture: str
    subject: str = ""


@dataclass
class _History:
    """What the entries of a journal come to."""

    folder: Path
    subject: str = ""
    radar: RadarInfo | None = None
    decisions: dict[int, Decision] = field(default_factory=dict)  # in force, in the order in which they were made
    last: int = -1  # largest number of an event that was spoken of
    wrong: list[str] = field(default_factory=list)

    def take(self, entry: Mapping[str, Any]) -> None:
        """Take in one entry; one that makes no sense is told of and left out."""
        try:
            self._take(entry)
        except DataError:
            raise
        except (KeyError, TypeError, ValueError) as error:
            self.wrong.append(f"{self.folder / JOURNAL}: the entry {dict(entry)} makes no sense ({error!r}) and is left out")

    def _take(self, entry: Mapping[str, Any]) -> None:
        did = entry["did"]
        if did == _OPENED:
            if entry["format"] != FORMAT:
                raise DataError(f"{self.folder}: this session has format {entry['format']}, this version reads {FORMAT}")
            self.subject = str(entry["subject"])
            return
        if did == _RADAR:
            self.radar = load(RadarInfo, entry["radar"], JOURNAL)
            return
        number = int(entry["event"])
        self.last = max(self.last, number)
        if did == _LABELLED:
            self.decisions[number] = Decision(number, check_label(entry["gesture"]), str(entry["subject"]))
        elif did == _DISCARDED:
            self.decisions[number] = Decision(number, "", str(entry["subject"]))
        elif did == _UNDONE:
            del self.decisions[number]
        else:
            raise ValueError(f"nothing is called {did!r}")


def event_files(folder: Path) -> dict[int, Path]:
    """Files of a session's events by their numbers, in order."""
    found = {int(match[1]): path for path in folder.iterdir() if (match := _EVENT.fullmatch(path.name))}
    return dict(sorted(found.items()))


def is_session(folder: Path) -> bool:
    """Whether a folder holds a session."""
    return (folder / JOURNAL).is_file()


@dataclass(frozen=True)
class Session:
    """What a session's folder (``folder``) says: labels that stand, files of their events, and what is damaged, a line each (``told``)."""

    folder: Path
    radar: RadarInfo | None  # None: there is no event yet
    labels: tuple[Decision, ...]
    files: Mapping[int, Path]
    told: tuple[str, ...]


def read_session(folder: Path) -> Session:
    """Look at a session without changing it, open or not. Raises `DataError` when there is none or it cannot be read."""
    if not is_session(folder):
        raise DataError(f"{folder}: holds no session ({JOURNAL} is missing); record one with: handwave view --log {folder}")
    entries, _, told = read_journal(folder / JOURNAL)
    history, files = _replayed(entries, folder), event_files(folder)
    labels = tuple(decision for decision in history.decisions.values() if decision.gesture)
    gone = [f"{folder}: the file of event {one.event} ({one.gesture}) is missing" for one in labels if one.event not in files]
    return Session(folder, history.radar, tuple(one for one in labels if one.event in files), files, (*told, *history.wrong, *gone))


def _replayed(entries: Sequence[Mapping[str, Any]], folder: Path) -> _History:
    history = _History(folder)
    for entry in entries:
        history.take(entry)
    return history


class SessionStore:
    """Keeps the events of a session and what was said of them.

    When a method returns, what it did is on the disk: the power may fail. When it raises, nothing has changed. All of them may be called
    from any thread.

    Parameters
    ----------
    folder : str or Path
        The session; it is made, or goes on. One process has it at a time.
    subject : str
        Who performs the gestures from now on: a name or a number of the operator's own; empty: as before.

    Attributes
    ----------
    told : list of str
        What a crash or a damage had left, a line each.

    Raises
    ------
    DataError
        When the folder cannot be written, or another process has it open.
    """

    def __init__(self, folder: str | Path, subject: str = "") -> None:
        self.folder = Path(folder)
        try:
            self.folder.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise DataError(f"{folder}: this folder cannot be made ({error.strerror}); name another one") from None
        self._lock = threading.Lock()
        self._journal = Journal(self.folder / JOURNAL)
        try:
            self._begin(subject)
        except (DataError, OSError):
            self._journal.close()
            raise

    def _begin(self, subject: str) -> None:
        for part in self.folder.glob("*.part"):  # the process that wrote it is gone: the journal is ours
            part.unlink(missing_ok=True)
        self._history = _replayed(self._journal.entries, self.folder)
        self._files = event_files(self.folder)
        self._next = max(self._history.last, *self._files, -1) + 1
        self.told = [*self._journal.told, *self._history.wrong]
        gone = [one for one in self._history.decisions.values() if one.gesture and one.event not in self._files]
        self.told += [f"{self.folder}: the file of event {one.event} ({one.gesture}) is missing" for one in gone]
        self._append({"did": _OPENED, "format": FORMAT, "subject": subject or self._history.subject, "at": _now()})

    def _append(self, entry: dict[str, Any]) -> None:
        self._journal.append(entry)
        self._history.take(entry)

    @property
    def subject(self) -> str:
        """Who performs the gestures; empty: it was not said."""
        return self._history.subject

    @property
    def pending(self) -> tuple[int, ...]:
        """Numbers of the events that wait for a decision, the oldest first."""
        with self._lock:
            return tuple(number for number in self._files if number not in self._history.decisions)

    @property
    def decisions(self) -> tuple[Decision, ...]:
        """All decisions that stand, in the order in which they were made."""
        with self._lock:
            return tuple(self._history.decisions.values())

    def add(self, event: LoggedEvent) -> int:
        """Keep an event, which waits for a decision then; returns its number.

        Raises `DataError` when it cannot be written, or is of another radar than the session's other events: a data set is of one.
        """
        with self._lock:
            if self._history.radar is None:
                self._append({"did": _RADAR, "radar": plain(event.info)})
            elif self._history.radar != event.info:
                raise DataError(f"{self.folder}: the radar or its mount is another than when this session began; log into another folder")
            number, self._next = self._next, self._next + 1
        path = self.folder / f"event_{number:05d}.npz"
        write_event(path, number, event)
        with self._lock:
            self._files = dict(sorted({**self._files, number: path}.items()))
        return number

    def event(self, number: int, *, raw: bool = False) -> LoggedEvent:
        """Read an event, its raw frames only with ``raw``. Raises `DataError` when it cannot be read, or there is none."""
        return read_event(self._file(number), raw=raw)

    def _file(self, number: int) -> Path:
        if number not in self._files:
            raise DataError(f"{self.folder}: there is no event {number}")
        return self._files[number]

    def label(self, number: int, gesture: str) -> Decision:
        """Say what an event was: one of the ten gestures or one of one's own.

        Raises
        ------
        ConfigError
            When that cannot be the name of a gesture, or the event has a decision already.
        DataError
            When there is no such event, or the label cannot be written.
        """
        return self._decide(Decision(number, check_label(gesture), self.subject))

    def discard(self, number: int) -> Decision:
        """Say that an event is of no use; raises as `label` does."""
        decision = self._decide(Decision(number, "", self.subject))
        self._forget(REACH)
        return decision

    def _decide(self, decision: Decision) -> Decision:
        with self._lock:
            self._file(decision.event)
            if (made := self._history.decisions.get(decision.event)) is not None:
                raise ConfigError(f"event {decision.event} is {made.gesture or 'discarded'} already; undo that first")
            entry = {"did": _LABELLED if decision.gesture else _DISCARDED, "event": decision.event, "subject": decision.subject}
            self._append(entry | ({"gesture": decision.gesture} if decision.gesture else {}) | {"at": _now()})
        return decision

    def undo(self) -> Decision | None:
        """Take back the last decision that stands, so that its event waits again; returns it, None: there is none.

        Raises `DataError` when that cannot be written.
        """
        with self._lock:
            within_reach = [one for one in self._history.decisions.values() if one.event in self._files]
            if not within_reach:
                return None
            self._append({"did": _UNDONE, "event": within_reach[-1].event, "at": _now()})
            return within_reach[-1]

    def _forget(self, reach: int) -> None:
        """Delete the files of discarded events but the last few."""
        with self._lock:
            discarded = [one.event for one in self._history.decisions.values() if not one.gesture and one.event in self._files]
            for number in discarded[: max(len(discarded) - reach, 0)]:
                with suppress(OSError):  # it is tried again
                    self._files[number].unlink(missing_ok=True)
                    del self._files[number]

    def close(self) -> None:
        """Delete the files of discarded events and let other processes have the session; may be called twice."""
        self._forget(0)
        self._journal.close()


def _now() -> str:
    return datetime.now(timezone.utc).isoformat(timespec="seconds")
