"""The table of hazards is true: it names every test, its page is up to date, its mutations fit the code, and ten of them are proved."""

import subprocess
import sys
from collections import Counter
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).resolve().parent))
from hazards import HERE, README, ROOT, existing_tests, hazards, mutations, readme


def test_every_test_is_in_the_table_and_every_test_of_the_table_is_there():
    """A new test goes into a row of `hazards.yaml`; a row whose test is gone says so."""
    named = {test for row in hazards() for test in row.tests}
    here = set(existing_tests())
    assert not here - named, f"put these into a row of {HERE.name}/hazards.yaml: {sorted(here - named)}"
    assert not named - here, f"these are in {HERE.name}/hazards.yaml, but there are no such tests: {sorted(named - here)}"
    assert not {m.test.split("[")[0] for m in mutations()} - here


def test_the_page_is_what_the_table_says():
    """Written by ``python test/stability/hazards.py``."""
    assert README.read_text(encoding="utf-8") == readme(), "write it anew: python test/stability/hazards.py"


def test_the_table_is_large_enough():
    """Sixty hazards, all different, each with a test; as many guards that were seen to be needed; ten quick ones."""
    rows, every = hazards(), mutations()
    assert len({row.hazard for row in rows}) == len(rows) >= 60
    assert all(row.tests and row.fails for row in rows)
    assert len({m.name for m in every}) == len(every) >= 60
    assert sum(m.some for m in every) >= 10


@pytest.mark.parametrize("mutation", mutations(), ids=lambda m: m.name)
def test_mutations_fit_the_code(mutation):
    """The text that is taken out occurs once, and what is left still compiles: otherwise a failure would prove nothing."""
    text = mutation.apply()
    assert text != (ROOT / mutation.file).read_text(encoding="utf-8")
    compile(text, mutation.file, "exec")


def test_mutated_files_are_not_packages():
    """One module is replaced, not a folder of them."""
    assert not [m.name for m in mutations() if m.file.endswith("__init__.py")]
    assert not [name for name, n in Counter(m.old + m.file for m in mutations()).items() if n > 1]


@pytest.mark.long
def test_ten_guards_are_needed():
    """Ten quick mutations, each in a process of its own, and the control: the command itself, as people run it."""
    command = [sys.executable, str(HERE / "mutations.py"), "--some", "10", "--jobs", "2"]
    found = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=280, check=False)
    assert found.returncode == 0, found.stdout + found.stderr
    assert "10 guards taken out" in found.stdout
