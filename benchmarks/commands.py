"""`handwave tradeoff`: what accuracy costs in time."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from radar_core import HandwaveError

if TYPE_CHECKING:
    from benchmarks.tradeoff.run import Job
    from benchmarks.tradeoff.stages import StudyConfig


def tradeoff(
    out: Annotated[Path, typer.Option("--out", "-o", help="folder for the report, JSON files and plots; may hold those of a former run")],
    stage: Annotated[list[str] | None, typer.Option(help="measure only this stage, e.g. detection; may be repeated")] = None,
    scene: Annotated[str | None, typer.Option(help="scene file, or one of ours by name, for the stages that simulate a room")] = None,
    device_factor: Annotated[
        float, typer.Option(help="multiply all times by this: 8 shows what a device takes that is eight times slower")
    ] = 1.0,
    quick: Annotated[bool, typer.Option("--quick", help="little data: some minutes; to see that it runs, not for quoting")] = False,
    again: Annotated[bool, typer.Option("--again", help="measure anew what the folder has already")] = False,
    seed: Annotated[int, typer.Option(help="of everything random", min=0)] = 1,
    domain: Annotated[int | None, typer.Option(help="ROS domain of stage graph; default: ROS_DOMAIN_ID, else 0", min=0, max=232)] = None,
    note: Annotated[str, typer.Option(help="a sentence for the head of the report")] = "",
    tune: Annotated[
        bool, typer.Option("--tune", help="instead: measure the levels that nodes with frame_budget_ms choose from (docs/how-to/budget.md)")
    ] = False,
    small: Annotated[
        bool,
        typer.Option("--small", help="with --tune: levels from the default down, frames left out last, as those of up --small"),
    ] = False,
) -> None:
    """Measure accuracy and time of every choice that buys one with the other, and say which are worth it.

    Stages: simulator, transforms, detection, directions, clustering, tracking, radar, hand, gestures, budget, graph, chain. Each is judged
    by its own truth (error against float64, detections at a fixed false-alarm rate, errors over the Cramer-Rao bound, GOSPA, gestures of
    people left out, distance from the true hand) and timed in one thread beside a bare reference, in turn with it.

    The folder gets STAGE.json and STAGE.png for each (dominated choices grey, the default with a ring), and report.md. A stage that is
    finished is not measured again while configuration, code and versions stay the same, so a run that was stopped goes on where it was.

    With --tune it measures, once for each machine, what nodes with a time budget may choose from: levels.json and levels.png. Then
    `handwave up --param baseband.frame_budget_ms=4 --param baseband.budget.tuning=FOLDER/levels.json` keeps the baseband within 4 ms.

    Examples: `handwave tradeoff -o report --quick` · `handwave tradeoff -o report --stage detection --stage chain` ·
    `handwave tradeoff -o mine --scene my_room.yaml --device-factor 8` · `handwave tradeoff --tune -o levels`
    """
    from benchmarks.tradeoff.run import Job
    from benchmarks.tradeoff.stages import StudyConfig, chosen

    study = StudyConfig(out, quick, seed, scene, domain)
    if tune:
        _tune(study, device_factor, small)
        return
    _measure(Job(out, study, chosen(tuple(stage or ())), device_factor, again, note), _command(stage, scene, device_factor, quick))


def _tune(study: StudyConfig, factor: float, small: bool) -> None:
    """Measure the levels of all stages that have some, write them, and show them as a table."""
    from rich.console import Console
    from rich.table import Table

    from benchmarks.tradeoff.run import make_folder
    from benchmarks.tradeoff.tune import LEVELS, tune, write

    make_folder(study.folder, factor)
    found = tune(study, factor, small=small)
    write(study.folder, found)
    table = Table("", "level", f"{found[0].ladder.figure} [m]", "ms a frame", "ms for each frame of the radar", title="levels")
    for stage in found:
        for number, level in enumerate(stage.ladder.levels):
            name = stage.ladder.stage if number == 0 else ""
            table.add_row(name, level.name, f"{level.accuracy:.4f}", f"{level.time_ms:.3f}", f"{level.cost_ms:.3f}")
    Console().print(table)
    print(f"levels in {study.folder / LEVELS}; give it to nodes as budget.tuning, beside frame_budget_ms")


def _command(stage: list[str] | None, scene: str | None, factor: float, quick: bool) -> str:
    """Write down what was asked for; the folder is left out, because it says nothing."""
    words = ["handwave tradeoff", *(f"--stage {name}" for name in stage or ())]
    words += [f"--scene {Path(scene).name}"] if scene else []
    words += [f"--device-factor {factor:g}"] if factor != 1.0 else []
    return " ".join([*words, *(["--quick"] if quick else [])])


def _measure(job: Job, command: str) -> None:
    """Run a job with a progress bar; Ctrl-C leaves what is finished, with a report of it."""
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, SpinnerColumn, TextColumn, TimeElapsedColumn

    from benchmarks.tradeoff.run import REPORT, conclude, run
    from radar_ros.signals import stopped

    console, names = Console(), [stage.name for stage in job.stages]
    columns = (SpinnerColumn(), TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn())
    done: list[str] = []
    try:
        with Progress(*columns, console=console, transient=True) as progress:
            task = progress.add_task(f"measuring {names[0]}", total=len(names))
            for stage, now in run(job):
                done.append(stage.name)
                progress.console.print(f"{stage.name}: {'measured' if now else 'was there already'}")
                following = names[len(done)] if len(done) < len(names) else "done"
                progress.update(task, completed=len(done), description=f"measuring {following}")
    except KeyboardInterrupt:
        if done:
            conclude(job, command)
        print(f"stopped: {len(done)} of {len(names)} stages are in {job.out}; the same command goes on from there")
        raise typer.Exit(stopped()) from None
    except HandwaveError:
        if done:
            conclude(job, command)
        raise
    unexplained = conclude(job, command)
    print(f"report in {job.out / REPORT}")
    if unexplained:
        print(f"defaults that are beaten, and nobody says why: {', '.join(unexplained)} (benchmarks/tradeoff/document.py)")
        if not job.study.quick:
            raise typer.Exit(1)
