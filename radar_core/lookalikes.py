"""Values that only look like what is meant: a number in quotes, `true` for a number, `1` for true."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Mapping, Sequence
from typing import Any


def lookalikes(given: Any, made: Any, place: tuple[Any, ...] = ()) -> Iterator[tuple[tuple[Any, ...], str]]:
    """Find where a configuration was made of something else than it seems, which a reader of the file would not expect.

    Parameters
    ----------
    given : Any
        Plain data: mappings, sequences and scalars.
    made : Any
        The configuration that was made of it.
    place : tuple
        Where both are within the whole.

    Yields
    ------
    tuple of (tuple, str)
        Place, and what is wrong there.
    """
    if isinstance(given, Mapping):
        if dataclasses.is_dataclass(made) or isinstance(made, Mapping):
            for name, value in given.items():
                inner = made.get(name) if isinstance(made, Mapping) else getattr(made, str(name), None)
                yield from lookalikes(value, inner, (*place, name))
    elif isinstance(made, tuple) and isinstance(given, Sequence) and not isinstance(given, str):
        for number, (value, inner) in enumerate(zip(given, made, strict=False)):
            yield from lookalikes(value, inner, (*place, number))
    elif isinstance(made, bool):
        if isinstance(given, (str, int, float)) and not isinstance(given, bool):  # nothing at all may stand for a default
            yield place, f"is {given!r}; write true or false"
    elif isinstance(made, (int, float)) and isinstance(given, (str, bool)):
        truth = f"is {'true' if given else 'false'}, which is no number"
        yield place, truth if isinstance(given, bool) else f"is {given!r}: leave the quotes out"
