"""How far a ratio would move with other people, rooms or scenes: the bootstrap over those that were measured."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

_LEVEL: Final = (0.025, 0.975)


def ratio_interval(
    part: Sequence[float] | NDArray[np.number], whole: Sequence[float] | NDArray[np.number], *, draws: int = 2000, seed: int = 1
) -> tuple[float, float] | None:
    """Give the 95 % interval of ``sum(part) / sum(whole)`` by drawing as many units anew (percentile bootstrap, Efron 1979).

    What belongs to one unit (a person, a room, a scene, a recording) is alike, so that it is drawn together. Where the part is 0, or all,
    in every unit, the draws say nothing: the interval has no width then, and the caller needs an exact one.

    Parameters
    ----------
    part, whole : sequence of float, shape (n_units,)
        What is counted of each unit, and of how much.
    draws, seed : int
        How often units are drawn, and of the draws.

    Returns
    -------
    tuple of float or None
        Low and high end; None when there is nothing in any draw.

    Raises
    ------
    ValueError
        When the two differ in length.
    """
    pairs = zip(part, whole, strict=True)
    table = np.array([(float(a), float(b)) for a, b in pairs], np.float64).reshape(-1, 2)
    if not len(table):
        return None
    drawn = table[np.random.default_rng(seed).integers(0, len(table), (draws, len(table)))].sum(axis=1)
    drawn = drawn[drawn[:, 1] > 0]
    if not len(drawn):
        return None
    low, high = np.quantile(drawn[:, 0] / drawn[:, 1], _LEVEL)
    return float(low), float(high)
