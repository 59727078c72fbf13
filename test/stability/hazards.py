"""The table of hazards: what can go wrong with numbers, what would, which tests look for it, and which mutations prove that they do.

`hazards.yaml` is the table; this module reads it and writes `README.md` from it. `test_hazards.py` holds both true to the tests.
"""

from __future__ import annotations

import ast
import functools
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import yaml

HERE = Path(__file__).resolve().parent
ROOT = HERE.parents[1]
TABLE = HERE / "hazards.yaml"
README = HERE / "README.md"


@dataclass(frozen=True)
class Mutation:
    """One guard taken out of the code, and the test that must notice.

    Attributes
    ----------
    name : str
        Unique, for the command line.
    file : str
        Path within the repository.
    old, new : str
        Text with the guard, which must occur exactly once, and without.
    test : str
        ``file.py::function``, maybe with ``[parameters]``; must fail.
    some : bool
        One of the quick ones that every run of the tests proves.
    """

    name: str
    file: str
    old: str
    new: str
    test: str
    some: bool = False

    def apply(self) -> str:
        """Return the file's text without the guard."""
        text = (ROOT / self.file).read_text(encoding="utf-8")
        if text.count(self.old) != 1:
            raise ValueError(f"{self.name}: {self.file} holds the text to replace {text.count(self.old)} times, expected once:\n{self.old}")
        return text.replace(self.old, self.new)

    @property
    def module(self) -> str:
        """Name by which the file is imported."""
        return self.file.removesuffix(".py").replace("/", ".")

    @property
    def compiled(self) -> bool:
        """Whether numba compiles something of the file, so that nothing compiled before may be used."""
        return "numba" in (ROOT / self.file).read_text(encoding="utf-8")


@dataclass(frozen=True)
class Hazard:
    """One row of the table.

    Attributes
    ----------
    hazard, fails : str
        What is hard, and the failure that the guards prevent.
    tests : tuple of str
        ``file.py::function`` of every test that looks for it.
    mutations : tuple of Mutation
        Guards that were seen to be needed.
    """

    hazard: str
    fails: str
    tests: tuple[str, ...]
    mutations: tuple[Mutation, ...] = ()


@functools.cache
def load() -> list[tuple[str, list[Hazard]]]:
    """Read the table: chapters with their hazards."""
    chapters = yaml.safe_load(TABLE.read_text(encoding="utf-8"))
    return [
        (
            chapter["chapter"],
            [
                Hazard(row["hazard"], row["fails"], _tests(row["tests"]), tuple(_mutation(**m) for m in row.get("mutations", ())))
                for row in chapter["hazards"]
            ],
        )
        for chapter in chapters
    ]


def _tests(by_file: Mapping[str, Sequence[str]]) -> tuple[str, ...]:
    return tuple(f"test_{file}.py::test_{name}" for file, names in by_file.items() for name in names)


def _mutation(*, test: str, **rest: Any) -> Mutation:
    file, name = test.split("::", 1)
    return Mutation(test=f"test_{file}.py::test_{name}", **rest)


def hazards() -> list[Hazard]:
    """All rows."""
    return [row for _, rows in load() for row in rows]


def mutations() -> list[Mutation]:
    """All mutations, in the order of the table."""
    return [mutation for row in hazards() for mutation in row.mutations]


def existing_tests() -> Iterator[str]:
    """``file.py::function`` of every test in this folder."""
    for path in sorted(HERE.glob("test_*.py")):
        for node in ast.parse(path.read_text(encoding="utf-8")).body:
            if isinstance(node, ast.FunctionDef) and node.name.startswith("test_"):
                yield f"{path.name}::{node.name}"


_HEAD = """# Numerical hazards

What is hard for the numbers in Handwave, what would go wrong without a guard, and which tests look for it. A test that cannot fail proves
nothing, so guards are taken out of the code one at a time: each such mutation below makes its test fail.

    make stability                                  # the tests of this folder
    make mutations                                  # take out every guard, one after the other (ARGS="--help" tells more)
    python test/stability/mutations.py --some 10    # the ten quick ones that `make test-all` proves

Tests are named without `test_`: `core::solve_in_a_batch` is `test_solve_in_a_batch` of `test_core.py`. This page is written from
`hazards.yaml` by `python test/stability/hazards.py`; `test_hazards.py` fails when the two differ, when a test is in no row, or when a
mutation no longer fits the code. A new test goes into a row of the table, a new hazard gets a row.

"""


_CONDITIONS = """
## Where condition numbers are told

| of what | where |
|---|---|
| bounds, unfolding, NEES, distances (`solve_spd`) | `SingularError` with the number beyond 1e12, units scaled away |
| innovations of the filters | refused with the track's row below a pivot of 1e-12 of the scaled covariance |
| tracks' covariances | `covariance_condition` in the diagnostics of tracking |
| velocity of the hand | `SnapshotVelocity.condition`, `velocity_condition` of `hand`; shares by rank in its diagnostics |
| alignment of two radars | `condition` of the result, `handwave calibrate-pair`; `NotObservableError` beyond `max_condition` |
| calibration of an array | `CalibratedArray.condition`, its file, `handwave calibrate`; refused beyond a limit |
"""


def readme() -> str:
    """Write the page."""
    rows, all_mutations = hazards(), mutations()
    n_tests = len({test for row in rows for test in row.tests})
    parts = [_HEAD, f"{len(rows)} hazards, {n_tests} tests, {len(all_mutations)} mutations.\n"]
    for chapter, own in load():
        parts.append(f"\n## {chapter}\n\n| hazard | without the guard | tests | mutations |\n|---|---|---|---|\n")
        for row in own:
            tests = "<br>".join(f"`{_short(test)}`" for test in row.tests)
            taken = "<br>".join(f"`{m.name}`{' *' if m.some else ''}" for m in row.mutations)
            parts.append(f"| {row.hazard} | {row.fails} | {tests} | {taken} |\n")
    parts.append(_CONDITIONS)
    parts.append("\n## Mutations\n\n`*`: one of the ten.\n\n| mutation | file | guard taken out | must fail |\n|---|---|---|---|\n")
    for m in all_mutations:
        old, new = (_code(text) for text in (m.old, m.new))
        parts.append(f"| `{m.name}`{' *' if m.some else ''} | `{m.file}` | {old} → {new} | `{_short(m.test)}` |\n")
    return "".join(parts)


def _short(test: str) -> str:
    """Name of a test without what all have."""
    return test.removeprefix("test_").replace(".py::test_", "::")


def _code(text: str) -> str:
    """One cell of a table, lines apart."""
    lines = [line.strip() for line in text.strip().splitlines() if line.strip()]
    return "<br>".join(f"`` {line.replace('|', chr(92) + '|')} ``" for line in lines) or "nothing"


if __name__ == "__main__":
    README.write_text(readme(), encoding="utf-8")
