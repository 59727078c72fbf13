"""What the pages promise: short, in plain words, complete in the index, with links that lead somewhere and commands that exist."""

import ast
import importlib
import re
import shlex
import subprocess
import sys

import pytest
import typer
import yaml
from pages import DOCS, GENERATED, ROOT, USER_FOLDERS, all_pages, anchors, blocks, commands, links, prose, user_pages, words

from radar_app.cli import app
from radar_core.config import load_file
from radar_tracking.zones import LayoutConfig

LEAST_WORDS, MOST_WORDS = 8_000, 20_000
UNWANTED = (r"\bbits?[- ]for[- ]bit", r"\bsame bits?\b", r"\bequations? \(?\d", r"\(\d+\.\d+\)", r"\beq\. ?\d")


def name(path):
    return str(path.relative_to(ROOT))


def test_user_pages_are_short():
    counted = {name(page): words(page.read_text(encoding="utf-8")) for page in user_pages()}
    assert LEAST_WORDS < sum(counted.values()) <= MOST_WORDS, sorted(counted.items(), key=lambda item: -item[1])


@pytest.mark.parametrize("page", user_pages(), ids=name)
def test_user_pages_need_no_thesis(page):
    """No equation numbers and no promises about bits: what one must know stands in words, evidence in docs/research."""
    text = prose(page.read_text(encoding="utf-8"))
    assert [hit for pattern in UNWANTED for hit in re.findall(pattern, text, re.I)] == []


def test_the_words_that_are_unwanted_are_found():
    for text in ("the same, bit for bit", "bit-for-bit", "the same bits", "equation 7.5", "by (2.11)", "equations 3"):
        assert any(re.search(pattern, text, re.I) for pattern in UNWANTED), text
    assert prose("a ```\nb\n``` `(2.1)` c").split()[-1] == "c"


def test_the_index_has_every_page():
    """Whoever writes a page takes it into docs/index.md and into the nav of mkdocs.yml."""
    linked = {(DOCS / target.partition("#")[0]).resolve() for target in links((DOCS / "index.md").read_text(encoding="utf-8"))}
    there = {page for folder in (*USER_FOLDERS, "research") for page in (DOCS / folder).rglob("*.md")}
    assert sorted(name(page) for page in there - linked) == []
    config = yaml.safe_load((ROOT / "mkdocs.yml").read_text(encoding="utf-8"))
    listed = {DOCS / page for section in config["nav"] for entries in section.values() if isinstance(entries, list) for page in entries}
    assert sorted(name(page) for page in there - listed) == []


@pytest.mark.parametrize("page", all_pages(), ids=name)
def test_links_lead_somewhere(page):
    """Files, images and headings, as GitHub shows them."""
    wrong = []
    for target in links(page.read_text(encoding="utf-8")):
        path, _, anchor = target.partition("#")
        goal = (page.parent / path).resolve() if path else page
        if not goal.exists() or (anchor and goal.suffix == ".md" and anchor not in anchors(goal.read_text(encoding="utf-8"))):
            wrong.append(target)
    assert wrong == []


def test_what_code_names_is_there():
    """Messages and docstrings that name a page name one that exists."""
    asked = subprocess.run(["git", "ls-files", "*.py", "*.yaml", "*.toml", "*.msg", "*.sh"], cwd=ROOT, capture_output=True, text=True)
    if asked.returncode:
        pytest.skip("not a checkout")
    wrong = [
        f"{file}: {path}"
        for file in asked.stdout.split()
        if (ROOT / file).is_file()
        for path in re.findall(r"docs/[\w./-]+\.(?:md|py|json|png|svg)\b", (ROOT / file).read_text(encoding="utf-8").replace("\\.", "."))
        if not (ROOT / path).exists() and not (ROOT / "test" / path).exists()
    ]
    assert wrong == []


@pytest.mark.parametrize("page", [page for page in user_pages() if list(commands(page.read_text(encoding="utf-8")))], ids=name)
def test_commands_exist_with_their_options(page):
    """The command line takes each of them; nothing is run."""
    top = typer.main.get_command(app)
    for line in commands(page.read_text(encoding="utf-8")):
        words_of = shlex.split(line)[1:]
        command, called = top, "handwave"
        while words_of and hasattr(command, "commands"):
            if words_of[0].startswith("-"):
                break
            called = words_of.pop(0)
            assert called in command.commands, f"{line}: there is no {called}"
            command = command.commands[called]
        if not hasattr(command, "commands"):
            command.make_context(called, list(words_of))  # a mistake is an error that names it


@pytest.mark.parametrize("page", [page for page in user_pages() if blocks(page.read_text(encoding="utf-8"), "python", "yaml")], ids=name)
def test_blocks_are_python_and_yaml(page):
    """Each block can be read, and what it imports is there."""
    text = page.read_text(encoding="utf-8")
    for code in blocks(text, "python"):
        for node in ast.walk(ast.parse(code)):
            if isinstance(node, ast.ImportFrom) and node.module.split(".")[0].startswith(("radar_", "handwave")):
                module = importlib.import_module(node.module)
                assert [each.name for each in node.names if not hasattr(module, each.name)] == []
    for code in blocks(text, "yaml"):
        assert yaml.safe_load(code) is not None


def test_the_zones_of_the_tutorial_are_a_file(tmp_path):
    text = (DOCS / "tutorials" / "count-people.md").read_text(encoding="utf-8")
    path = tmp_path / "living_room.yaml"
    path.write_text(blocks(text, "yaml")[0], encoding="utf-8")
    assert [zone.name for zone in load_file(LayoutConfig, path).zones] == ["near", "far"]


@pytest.mark.long
def test_generated_pages_are_what_the_code_says():
    done = subprocess.run([sys.executable, "docs/make_reference.py", "--check"], cwd=ROOT, capture_output=True, text=True, timeout=250)
    assert done.returncode == 0, done.stdout + done.stderr
    for page in GENERATED:
        assert "<!-- Made by docs/make_reference.py" in page.read_text(encoding="utf-8")


@pytest.mark.long
def test_the_site_builds_without_a_warning_and_fetches_nothing(tmp_path):
    pytest.importorskip("mkdocs")
    build = [sys.executable, "-m", "mkdocs", "build", "--strict", "--quiet", "--site-dir", str(tmp_path)]
    done = subprocess.run(build, cwd=ROOT, capture_output=True, text=True, timeout=200)
    assert done.returncode == 0, done.stdout + done.stderr
    assert not (done.stdout + done.stderr).strip()
    loads = r'(?:<script[^>]+src|<img[^>]+src|<link[^>]+href)="(?:https?:)?//[^"]*"|url\(["\']?(?:https?:)?//[^)]*\)|@import[^;]*//[^;]*'
    files = [path for kind in ("*.html", "*.css") for path in tmp_path.rglob(kind)]
    assert len(files) > 30
    for page in DOCS.rglob("*.md"):  # what GitHub shows as a table is one here too
        html = (tmp_path / page.relative_to(DOCS)).with_suffix(".html").read_text(encoding="utf-8")
        assert html.count("<table") >= len(re.findall(r"^\|[ :|-]+\|$", page.read_text(encoding="utf-8"), re.M)), page
    assert {path.name: hits for path in files if (hits := re.findall(loads, path.read_text(encoding="utf-8")))} == {}


@pytest.mark.long
def test_the_tutorial_in_python_finds_both_gestures(tmp_path):
    """As a reader does it: the recording, then the script of the page."""
    text = (DOCS / "tutorials" / "recording-in-python.md").read_text(encoding="utf-8")
    first = next(line for line in commands(text) if "simulate" in line)
    subprocess.run(
        [sys.executable, "-m", "radar_app.cli", *shlex.split(first)[1:]], cwd=tmp_path, check=True, capture_output=True, timeout=200
    )
    script = tmp_path / "watch.py"
    script.write_text("import matplotlib\nmatplotlib.use('Agg')\n" + "\n".join(blocks(text, "python")), encoding="utf-8")
    done = subprocess.run([sys.executable, "watch.py"], cwd=tmp_path, capture_output=True, text=True, timeout=250)
    assert done.returncode == 0, done.stderr
    assert "gestures: ['push', 'swipe_right']" in done.stdout
    assert (tmp_path / "seen.png").stat().st_size > 10_000
