"""Colours of people: nobody has that of another who is there at the same time, as long as there are enough."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from types import MappingProxyType
from typing import Final

PEOPLE: Final = ("#E69F00", "#56B4E9", "#009E73", "#CC79A7", "#F0E442", "#D55E00", "#0072B2")
"""Colours of people, of Okabe and Ito (2008)."""

NOBODY: Final = "#7d8794"

_GONE: Final = 50  # people who left and whose colours are still known: their gestures and points are on the page for a while


def colour(numbers: Mapping[int, int], person: int) -> str:
    """Colour of a person by the numbers of `Colours`; grey: nobody knows them."""
    return PEOPLE[numbers[person]] if person in numbers else NOBODY


class Colours:
    """Gives each person the colour that nobody has had for longest; they keep it while they are there.

    Attributes
    ----------
    numbers : mapping of int to int
        Place in `PEOPLE` of each person's colour, by their track; not changed in place.
    """

    def __init__(self) -> None:
        self.numbers: Mapping[int, int] = MappingProxyType({})
        self._here: set[int] = set()
        self._free = list(range(len(PEOPLE)))  # unused for longest first

    def see(self, people: Iterable[int]) -> None:
        """Take in who is there now, by their tracks; who comes back finds their colour if nobody has taken it."""
        here, worn = set(people), set[int]()
        for person in sorted(here, key=lambda person: (person not in self._here, person)):
            if person not in self.numbers or (person not in self._here and self.numbers[person] in worn):
                self._add(person, here)
            number = self.numbers[person]
            worn.add(number)
            self._free.remove(number)
            self._free.append(number)
        self._here = here

    def _add(self, person: int, here: set[int]) -> None:
        gone = [other for other in self.numbers if other not in here][-_GONE:]
        kept = {other: self.numbers[other] for other in (*gone, *here) if other in self.numbers}
        self.numbers = MappingProxyType({**kept, person: self._free[0]})
