"""Make every stored result that docs quote, or say which are of other code: ``make figures``, ``make figures-check``.

    python -m benchmarks.figures [NAME ...]             # run what is missing or out of date, of `STUDIES`
    python -m benchmarks.figures --check [--release]    # run nothing

A result is out of date when a module that its study imports, at once or later, has another syntax tree than it had then (comments,
docstrings and layout do not count), or a file of ``config/`` that these modules name has other bytes. Studies that are done are stored at
once: a run that was stopped goes on where it stopped, within a study too where the study keeps finished parts. Pages that are made of
results are written anew; numbers in other pages are quotes, which `quotes` compares.
"""

from __future__ import annotations

import argparse
import ast
import contextlib
import functools
import hashlib
import inspect
import json
import os
import shlex
import subprocess
import sys
import time
from collections.abc import Mapping, Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Final

from benchmarks.__main__ import runner
from benchmarks.document import NAMES
from benchmarks.house import imports, modules
from benchmarks.quotes import quotes, wrong
from benchmarks.report import checkout
from benchmarks.stores import code_of, digest
from benchmarks.studies import STUDIES, TRADEOFF, Study, folder, mentioned, of_command, pages, parts
from benchmarks.tradeoff.document import machine
from benchmarks.tradeoff.stages import STAGES

_DATA: Final = ("baseband", "bodies", "gestures", "levels", "models", "scenes", "strokes", "tracking")  # of config/: what studies read
_ENDS: Final = 30.0  # s for a study that was interrupted to stop what it started
_NAMED: Final = 3  # as many modules a line names; of the others it says how many they are


@functools.cache
def _files() -> Mapping[str, Path]:
    return modules()


@functools.cache
def _imports() -> Mapping[str, set[str]]:
    return imports(_files())


@functools.cache
def _texts(path: Path) -> frozenset[str]:
    """Give all strings in a module: modules that are started or imported by name are among them, and names of configurations."""
    tree = ast.walk(ast.parse(path.read_text(encoding="utf-8")))
    return frozenset(node.value for node in tree if isinstance(node, ast.Constant) and isinstance(node.value, str))


@functools.cache
def _named(path: Path) -> frozenset[str]:
    """Name the modules that strings of a module name: ``"a.b"``, and with ``f"a.{name}"`` all of package a."""
    texts = _texts(path)
    packages = tuple(text for text in texts if text.endswith(".") and text[:-1] in _files())
    return frozenset(name for name in _files() if name in texts or (packages and name.startswith(packages)))


def closure(name: str) -> set[str]:
    """Name the modules that a module imports, or names in a string, and those that these do, itself included."""
    found: set[str] = set()
    todo = {name}
    while todo:
        one = todo.pop()
        found.add(one)
        todo |= (_imports()[one] | _named(_files()[one])) - found
    return found


@functools.cache
def fingerprint(path: Path) -> str:
    """Eight letters that stand for what a file does: the syntax tree of a module, the bytes of any other file."""
    content = code_of(path.read_text(encoding="utf-8")).encode() if path.suffix == ".py" else path.read_bytes()
    return hashlib.sha256(content).hexdigest()[:8]


def code(study: Study) -> dict[str, str]:
    """Fingerprints of all that a study's result depends on, by paths in the checkout: modules, and configurations that these name."""
    root = checkout()
    own = [_files()[name] for name in closure(study.module)]
    said = frozenset[str]().union(*map(_texts, own))
    read = [path for part in _DATA for path in (root / "config" / part).glob("*.*") if {path.stem, path.name} & said]
    return {str(path.relative_to(root)): fingerprint(path) for path in sorted({*own, *read})}


def outdated(name: str, results: Path) -> str:
    """Say why a study has to be run; empty: its stored result is of this code."""
    if not (results / f"{name}.json").exists():
        return f"not stored: {STUDIES[name].absent or 'the file is missing'}"
    record = results / "made" / f"{name}.json"
    if not record.exists():
        return "nobody knows by which code it was made"
    made = json.loads(record.read_text(encoding="utf-8"))
    if made["command"] != STUDIES[name].shown:
        return f"its command was {made['command']}"
    now = code(STUDIES[name])
    other = sorted(path for path in made["code"].keys() | now.keys() if made["code"].get(path) != now.get(path))
    more = f" and {len(other) - _NAMED} more" if len(other) > _NAMED else ""
    return f"{', '.join(other[:_NAMED])}{more} changed since {made['date']}" if other else ""


def _keep(name: str, now: Mapping[str, str]) -> Path:
    """Give the folder for finished parts of a study: either their names or the folder's tell by which code they were made."""
    return checkout() / "build" / "figures" / (STUDIES[name].keep or f"{name}_{digest(now)}")


def _command(study: Study, keep: Path) -> list[str]:
    """Give the words of a study's command; where it can go on, it keeps what is finished."""
    if study.command == TRADEOFF:
        return ["-m", "radar_app", "lab", "tradeoff", "-o", str(keep)]
    words = shlex.split(study.command)
    if "keep" not in inspect.signature(runner(words[0])).parameters:
        return ["-m", "benchmarks", *words, "--json"]
    keep.mkdir(parents=True, exist_ok=True)
    return ["-m", "benchmarks", *words, "--json", "--keep", str(keep)]


def _write(path: Path, content: object, indent: int | None = None) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    partial = path.with_suffix(".part")
    partial.write_text(json.dumps(content, indent=indent) + "\n", encoding="utf-8")
    partial.replace(path)


def _output(command: Sequence[str]) -> tuple[int, str]:
    """Run a command, which shows its progress itself; gives its status and what it said. Interrupted, it may stop what it started."""
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True, cwd=checkout()) as running:
        try:
            said, _ = running.communicate()
        except KeyboardInterrupt:
            with contextlib.suppress(subprocess.TimeoutExpired):
                running.wait(_ENDS)
            running.kill()
            raise
    return running.returncode, said


def make(name: str, results: Path, extra: Sequence[str] = ()) -> str:
    """Run a study and store its result with the code it was made by; returns why there is none, empty: it is stored."""
    study, now = STUDIES[name], code(STUDIES[name])
    keep = _keep(name, now)
    before = os.times()
    command = [sys.executable, *_command(study, keep), *extra]
    status, said = _output(command)
    after = os.times()
    if status:
        return "left out" if status == os.EX_UNAVAILABLE else f"failed with status {status}"
    if study.command == TRADEOFF:
        result = {stage: json.loads((keep / f"{stage}.json").read_text(encoding="utf-8")) for stage in STAGES}
    else:
        result = json.loads(said.splitlines()[-1])
    used = after.children_user + after.children_system - before.children_user - before.children_system
    told = {"command": study.shown, "date": f"{datetime.now(UTC):%Y-%m-%d}", "on": machine(), "cpu_seconds": round(used, 1), "code": now}
    (results / "made" / f"{name}.json").unlink(missing_ok=True)  # stopped between the two: unknown code, not wrong code
    _write(results / f"{name}.json", result)
    _write(results / "made" / f"{name}.json", told, indent=0)
    return ""


def rewrite(made: Sequence[str], results: Path) -> bool:
    """Write the pages anew that are made of results: sections of benchmarks.md, tables of effects.md; whether all went well."""
    commands = []
    for title in NAMES:
        own = [results / f"{name}.json" for name in parts(title)]
        if set(parts(title)) & set(made) and all(path.exists() for path in own):
            commands.append(["-m", "benchmarks.document", f"{title}={','.join(map(str, own))}"])
    if "effects" in made:
        commands.append(["docs/research/make_effects.py", str(results / "effects.json")])
    own_path = {**os.environ, "PYTHONPATH": str(checkout())}
    return all(subprocess.run([sys.executable, *words], check=False, cwd=checkout(), env=own_path).returncode == 0 for words in commands)


def make_all(names: Sequence[str], results: Path) -> bool:
    """Run those of the studies that are out of date, one after the other; returns whether none failed."""
    failed = False
    todo = [name for name in names if outdated(name, results)]
    print(f"{len(names) - len(todo)} of {len(names)} are of this code", flush=True)
    for number, name in enumerate(todo, 1):
        print(f"[{number}/{len(todo)}] {name}: {STUDIES[name].shown}", flush=True)
        start = time.monotonic()
        why = make(name, results)
        failed |= why.startswith("failed") or (not why and not rewrite([name], results))
        hint = "; take the reason why it is not stored out of benchmarks/studies.py" if STUDIES[name].absent and not why else ""
        print(f"[{number}/{len(todo)}] {name}: {why or 'stored'}{hint} ({time.monotonic() - start:.0f} s)", flush=True)
    return not failed


def where_quoted() -> dict[str, dict[str, int]]:
    """Count, by study and page, the marked quotes; a page that gives a study's command, or has its section, quotes it at least 0 times."""
    found: dict[str, dict[str, int]] = {name: {} for name in STUDIES}
    for page in pages():
        text, title = page.read_text(encoding="utf-8"), str(page.relative_to(checkout()))
        named = [name for benchmark in mentioned(text) for name in of_command(benchmark)]
        if page.name == "benchmarks.md":
            named += [name for line in text.splitlines() if line.startswith("## ") for name in parts(line[3:])]
        for name in [*named, *(quote.study for quote in quotes(text))]:
            found[name].setdefault(title, 0)
        for quote in quotes(text):
            found[quote.study][title] += 1
    return found


def check(names: Sequence[str], results: Path) -> int:
    """Print which studies are out of date and why, which pages quote them, and quotes that differ; returns how many there are of all."""
    bad, quoted = 0, where_quoted()
    for name in names:
        why = outdated(name, results)
        bad += bool(why)
        where = ", ".join(f"{page} ({n})" if n else page for page, n in quoted[name].items()) or "no page"
        print(f"{name}: {why or 'of this code'}; in {where}")
    for page in pages():
        for line in wrong(page.read_text(encoding="utf-8")):
            bad += 1
            print(f"{page.relative_to(checkout())}: {line}")
    print(f"{bad} to be looked after" if bad else "all are of this code, and pages say what they say")
    return bad


def main(arguments: Sequence[str] | None = None) -> int:
    """Parse the command line and do what it says; returns the exit status."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.figures", description="Make the figures that docs quote, or check them.")
    parser.add_argument("names", nargs="*", metavar="NAME", help=f"only these studies, of {', '.join(STUDIES)}")
    parser.add_argument("--check", action="store_true", help="run nothing, say what is missing, out of date or quoted wrongly")
    parser.add_argument("--release", action="store_true", help="with --check: exit status 1 when there is something to say")
    options = parser.parse_args(arguments)
    if unknown := [name for name in options.names if name not in STUDIES]:
        parser.error(f"{unknown[0]}: there is no such study; choose of {', '.join(STUDIES)}")
    if options.release and not options.check:
        parser.error("--release goes with --check")
    names, results = options.names or list(STUDIES), folder()
    if options.check:
        return int(bool(check(names, results)) and options.release)
    with contextlib.suppress(KeyboardInterrupt):
        return 0 if make_all(names, results) else 1
    print("stopped; the same command goes on where it stopped", file=sys.stderr)
    return 130


if __name__ == "__main__":
    sys.exit(main())
