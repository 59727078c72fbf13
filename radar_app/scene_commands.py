"""Commands about scenes: list, explain, simulate."""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from radar_app.parameters import Json, stopping
from radar_core import ConfigError

if TYPE_CHECKING:
    from radar_sim.audit import Explanation


def scenes() -> None:
    """List the scenes that come with Handwave."""
    from radar_core.paths import share_dir

    for path in sorted((share_dir() / "config" / "scenes").glob("*.yaml")):
        first = path.read_text(encoding="utf-8").splitlines()[0]
        print(f"{path.stem:16} {first.lstrip('# ') if first.startswith('#') else ''}")


def explain(
    scene: Annotated[str, typer.Argument(help="scene file, or one of ours by name")] = "",
    radar: Annotated[str, typer.Option(help="which radar of the scene, e.g. left; default: the first")] = "",
    everywhere: Annotated[bool, typer.Option("--all", help="every effect in each of our scenes, under effects: auto")] = False,
    as_json: Json = False,
) -> None:
    """Show for every effect whether the scene names it, how large it is (or would be), what it changes and what it costs.

    "change" is the rms of what the effect changes in the samples, relative to the echoes. An effect that is missing and changes more than
    the scene's `tolerance` is warned about; `effects: auto` in a scene names those that every room and radar has.

    Examples: `handwave explain demo` · `handwave explain two_radars --radar left --json` · `handwave explain --all`
    """
    from rich.progress import track

    from radar_sim import load_scene

    if bool(scene) == everywhere:
        raise ConfigError("explain: name one scene, e.g. demo, or give --all for a table of our scenes")
    if everywhere:
        _audit(as_json)
        return
    from radar_sim.audit import Explainer, Explanation
    from radar_sim.effects.chain import NAMES

    explainer = Explainer(load_scene(scene), radar)
    reports = tuple(explainer.process(name) for name in track(NAMES, "measuring effects", disable=as_json, transient=True))
    result = Explanation(explainer.scene, reports, explainer.reasons)
    if as_json:
        rows = [dataclasses.asdict(report) for report in result.effects]
        print(json.dumps({"effects": rows, "reasons": result.reasons, "tolerance": result.scene.tolerance}))
    else:
        _show(result)


def _audit(as_json: bool) -> None:
    from rich.progress import track

    from radar_sim.audit import audit, ours, table

    audits = [audit(*one) for one in track(list(ours()), "measuring effects", disable=as_json, transient=True)]
    if as_json:
        print(json.dumps({a.label: {f.name: dataclasses.asdict(f) for f in a.findings} for a in audits}))
    else:
        print(table(audits), end="")


def _show(result: Explanation) -> None:
    from rich.console import Console
    from rich.table import Table

    table = Table("effect", "", "size", "change", "ms a frame", title=f"tolerance {result.scene.tolerance:g}")
    for report in result.effects:
        mark = "on" if report.on else "[yellow]missing[/]" if report.warning else "off"
        table.add_row(report.name, mark, report.size, f"{report.change:.2g}", f"{report.cost_ms:.2f}")
    console = Console()
    console.print(table)
    for reason in result.reasons:
        console.print(f"auto: {reason}", markup=False, highlight=False)
    for report in result.effects:
        if report.warning:
            console.print(f"{report.name} is {report.warning}", markup=False, highlight=False)


def simulate(
    scene: Annotated[str, typer.Argument(help="scene file, or one of ours by name")],
    out: Annotated[Path, typer.Option("--out", "-o", help="folder of the new bag")],
    preview: Annotated[Path | None, typer.Option(help="also draw bodies, range-Doppler map and micro-Doppler: .mp4 or .png")] = None,
) -> None:
    """Simulate a scene into a bag of raw frames with truth, without a graph, as fast as the machine can.

    Every radar of the scene gets its own topics; the scene as it was simulated, with the effects that `effects: auto` chose, is in
    scene.yaml beside the bag's files. A run that is stopped leaves a bag that can be read up to there.

    Examples: `handwave simulate demo -o my_demo` · `handwave simulate handshake -o shake --preview shake.mp4`
    """
    from rich.progress import track

    from radar_ros.offline import simulate as frames
    from radar_ros.offline import simulators

    radars = simulators(scene)
    if preview is not None:
        from radar_app.preview import check, draw

        check(radars[0], preview)
    total, done = sum(radar.n_frames for radar in radars), 0
    with stopping(lambda: f"stopped: {done} of {total} frames in {out}"):
        for _ in track(frames(radars, out), total=total, description=f"simulating {scene}"):
            done += 1
    print(f"{total} frames in {out}")
    if preview is not None:
        with stopping(lambda: f"stopped: no preview; {total} frames in {out}"):
            draw(radars[0], preview)
        print(f"preview in {preview}")
