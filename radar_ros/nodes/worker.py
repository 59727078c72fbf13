"""Work that takes longer than a callback may: a thread that takes what is newest."""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Callable
from typing import Any


class Worker:
    """Does one thing after the other in a thread of its own; what waits is given up for what is newer.

    Parameters
    ----------
    work : callable
        Is called with each item, in the thread. What it raises goes to ``failed``, and the next item is taken.
    failed : callable
        Is called with the exception, in the thread.
    waiting : int
        Items that may wait; 1: the newest wins.
    """

    def __init__(self, work: Callable[[Any], None], failed: Callable[[BaseException], None], waiting: int = 1) -> None:
        self._work, self._failed = work, failed
        self._items: deque[Any] = deque()
        self._most = waiting
        self._change = threading.Condition()
        self._ended = False
        self._thread = threading.Thread(target=self._run, name="worker", daemon=True)
        self._thread.start()

    def put(self, item: Any) -> int:
        """Give something to do; returns how many older items were given up for it."""
        with self._change:
            self._items.append(item)
            lost = max(len(self._items) - self._most, 0)
            for _ in range(lost):
                self._items.popleft()
            self._change.notify()
        return lost

    def close(self) -> None:
        """Finish what is being done, forget the rest, end the thread; may be called twice."""
        with self._change:
            self._ended = True
            self._change.notify()
        self._thread.join()

    def _run(self) -> None:
        while True:
            with self._change:
                self._change.wait_for(lambda: self._items or self._ended)
                if self._ended:
                    return
                item = self._items.popleft()
            try:
                self._work(item)
            except Exception as error:  # a thread that dies is a node that goes deaf in silence
                self._failed(error)
