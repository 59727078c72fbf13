"""Messages lost on the way, told from those that were left out on purpose."""

from __future__ import annotations


class Gaps:
    """Sees what is missing in the sequence of one source."""

    def __init__(self) -> None:
        self._last: int | None = None
        self._every = 1

    def lost(self, sequence: int, every: int = 1) -> int:
        """Take in a message; say how many were lost since the one before.

        Nothing that was left out on purpose counts. Where the stride changed from one message to the next, the step between them may be
        either of the two strides, so the larger one is what a step may be. Where it changed with a message that was lost, only the source
        knows what was left out: the count is then what the strides of the two that came allow.

        Parameters
        ----------
        sequence : int
            Of the message. One that is not larger than the one before is a new source, which lost nothing yet.
        every : int
            By how much the sequence grows from one message to the next; 0, of whoever does not say it, means 1.

        Returns
        -------
        int
            At least 0.
        """
        last, stride = self._last, max(self._every, every, 1)
        self._last, self._every = sequence, every
        return 0 if last is None else max((sequence - last) // stride - 1, 0)
