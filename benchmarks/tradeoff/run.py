"""Measure stage after stage; what is finished is on disk, and is not measured again."""

from __future__ import annotations

import importlib.metadata
import json
import os
import platform
from collections.abc import Iterator
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any, Final

from threadpoolctl import threadpool_limits

from benchmarks.plot import draw
from benchmarks.report import Found, scaled
from benchmarks.stores import digest, sources
from benchmarks.tradeoff.document import report, verdicts
from benchmarks.tradeoff.stages import STAGES, Stage, StudyConfig
from radar_core import ConfigError, DataError, HandwaveError
from radar_core.paths import find_config
from radar_sim import load_scene

FORMAT: Final = 1
CACHE: Final = "simulated"
REPORT: Final = "report.md"
_SHARED: Final = ("benchmarks/report.py", "benchmarks/tradeoff/people.py", "benchmarks/tradeoff/echoes.py")
_LIBRARIES: Final = ("numpy", "scipy", "numba", "scikit-learn", "finufft")


@dataclass(frozen=True)
class Job:
    """What the user asked for."""

    out: Path
    study: StudyConfig
    stages: tuple[Stage, ...]
    factor: float = 1.0  # what times are multiplied by
    again: bool = False  # measure what is there already, too
    note: str = ""  # one more sentence at the report's head


def key(stage: Stage, study: StudyConfig) -> str:
    """Digest of everything that a stage's figures depend on, but for how busy the machine is."""
    told: dict[str, Any] = {name: value for name, value in asdict(study).items() if name not in ("folder", "domain", "scene")}
    if stage.scene and study.scene is not None:
        told["scene"] = find_config(study.scene, "scenes", ".yaml").read_text(encoding="utf-8")
    told |= {"format": FORMAT, "code": sources((*stage.packages, *_SHARED, f"{stage.module.replace('.', '/')}.py"))}
    told |= {"machine": f"{platform.machine()} {os.cpu_count()}", "python": platform.python_version()}
    told |= {name: importlib.metadata.version(name) for name in _LIBRARIES}
    return digest(told)


def read(stage: Stage, job: Job) -> dict[str, Any] | None:
    """Read what a former run found, if it is of the same study, code and machine; its times are scaled to this job's factor."""
    try:
        found = json.loads((job.out / f"{stage.name}.json").read_text(encoding="utf-8"))
        if found["key"] != key(stage, job.study):
            return None
        if found["device_factor"] != job.factor:
            found = {**found, "rows": scaled(found["rows"], job.factor / found["device_factor"]), "device_factor": job.factor}
            write(stage, job, found)
    except (OSError, ValueError, KeyError, TypeError):
        return None
    return dict(found)


def write(stage: Stage, job: Job, found: dict[str, Any]) -> None:
    """Write a stage's file and picture; a run that is stopped meanwhile leaves the file of before, or none."""
    path = job.out / f"{stage.name}.json"
    partial = path.with_suffix(".json.partial")
    partial.write_text(json.dumps(found, indent=1, allow_nan=False) + "\n", encoding="utf-8")
    if found["rows"]:
        draw(found["rows"], job.out / f"{stage.name}.png")
    os.replace(partial, path)


def measured(stage: Stage, job: Job) -> dict[str, Any]:
    """Measure one stage, in one thread. Raises DataError when a figure is not finite."""
    with threadpool_limits(1):
        try:
            found = stage.measure(job.study)
        except HandwaveError as error:
            if job.study.scene is None or not stage.scene:
                raise
            found = Found()
            found.leave_out(stage.name, "all", f"the scene does not serve for it: {error}")
    for row in found.rows:
        values = (row["accuracy"]["value"], row["time_ms"]["median"], row["ratio"])
        if not all(abs(value) < float("inf") for value in values):
            raise DataError(f"stage {stage.name}: {row['stage']}, {row['choice']} gave {values}; choose another scene, or report this")
    result = {"stage": stage.name, "key": key(stage, job.study), "quick": job.study.quick, "device_factor": job.factor}
    return {**result, "rows": scaled(found.rows, job.factor), "left_out": found.left_out}


def run(job: Job) -> Iterator[tuple[Stage, bool]]:
    """Measure what is not there yet; yields each stage when its files are there, and whether it was measured now."""
    if job.study.scene is not None:
        load_scene(job.study.scene)
    make_folder(job.out, job.factor)
    job = replace(job, study=replace(job.study, folder=job.out / CACHE))
    for stage in job.stages:
        done = None if job.again else read(stage, job)
        if done is None:
            write(stage, job, measured(stage, job))
        yield stage, done is None


def make_folder(out: Path, factor: float) -> None:
    """Make the folder of results. Raises ConfigError when it cannot be made, or the factor of a device's times is none."""
    if not 0 < factor < float("inf"):
        raise ConfigError(f"--device-factor {factor:g}: give a positive number, e.g. 8 for a device that is eight times slower")
    try:
        out.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise ConfigError(f"{out}: cannot be made ({error.strerror}); choose another folder with -o") from None


def conclude(job: Job, command: str) -> list[str]:
    """Write the report of all stages that the folder has results of; returns panels whose default is beaten without a reason."""
    results = [found for stage in STAGES.values() if (found := read(stage, job)) is not None]
    text = report(results, command=command, quick=job.study.quick, factor=job.factor, note=job.note)
    (job.out / REPORT).write_text(text, encoding="utf-8")
    return [found.panel for found in verdicts([row for result in results for row in result["rows"]]) if found.unexplained]
