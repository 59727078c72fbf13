"""Figures that pages quote, held against stored results.

A quoted number is followed by a mark that readers do not see: ``0.69<!--= rooms: mota -->``. The mark names a study of `studies` and
where the figure stands in its result: keys, numbers in lists, or a row of ``choices`` by its name or by ``STAGE: NAME``, with `` / ``
between them. Letters may stand between the number and its mark; with ``%`` there the result is a share. ``* 1e-3`` at the end multiplies
the result.
"""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from dataclasses import dataclass
from decimal import Decimal
from pathlib import Path
from typing import Any, Final

from benchmarks.studies import folder

MARK: Final = "<!--="
_QUOTE: Final = re.compile(
    r"(?<![\w.,])(?P<number>-?\d[\d,]*(?:\.\d+)?(?:e-?\d+)?)(?P<unit>[^\d<>|\n]{0,20})<!--= (?P<study>\w+): (?P<place>[^<>]+?)"
    r"(?: \* (?P<factor>[\d.e-]+))? -->"
)


@dataclass(frozen=True)
class Quote:
    """A number in a page, and whose it is said to be."""

    number: str  # as it is written
    study: str
    place: str  # of the figure in the study's result
    factor: float  # what the result is multiplied by before it is compared


def quotes(text: str) -> Iterator[Quote]:
    """Yield the marked numbers of a page. Raises ValueError when a mark has no number before it or cannot be read."""
    found = list(_QUOTE.finditer(text))
    if len(found) != text.count(MARK):
        read = {quote.end() for quote in found}
        bad = next(m for m in re.finditer(re.escape(MARK) + r"[^>]*>?", text) if m.end() not in read)
        raise ValueError(f"{text[max(0, bad.start() - 20) : bad.end()]!r}: no number with a mark; write 0.5<!--= STUDY: KEY / KEY -->")
    for one in found:
        factor = float(one["factor"] or 1) * (100 if "%" in one["unit"] else 1)
        yield Quote(one["number"].replace(",", ""), one["study"], one["place"], factor)


def _step(value: Any, key: str) -> Any:
    """Go one key further: into a mapping, to a number in a list, or to the one row of a list with that choice, or stage and choice."""
    if isinstance(value, dict):
        return value[key]
    if not isinstance(value, list):
        raise KeyError(key)
    if re.fullmatch(r"-?\d+", key):
        return value[int(key)]
    rows = [row for row in value if key in (row["choice"], f"{row['stage']}: {row['choice']}")]
    if len(rows) != 1:
        raise KeyError(f"{key} ({len(rows)} rows)")
    return rows[0]


def look_up(result: Any, place: str) -> float:
    """Find a figure in a result. Raises KeyError, which names what is not there, when it is none."""
    value = result
    for key in place.split(" / "):
        try:
            value = _step(value, key)
        except (IndexError, KeyError, TypeError) as error:
            raise KeyError(f"{place}: {error}") from None
    if not isinstance(value, int | float):
        raise KeyError(f"{place}: is not a number")
    return float(value)


def agrees(number: str, value: float) -> bool:
    """Tell whether a number is a value, rounded to the digits that the number has."""
    exponent = Decimal(number).as_tuple().exponent
    if not isinstance(exponent, int):
        return False
    return abs(float(number) - value) <= 0.5 * 10.0**exponent * (1 + 1e-6) + 1e-12 * abs(value)


def wrong(page: str, results: Path | None = None) -> list[str]:
    """Say which marked numbers of a page differ from the stored results; ``results``: their folder, None: ours."""
    results = results or folder()
    said, read = [], {}
    for quote in quotes(page):
        path = results / f"{quote.study}.json"
        if not path.exists():
            said.append(f"{quote.number}: {quote.study} has no stored result")
            continue
        if quote.study not in read:
            read[quote.study] = json.loads(path.read_text(encoding="utf-8"))
        try:
            value = look_up(read[quote.study], quote.place) * quote.factor
        except KeyError as error:
            said.append(f"{quote.number}: {quote.study}: {error.args[0]}")
            continue
        if not agrees(quote.number, value):
            said.append(f"{quote.number}: {quote.study}: {quote.place} is {value:.6g}")
    return said
