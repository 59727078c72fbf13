"""Figures in pages are those of stored results: marked numbers, and tables that commands write."""

import importlib.util
import itertools
import json
import re

import pytest
from pages import DOCS, ROOT

from benchmarks.document import NAMES, section
from benchmarks.quotes import agrees, look_up, quotes, wrong
from benchmarks.report import join
from benchmarks.studies import STUDIES, folder, mentioned, of_command, pages, parts

LEAST = 150  # marked numbers in all pages


@pytest.mark.parametrize("page", pages(), ids=lambda page: str(page.relative_to(ROOT)))
def test_quotes_are_what_is_stored(page):
    assert wrong(page.read_text(encoding="utf-8")) == []


def test_there_are_quotes():
    assert sum(len(list(quotes(page.read_text(encoding="utf-8")))) for page in pages()) >= LEAST


def test_commands_in_pages_are_studies_of_the_table():
    """A page that tells the command of figures names a study that is stored, or of which the table says why it is not yet."""
    text = {page: page.read_text(encoding="utf-8") for page in pages()}
    assert [f"{page}: {name}" for page, found in text.items() for name in mentioned(found) if not of_command(name)] == []
    told = {study for found in text.values() for name in mentioned(found) for study in of_command(name)}
    titles = re.findall(r"^## (.+)$", text[DOCS / "research" / "benchmarks.md"], re.M)
    told |= {study for title in titles for study in parts(title)}
    assert sorted(STUDIES.keys() - told) == []


def test_stored_results_are_those_of_the_table():
    stored = {path.stem for path in folder().glob("*.json")}
    assert stored == {name for name, study in STUDIES.items() if not study.absent}
    assert {path.stem for path in (folder() / "made").glob("*.json")} <= stored


@pytest.mark.parametrize("title", NAMES)
def test_sections_are_what_is_stored(title):
    """docs/research/benchmarks.md says what ``python -m benchmarks.document`` writes of the stored results, and nothing else."""
    own = [folder() / f"{name}.json" for name in parts(title)]
    assert own
    found = dict(part.split("\n", 1) for part in (DOCS / "research" / "benchmarks.md").read_text(encoding="utf-8").split("\n## ")[1:])
    if not all(path.exists() for path in own):
        assert title not in found
        return
    assert found[title].strip() == section(title, join(json.loads(path.read_text(encoding="utf-8")) for path in own)).strip()


def test_tables_of_effects_are_what_is_stored():
    spec = importlib.util.spec_from_file_location("make_effects", DOCS / "research" / "make_effects.py")
    script = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(script)
    result, text = json.loads((folder() / "effects.json").read_text(encoding="utf-8")), script.PAGE.read_text(encoding="utf-8")
    for name in ("times", "costs", "total"):
        assert script.put(text, name, getattr(script, name)(result)) == text, name


_RULE = re.compile(r"\|[-:| ]+\|")
_FIGURE = re.compile(r"[-+]?\d[\d,]*(\.\d+)?( ?(%|m|cm|mm|s|ms|dB|kB|MB|m/s|degrees?))?([ (/;,].*)?")
_MADE = (
    "accuracy-and-time.md",
    "benchmarks.md",
    "effects.md",
    "faults.md",
    "model-card.md",
    "model-card-stream.md",
)  # whole tables come from results
_NO_RESULT = "<!-- settings -->"  # before a table of numbers that nobody measured


def unmarked(text: str) -> list[str]:
    """List the rows of tables that give figures and quote no result; those of the thesis, and those that a test or a command makes, may."""
    text = re.sub(r"<!-- ([a-z-]+) -->\n.*?<!-- /\1 -->", "", text, flags=re.DOTALL)  # written by a command
    found, before, lines = [], "", [*text.splitlines(), ""]
    for line, after in itertools.pairwise(lines):
        if not line.startswith("|"):
            before = line or before
            continue
        cells = [cell.strip() for cell in line.strip("|").split("|")]
        theirs = cells[0].startswith("thesis") or "`test_" in line or before == _NO_RESULT
        if theirs or _RULE.fullmatch(line) or _RULE.fullmatch(after) or "<!--=" in line:
            continue
        found += [line for cell in cells[1:] if _FIGURE.fullmatch(cell.replace("*", ""))][:1]
    return found


@pytest.mark.parametrize(
    "page", [page for page in pages() if page.parent.name == "research" and page.name not in _MADE], ids=lambda page: page.name
)
def test_tables_of_figures_quote_results(page):
    assert unmarked(page.read_text(encoding="utf-8")) == []


def test_rows_without_quotes_are_found():
    head = "words\n\n| what | value |\n|---|---:|\n"
    for row in ("| a | 0.5 |", "| a | 12 % (3 to 4) |", "| a | **-3.1** m |", "| a | words | 1 / 2 |"):
        assert unmarked(f"{head}{row}\n") == [row]
    for row in ("| 0.5 | words |", "| a | 3D |", "| thesis | 0.5 |", "| a | 0.5<!--= study: a --> | 0.6 |", "| a | 0.5, by `test_a` |"):
        assert unmarked(f"{head}{row}\n") == []
    assert unmarked(f"<!-- settings -->\n{head[7:]}| a | 0.5 |\n") == []
    assert unmarked(f"<!-- made -->\n{head}| a | 0.5 |\n<!-- /made -->\n") == []


def test_a_number_is_a_value_to_its_digits():
    for number, value in (("0.69", 0.6949), ("0.69", 0.685), ("3", 3.4), ("1552", 1552), ("1.6e-7", 1.649e-7), ("-0.21", -0.2051)):
        assert agrees(number, value), (number, value)
    for number, value in (("0.69", 0.6951), ("0.69", 0.6849), ("3", 3.6), ("1552", 1553), ("1.6e-7", 1.7e-7), ("0.21", -0.2051)):
        assert not agrees(number, value), (number, value)
    assert not agrees("0.5", float("nan"))


def test_quotes_that_differ_are_found(tmp_path):
    """Right ones of each kind, then each made wrong."""
    rows = [{"stage": stage, "choice": "a", "accuracy": {"value": value}} for stage, value in (("one", 0.25), ("two", 1282194.0))]
    (tmp_path / "study.json").write_text(json.dumps({"share": 0.4217, "pair": [3, 4], "choices": rows}), encoding="utf-8")
    right = (
        "| 42 %<!--= study: share --> | 0.42<!--= study: share -->, of 4<!--= study: pair / 1 -->;\n"
        "0.25<!--= study: choices / one: a / accuracy / value --> m, 1.28 MB<!--= study: choices / two: a / accuracy / value * 1e-6 -->, "
        "1,282,194<!--= study: choices / two: a / accuracy / value --> bytes\n"
    )
    assert wrong(right, tmp_path) == []
    for good, bad in (("42 %", "43 %"), ("0.42", "0.43"), ("of 4", "of 5"), ("0.25", "0.26"), ("1.28", "1.27"), ("1,282,194", "1,282,195")):
        assert len(wrong(right.replace(good, bad), tmp_path)) == 1, bad
    for good, bad in (("study: share", "other: share"), ("study: share", "study: none"), ("/ 1 ", "/ 2 "), ("one: a", "a"), (" / 1 ", " ")):
        assert wrong(right.replace(good, bad), tmp_path), bad


def test_marks_without_numbers_are_refused():
    for text in ("none<!--= probe: right -->", "5<!--= probe -->", "5 of 12 | 3 words <!--= -->"):
        with pytest.raises(ValueError, match="no number with a mark"):
            list(quotes(text))


def test_figures_are_looked_up():
    assert look_up({"a": {"b c": [1, 2.5]}}, "a / b c / 1") == 2.5
    for place in ("a", "a / d", "a / b c / 2", "a / b c / 1 / e"):
        with pytest.raises(KeyError):
            look_up({"a": {"b c": [1, 2.5]}}, place)
