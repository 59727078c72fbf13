"""What the doctor says about one symptom."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final, Literal, get_args

Symptom = Literal[
    "radar info missing",
    "unusable data",
    "stitched frames",
    "drops",
    "clock offset",
    "saturation",
    "interference",
    "wrong angle sign",
    "aliased speed",
    "low SNR",
    "wrong tilt",
    "nobody found",
    "lost when still",
    "merged people",
    "ghosts",
]
SYMPTOMS: Final[tuple[Symptom, ...]] = get_args(Symptom)
"""All symptoms, in the order of the signal: what stands first spoils what is measured after it, so that it is the likelier fault."""


@dataclass(frozen=True)
class Finding:
    """One symptom: what was measured, and whether it is a fault.

    Attributes
    ----------
    symptom : str
        Of `SYMPTOMS`.
    fault : bool or None
        Whether it is one; None: it could not be measured, and ``text`` says why.
    value, limit : float or None
        What was measured and from where on it is a fault, in ``unit``.
    unit : str
        Of both.
    text : str
        The figure in words.
    remedy : str
        What to change, as a line to paste where there is one; empty without a fault.
    radar : str
        Namespace of the radar; empty: there is one.
    """

    symptom: Symptom
    fault: bool | None
    value: float | None
    limit: float | None
    unit: str
    text: str
    remedy: str = ""
    radar: str = ""


def unknown(symptom: Symptom, why: str) -> Finding:
    """Say that a symptom could not be looked for."""
    return Finding(symptom, None, None, None, "", why)


def in_order(findings: list[Finding]) -> tuple[Finding, ...]:
    """Put the faults first, the likeliest before the others, then what is well, then what is not known."""
    rank = {True: 0, False: 1, None: 2}
    return tuple(sorted(findings, key=lambda f: (rank[f.fault], SYMPTOMS.index(f.symptom), f.radar)))
