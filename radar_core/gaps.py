"""Messages lost on the way, told from those that were left out on purpose.

Of messages of which one in so many is taken, that is the first one that comes of every so many in a row (a slot): one that is lost, or
that comes while the reader is held up, is then made good by the next one.
"""

from __future__ import annotations


class Gaps:
    """Sees what is missing in the sequence of one source."""

    def __init__(self) -> None:
        self._last: int | None = None
        self._every = 1

    def due(self, sequence: int, every: int) -> bool:
        """Say whether a message is to be taken when one in so many is: no other of its slot was, or it is of a new source.

        ``every`` is the length of a slot, at least 1.
        """
        last = self._last
        return last is None or sequence <= last or sequence // every > last // every

    def lost(self, sequence: int, every: int = 1) -> int:
        """Take in a message; say how many slots since the one before gave none.

        Nothing that was left out on purpose counts. Where the length of slots changed from one message to the next, those of the longer
        kind count. Where it changed with a message that was lost, only the source knows what was left out: the count is then what the slots
        of the two that came allow.

        A sequence that is not larger than the one before is of a new source, which lost nothing yet. ``every`` is the length of a slot; 0,
        of whoever does not say it, means 1.
        """
        last, slot = self._last, max(self._every, every, 1)
        self._last, self._every = sequence, every
        return 0 if last is None else max(sequence // slot - last // slot - 1, 0)
