"""From what a graph, or a recording, gives to events in a session: cuts them out, keeps them, and takes the operator's decisions."""

from __future__ import annotations

import threading
from collections import Counter
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import ExitStack
from dataclasses import dataclass, field, replace
from typing import Final

import numpy as np

from radar_app.logger.event import LoggedEvent
from radar_app.logger.store import SessionStore
from radar_app.view.feed import Feed, History
from radar_app.view.records import EventMaps
from radar_core import GESTURES, HandwaveError, vocabulary
from radar_core.config import config, knob

_LOOK: Final = 0.1  # s between looks at the feed
_SILENT: Final = 1.0  # s without a cloud, beyond what is waited for anyway: the source has ended
_FEW: Final = 5  # messages that are shown


@config
class LoggerConfig:
    """What is kept of an event, and how many may wait for a decision."""

    before: float = knob(2.0, unit="s", low=0.5, high=3.0, doc="kept of what comes before an event, so that tracks settle")
    after: float = knob(0.8, unit="s", low=0.5, high=2.0, doc="kept of what comes after it")
    waiting: int = knob(50, low=1, high=10_000, doc="events that may wait for a label; further ones are not kept, and that is told")


@dataclass(frozen=True)
class LoggerState:
    """What an operator has to know, at one moment.

    Attributes
    ----------
    version : int
        Counts changes.
    waiting : tuple of int
        Numbers of the events that wait for a decision, the oldest first.
    current : LoggedEvent or None
        The first of them, without raw frames; None: none waits, or it cannot be read.
    labels : tuple of str
        Names to choose from: the ten, then those of one's own.
    counts : mapping of str to int
        Labelled events by gesture.
    lost : int
        Events that were not kept.
    said : tuple of str
        The last messages, the newest last.
    wrong : bool
        Whether the newest of them tells of something that was not done.
    """

    version: int = 0
    waiting: tuple[int, ...] = ()
    current: LoggedEvent | None = None
    labels: tuple[str, ...] = GESTURES
    counts: Counter[str] = field(default_factory=Counter)
    lost: int = 0
    said: tuple[str, ...] = ()
    wrong: bool = False


class Logger:
    """Keeps every detected gesture of a feed in a session, and what the operator says of it.

    Events are cut out and written by a thread of its own, decisions are written by another, so that nothing waits for anything else.

    Parameters
    ----------
    feed : Feed
        Where events, clouds and raw frames come from. Raw frames are kept where it has some.
    store : SessionStore
        The session; `close` closes it.
    config : LoggerConfig or None
        Knobs; None: the defaults.
    """

    def __init__(self, feed: Feed, store: SessionStore, config: LoggerConfig | None = None) -> None:
        self.store = store
        self._feed, self._config = feed, config or LoggerConfig()
        self._lock = threading.RLock()  # two threads change the state
        self._state = LoggerState()
        self._own: tuple[str, ...] = ()  # names of one's own that the graph's model knows
        self._waiting: list[EventMaps] = []  # events whose last clouds have not come yet
        self._history = History()
        self._seen = 0
        self._end = threading.Event()
        self._stack = ExitStack()
        self._stack.enter_context(feed.want("frames"))
        self._decider = ThreadPoolExecutor(1, "logger-decisions")
        for line in store.told:
            self._say(line, wrong=True)
        self._show()
        self._thread = threading.Thread(target=self._work, name="logger", daemon=True)
        self._thread.start()

    @property
    def state(self) -> LoggerState:
        """What an operator has to know now."""
        return self._state

    def label(self, number: int, gesture: str) -> Future[None]:
        """Say what an event was; `state` tells when that is on the disk, or why it is not."""
        return self._decider.submit(self._do, lambda: f"saved: event {self.store.label(number, gesture).event} is {gesture}")

    def discard(self, number: int) -> Future[None]:
        """Say that an event is of no use; `state` tells when that is on the disk."""
        return self._decider.submit(self._do, lambda: f"discarded: event {self.store.discard(number).event}")

    def undo(self) -> Future[None]:
        """Take back the last decision; `state` tells when that is on the disk."""
        return self._decider.submit(self._do, self._undo)

    def _undo(self) -> str:
        made = self.store.undo()
        if made is None:
            return "there is nothing to take back"
        return f"taken back: event {made.event} was {made.gesture or 'discarded'}; it waits again"

    def _do(self, act: Callable[[], str]) -> None:
        try:
            said = act()
        except HandwaveError as error:
            self._say(str(error), wrong=True)
        else:
            self._say(said)
        self._show()

    def _say(self, line: str, *, wrong: bool = False, lost: int = 0) -> None:
        with self._lock:
            state = self._state
            self._state = replace(state, version=state.version + 1, said=(*state.said, line)[-_FEW:], wrong=wrong, lost=state.lost + lost)

    def _show(self) -> None:
        """Bring the state up to date with the store."""
        with self._lock:
            waiting, decisions = self.store.pending, self.store.decisions
            counts = Counter(one.gesture for one in decisions if one.gesture)
            current = self._state.current
            if waiting[:1] != self._state.waiting[:1]:
                current = self._read(waiting[0]) if waiting else None
            self._state = replace(
                self._state,
                version=self._state.version + 1,
                waiting=waiting,
                current=current,
                labels=vocabulary((*counts, *self._own)),
                counts=counts,
            )

    def _read(self, number: int) -> LoggedEvent | None:
        try:
            return self.store.event(number)
        except HandwaveError as error:
            self._say(str(error), wrong=True)
            return None

    def _work(self) -> None:
        while not self._end.wait(_LOOK):
            self._look()
        self._look(last=True)

    def _look(self, *, last: bool = False) -> None:
        """Take in what is new, and keep the events that are complete; ``last``: nothing more will come."""
        new = self._feed.after("maps", self._seen)
        if new:
            self._seen = new[-1].number
            self._waiting += [entry.value for entry in new]
        if not self._waiting:
            return
        history = self._feed.history()
        again = history.end_ns < self._history.end_ns  # time went back: what waits belongs to what was there before
        past, self._history = self._history, history
        over = last or history.silent > self._config.after + _SILENT
        fresh = {id(entry.value) for entry in new} if again else set()
        todo, self._waiting = self._waiting, []
        for event in todo:
            if again and id(event) not in fresh:
                self._keep(event, past)
            elif over or history.end_ns >= event.end_ns + round(self._config.after * 1e9):
                self._keep(event, history)
            else:
                self._waiting.append(event)
        if not self._waiting:
            self._history = History()  # a minute of clouds need not be kept twice

    def _keep(self, event: EventMaps, history: History) -> None:
        """Write one event."""
        try:
            cut = cut_event(event, history, self._config)
            waiting = len(self.store.pending)
            if isinstance(cut, str):
                said = cut
            elif waiting >= self._config.waiting:
                said = f"{waiting} events wait for a label; label or discard some"
            else:
                self.store.add(cut)
                self._own = next((one.value.labels for one in reversed(history.gestures)), self._own)
                self._show()
                return
        except (ValueError, OSError, MemoryError) as error:  # whatever an event is like: the next one is kept
            said = str(error)
        self._say(f"an event was not kept: {said}", wrong=True, lost=1)

    def close(self) -> None:
        """Keep what has come, end all threads, and close the session."""
        self._end.set()
        self._thread.join()
        self._decider.shutdown()
        self._stack.close()
        self.store.close()


def cut_event(event: EventMaps, history: History, config: LoggerConfig) -> LoggedEvent | str:
    """Put together what a history holds of one event; a text says why that cannot be done."""
    first, last = event.start_ns - round(config.before * 1e9), event.end_ns + round(config.after * 1e9)
    clouds = [entry.value for entry in history.clouds if first <= entry.value.stamp_ns <= last]
    if not clouds:
        return "its clouds did not come, or time went back"
    if len(history.radars) != 1:
        names = ", ".join(sorted(history.radars)) or "none"
        return f"the radar must be one, these are {names}; log one of them with --namespace, or, where they are fused, a graph of one"
    (info,) = history.radars.values()
    half = info.waveform.acquisition_ns // 2  # a cloud's stamp is in the middle of its frame's acquisition
    frames = [entry.value for entry in history.frames if first <= entry.value.stamp_ns + half <= last]
    own = [one.value for one in history.gestures if (one.value.stamp_ns, one.value.track_id) == (event.stamp_ns, event.track_id)]
    places = {one.value.stamp_ns: one.value.find(event.track_id) for one in history.tracks}
    found = [places.get(cloud.stamp_ns) for cloud in clouds]
    position = [np.full(3, np.nan) if track is None else track.position for track in found]
    return LoggedEvent(
        info=info,
        track_id=event.track_id,
        start_ns=event.start_ns,
        end_ns=event.end_ns,
        decided_ns=event.stamp_ns,
        guess=own[-1].name if own else "",
        confidence=own[-1].confidence if own else float("nan"),
        maps=event.maps,
        clouds=clouds,
        position=np.array(position, np.float64),
        frames=[frame for frame in frames if frame.cube.shape == info.cube_shape],
    )
