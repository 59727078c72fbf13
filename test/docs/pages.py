"""The pages of docs/ as the tests see them: which are for users, their words, headings, links and blocks of code."""

from __future__ import annotations

import re
from collections import Counter
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
DOCS = ROOT / "docs"
GENERATED = {DOCS / "reference" / f"{name}.md" for name in ("commands", "parameters", "topics", "messages", "formats")}
USER_FOLDERS = ("tutorials", "how-to", "reference", "explanation")


def user_pages():
    """Pages that people write for people who use Handwave: README, index, all that is neither generated nor research."""
    written = (page for folder in USER_FOLDERS for page in sorted((DOCS / folder).rglob("*.md")))
    return [ROOT / "README.md", DOCS / "index.md", *(page for page in written if page not in GENERATED)]


def all_pages():
    """Every page, and those at the root that link to them."""
    return [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *sorted(DOCS.rglob("*.md"))]


def words(text):
    """Number of words, those in code included, notes to ourselves not: whatever stands between spaces and has a letter or a digit."""
    return sum(bool(re.search(r"\w", word)) for word in re.sub(r"<!--.*?-->", "", text, flags=re.S).split())


def prose(text):
    """Text without blocks of code and code in a line."""
    return re.sub(r"`[^`\n]*`", "", re.sub(r"^( *)```.*?^\1```", "", text, flags=re.S | re.M))


def blocks(text, *languages):
    """Fenced blocks of code in these languages."""
    return [code for language, code in re.findall(r"^ *```(\S*)[^\n]*\n(.*?)^ *```", text, re.S | re.M) if language in languages]


def anchors(text):
    """Anchors of all headings, as GitHub makes them: small letters, no punctuation, - for each space, a number for what comes again."""
    found, count = set(), Counter()
    for line in re.sub(r"^( *)```.*?^\1```", "", text, flags=re.S | re.M).splitlines():
        if heading := re.match(r"#{1,6} +(.+?) *#*$", line):
            plain = re.sub(r"\[([^]]*)\]\([^)]*\)", r"\1", heading[1]).lower()
            slug = re.sub(r"[^\w\- ]", "", plain).replace(" ", "-")
            found.add(f"{slug}-{count[slug]}" if count[slug] else slug)
            count[slug] += 1
    return found


def links(text):
    """Targets of all links and images that stay within the project."""
    return [target for target in re.findall(r"\]\(([^)\s]+)\)", prose(text)) if not re.match(r"[a-z]+:", target)]


def commands(text):
    """Command lines that begin with `handwave` in blocks of the shell or indented ones, without comments; lines that go on are joined."""
    indented = "\n".join(re.findall(r"^    (handwave .*)$", text, re.M))
    shell = "\n".join(blocks(text, "sh", "bash", "shell"))
    for line in re.sub(r" *\\\n *", " ", f"{shell}\n{indented}").splitlines():
        for part in re.split(r"&&|;| [|>] ", line.partition(" #")[0]):
            if part.strip().startswith("handwave "):
                yield part.strip()
