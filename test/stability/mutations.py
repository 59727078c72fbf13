"""Take guards out of the code, one at a time, and see that the tests notice.

Each mutation of `hazards.yaml` is a file, a text that occurs in it once, what stands there instead, and a test that must fail. The one
module is imported from a changed copy (a finder in front of all others: an editable installation has one too), everything else as ever,
and pytest runs the one test in a process of its own. A control imports unchanged copies of the same modules: there all tests must pass.
"""

from __future__ import annotations

import argparse
import contextlib
import importlib.util
import multiprocessing
import os
import sys
import tempfile
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from importlib.machinery import ModuleSpec
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parent))
from hazards import HERE, ROOT, Mutation, mutations

_PRELOAD = [
    "numpy",
    "scipy.optimize",
    "scipy.special",
    "scipy.signal",
    "scipy.spatial",
    "numba",
    "pytest",
    "hypothesis",
    "yaml",
    "pydantic",
]
_LIMIT = 120  # s: of one test; a guard against endless loops is one too
_POOLS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")


@dataclass(frozen=True)
class Job:
    """Tests to run with some modules replaced.

    Attributes
    ----------
    name : str
        For people.
    modules : mapping of str to str
        Source text by module name.
    tests : tuple of str
        What pytest runs.
    fails : bool
        Whether a test has to fail.
    compiled : bool
        Use nothing that numba compiled before.
    """

    name: str
    modules: Mapping[str, str]
    tests: tuple[str, ...]
    fails: bool
    compiled: bool


@dataclass(frozen=True)
class Outcome:
    """How a job ended: all well, or why not, and what pytest said."""

    name: str
    problem: str
    seconds: float
    output: str


class Replaced:
    """Finder that imports some modules from other files."""

    def __init__(self, files: Mapping[str, Path]) -> None:
        self.files = files

    def find_spec(self, name: str, path: object = None, target: object = None) -> ModuleSpec | None:
        """Answer for the replaced modules, leave the others alone."""
        return importlib.util.spec_from_file_location(name, self.files[name]) if name in self.files else None


class Verdicts:
    """Pytest plugin that counts: tests that ran, and those that failed while they ran (not in what was prepared for them)."""

    def __init__(self) -> None:
        self.ran = self.failed = self.broken = 0

    def pytest_runtest_logreport(self, report: object) -> None:
        """Count one report."""
        if report.when == "call":  # type: ignore[attr-defined]
            self.ran += 1
            self.failed += report.failed  # type: ignore[attr-defined]
        else:
            self.broken += report.failed  # type: ignore[attr-defined]


def job_of(mutation: Mutation) -> Job:
    """Make the job of one mutation."""
    return Job(mutation.name, {mutation.module: mutation.apply()}, (mutation.test,), True, mutation.compiled)


def control_of(chosen: Sequence[Mutation]) -> Job:
    """All their tests with unchanged copies; compiled modules stay where they are, or every kernel would be compiled again."""
    modules = {m.module: (ROOT / m.file).read_text(encoding="utf-8") for m in chosen if not m.compiled}
    return Job("control: nothing taken out", modules, tuple(dict.fromkeys(m.test for m in chosen)), False, False)


def run(job: Job) -> Outcome:
    """Run one job in this process, which must not have imported anything of Handwave yet."""
    start = time.monotonic()
    with tempfile.TemporaryDirectory(prefix="handwave-mutation-") as folder:
        output = Path(folder) / "output.txt"
        descriptor = os.open(output, os.O_WRONLY | os.O_CREAT)
        for stream in (1, 2):
            os.dup2(descriptor, stream)
        problem = _run(job, Path(folder))
        sys.stdout.flush()
        text = output.read_text(encoding="utf-8", errors="replace")
    return Outcome(job.name, problem, time.monotonic() - start, text)


def _run(job: Job, folder: Path) -> str:
    """Import the copies, run pytest; what is wrong, empty: nothing."""
    import hypothesis
    import numba
    import pytest

    files = {}
    for name, text in job.modules.items():
        files[name] = folder / "copies" / (name.replace(".", "/") + ".py")
        files[name].parent.mkdir(parents=True, exist_ok=True)
        files[name].write_text(text, encoding="utf-8")
    if any(name.split(".")[0].startswith("radar_") for name in sys.modules):
        return "Handwave was imported before its copy was in place"
    sys.meta_path.insert(0, Replaced(files))
    if job.compiled:
        numba.config.CACHE_DIR = str(folder / "numba")
    # Nothing found with a changed module may be remembered, and the first failure will do.
    phases = (hypothesis.Phase.explicit, hypothesis.Phase.generate)
    hypothesis.settings.register_profile("mutations", database=None, deadline=None, derandomize=True, phases=phases)
    hypothesis.settings.load_profile("mutations")
    os.chdir(ROOT)
    verdicts = Verdicts()
    options = ["-q", "-p", "no:cacheprovider", "-p", "no:xdist", "--tb=short", f"--timeout={_LIMIT}", "-m", ""]
    stop = ["-x"] if job.fails else []
    code = int(pytest.main([*options, *stop, *(f"{HERE}/{test}" for test in job.tests)], plugins=[verdicts]))
    return _problem(job, files, verdicts, code)


def _problem(job: Job, files: Mapping[str, Path], verdicts: Verdicts, code: int) -> str:
    for name, path in files.items():
        if getattr(sys.modules.get(name), "__file__", None) != str(path):
            return f"{name} was not imported from its copy"
    if verdicts.broken or code not in (0, 1) or not verdicts.ran:
        return f"the tests could not run (pytest says {code})"
    if job.fails and not verdicts.failed:
        return "the test passes without the guard"
    if not job.fails and verdicts.failed:
        return f"{verdicts.failed} of {verdicts.ran} tests fail though nothing was taken out"
    return ""


def prove(jobs: Sequence[Job], workers: int) -> list[Outcome]:
    """Run jobs side by side, each in a process of its own, with a progress bar."""
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn

    for pool in _POOLS:
        os.environ.setdefault(pool, "1")
    context = multiprocessing.get_context("forkserver")
    context.set_forkserver_preload(_PRELOAD)
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn())
    outcomes = []
    with Progress(*columns) as progress, context.Pool(workers, maxtasksperchild=1) as pool:
        task = progress.add_task("taking out guards", total=len(jobs))
        for outcome in pool.imap_unordered(run, jobs):
            outcomes.append(outcome)
            progress.update(task, advance=1, description=outcome.name[:40].ljust(40))
            if outcome.problem:
                progress.console.print(f"[red]{outcome.name}[/red]: {outcome.problem} ({outcome.seconds:.1f} s)")
    return outcomes


def choose(names: Sequence[str], some: int | None) -> list[Mutation]:
    """Pick mutations: by name, the first of the quick ones, or all."""
    known = {mutation.name: mutation for mutation in mutations()}
    unknown = [name for name in names if name not in known]
    if unknown:
        raise SystemExit(f"no mutation is called {', '.join(unknown)}; --list shows them all")
    if names:
        return [known[name] for name in names]
    return list(known.values()) if some is None else [m for m in known.values() if m.some][:some]


def main(arguments: Sequence[str] | None = None) -> int:
    """Prove mutations; 0 when every test noticed and the control passed, 1 when not."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("names", nargs="*", help="mutations to prove; none: all (some minutes)")
    parser.add_argument("--some", type=int, metavar="N", help="only the first N of the quick ones; every run of the tests proves ten")
    parser.add_argument("-j", "--jobs", type=int, default=os.cpu_count() or 1, help="processes side by side (default: one per core)")
    parser.add_argument("--list", action="store_true", help="name the mutations and leave")
    parser.add_argument("--show", action="store_true", help="print what pytest said, of all")
    options = parser.parse_args(arguments)
    chosen = choose(options.names, options.some)
    if options.list:
        print("\n".join(f"{m.name:32} {m.file}  {m.test}" for m in chosen))
        return 0
    start = time.monotonic()
    outcomes = prove([control_of(chosen), *map(job_of, chosen)], max(options.jobs, 1))
    for outcome in outcomes:
        if outcome.problem or options.show:
            print(f"\n--- {outcome.name}: {outcome.problem or 'as it should be'} ({outcome.seconds:.1f} s)\n{outcome.output[-3000:]}")
    wrong = [outcome.name for outcome in outcomes if outcome.problem]
    print(f"{len(chosen)} guards taken out in {time.monotonic() - start:.0f} s; {len(wrong)} jobs not as they should be")
    return 1 if wrong else 0


if __name__ == "__main__":
    with contextlib.suppress(KeyboardInterrupt):
        raise SystemExit(main())
    raise SystemExit(130)
