"""Which choices are worth their time: the Pareto front of time against accuracy."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from benchmarks.report import Row

FASTER = 0.1  # a choice that saves less than this share of the time is not told apart from another: so much a machine drifts in a run


def front(time: NDArray[np.float64], loss: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Tell which points no other point dominates: is no worse than in both and better than in one. Equal points do not dominate.

    ``time``, ``loss``, shape (n,): both are better when less.
    """
    no_worse = (time[:, None] <= time) & (loss[:, None] <= loss)
    better = (time[:, None] < time) | (loss[:, None] < loss)
    return np.asarray(~(no_worse & better).any(axis=0))


def loss(row: Row) -> float:
    """Accuracy as what is better when less."""
    value = float(row["accuracy"]["value"])
    return -value if row["better"] == "higher" else value


def kept(rows: Sequence[Row]) -> NDArray[np.bool_]:
    """Tell which rows of a panel are on its front, shape (n_rows,)."""
    return front(np.array([row["time_ms"]["median"] for row in rows]), np.array([loss(row) for row in rows]))


def panels(rows: Sequence[Row]) -> Iterator[tuple[str, list[Row]]]:
    """Give the rows of each panel, in the order in which panels begin."""
    for name in dict.fromkeys(row["stage"] for row in rows):
        yield name, [row for row in rows if row["stage"] == name]


def beaten_by(row: Row, rows: Sequence[Row]) -> list[Row]:
    """Name the choices of a row's panel that are clearly better than it: no worse in both, and in one by more than chance.

    An empty list: the row is on the front, or as near to it as can be told.
    """
    found = []
    for other in rows:
        quicker, own = other["time_ms"]["median"], row["time_ms"]["median"]
        gain = loss(row) - loss(other)
        clearly = quicker < (1 - FASTER) * own or gain > max(row["margin"], other["margin"])
        if other is not row and quicker <= own and gain >= 0 and clearly:
            found.append(other)
    return found
