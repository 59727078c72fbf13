"""What `benchmarks.faults` knows of one fault, and what was seen of it."""

from __future__ import annotations

import re
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, Final

from radar_core import HandwaveError

MOST: Final = 4  # lines with the words; who says a thing more often than a graph has nodes that it concerns floods its log


@dataclass
class Seen:
    """What a fault did.

    Attributes
    ----------
    survived : bool
        Whether everything works afterwards that worked before, without a person.
    lines : list of str
        What was said meanwhile.
    lost : int
        Of what had been acknowledged before (written and flushed, saved), how much is gone.
    recover_s : float
        From the end of the fault until everything works again [s]; 0: nothing was interrupted.
    note : str
        Why it did not survive, for people.
    """

    survived: bool
    lines: list[str] = field(default_factory=list)
    lost: int = 0
    recover_s: float = 0.0
    note: str = ""


@dataclass(frozen=True)
class Fault:
    """One row of the table: a fault, by what means it is injected, and the words that name it, as a regular expression."""

    name: str
    means: str
    words: str
    inject: Callable[..., Seen]
    most: int = MOST
    quick: bool = False  # cheap enough for a quick run


def told(group: str, fault: Fault, seen: Seen) -> dict[str, Any]:
    """Put one row of the result together."""
    lines = [line for line in seen.lines if re.search(fault.words, line, re.IGNORECASE)]
    return {
        "group": group,
        "fault": fault.name,
        "means": fault.means,
        "words": fault.words,
        "survived": seen.survived,
        "named": len(lines),
        "named_once": 1 <= len(lines) <= fault.most,
        "line": lines[0][:300] if lines else "",
        "lost_acknowledged": seen.lost,
        "recover_s": round(seen.recover_s, 3),
        "note": seen.note,
    }


def refused(call: Callable[[], Any], *, good: Callable[[], Any] | None = None, lost: int = 0) -> Seen:
    """Let something read what is damaged: it has to refuse it with an error of ours, and ``good`` has to work afterwards."""
    try:
        call()
    except HandwaveError as error:
        lines, began = str(error).splitlines(), time.monotonic()
        if good is not None:
            good()
        return Seen(True, lines, lost, time.monotonic() - began if good is not None else 0.0)
    except BaseException as error:
        return Seen(False, [f"{type(error).__name__}: {error}"], lost, note=f"{type(error).__name__} left the door")
    return Seen(False, note="it was taken")
