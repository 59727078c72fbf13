"""Commands that calibrate radars to each other."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from radar_core import ConfigError

if TYPE_CHECKING:
    from radar_lab.alignment.pair import PairCalibration, PairConfig, Walker


def calibrate_pair(
    out: Annotated[Path, typer.Option("--out", "-o", help="file for the second radar's mount (.yaml)")],
    bag: Annotated[Path | None, typer.Argument(help="recording of both radars; left out: listen to the running graph")] = None,
    radars: Annotated[str, typer.Option(help="namespaces: the radar whose mount is taken as it is, the one to calibrate")] = "left,right",
    duration: Annotated[float, typer.Option(help="running graph: seconds to listen; Ctrl-C ends it sooner", min=2.0, max=3600.0)] = 60.0,
    config: Annotated[Path | None, typer.Option("--config", "-c", help="YAML with knobs of radar_lab.alignment.pair.PairConfig")] = None,
    picture: Annotated[Path | None, typer.Option(help="also draw both trajectories, before and after (.png)")] = None,
    as_json: Annotated[bool, typer.Option("--json", help="print one JSON object")] = False,
    domain: Annotated[int | None, typer.Option(help="ROS domain; default: ROS_DOMAIN_ID, else 0", min=0, max=232)] = None,
    namespace: Annotated[str, typer.Option(help="namespace of the graph")] = "",
) -> None:
    """Find where the second radar stands, from one person who walks before both for a minute (docs/calibration.md).

    Walk alone, 1 to 5 m in front of the radars, to and fro and across, where both see you. Height and tilt are taken as given. The file
    goes to the drivers: `handwave up two_radars --param driver.calibration=right.yaml`.

    Examples: `handwave calibrate-pair walk -o right.yaml --picture walk.png` · `handwave calibrate-pair -o right.yaml --duration 60`
    """
    from radar_app.calibrate_pair import draw, rows
    from radar_core.config import load_file
    from radar_lab.alignment.pair import PairConfig
    from radar_lab.alignment.pair import calibrate_pair as fit

    names = [name.strip() for name in radars.split(",") if name.strip()]
    if len(names) != 2 or names[0] == names[1]:
        raise ConfigError(f"--radars {radars!r}: name two radars, e.g. left,right")
    settings = load_file(PairConfig, config) if config is not None else PairConfig()
    first, second = _follow(bag, names, settings, duration, domain, namespace, quiet=as_json)
    result = fit(first, second, settings)
    result.mount.save(out)
    if picture is not None:
        draw(result, picture)
    if as_json:
        print(json.dumps(_plain(result)))
        return
    from rich.console import Console
    from rich.table import Table

    table = Table("", "measured", "standard deviation", title=f"{result.mount.radar}, beside {result.mount.reference}")
    for row in rows(result):
        table.add_row(*row)
    console = Console()
    console.print(table)
    for note in result.notes():
        console.print(f"note: {note}", markup=False, highlight=False)
    console.print(f"mount in {out}" + (f", picture in {picture}" if picture is not None else ""), markup=False, highlight=False)


def _follow(
    bag: Path | None, names: list[str], settings: PairConfig, duration: float, domain: int | None, namespace: str, *, quiet: bool
) -> tuple[Walker, Walker]:
    """Take in a recording or a running graph, with progress on the terminal."""
    import os

    from rich.console import Console
    from rich.progress import Progress

    from radar_app.calibrate_pair import Listener, from_bag
    from radar_app.supervisor import environment
    from radar_ros.interrupts import ros

    with Progress(console=Console(stderr=True), disable=quiet) as bar:
        task = bar.add_task("reading" if bag is not None else "walk now", total=1.0)

        def progress(share: float) -> None:
            bar.update(task, completed=share)

        if bag is not None:
            return from_bag(bag, names, settings, progress)
        os.environ.update(environment(domain))
        with ros():
            listener = Listener(names, settings, namespace)
            try:
                return listener.listen(duration, progress)
            finally:
                listener.close()


def _plain(result: PairCalibration) -> dict[str, object]:
    from radar_core.config import plain

    found = result.alignment
    return {
        **plain(result.mount),
        "std": dict(zip(("x", "y", "yaw"), result.std, strict=True)),
        "pairs": found.pairs,
        "n_effective": found.n_effective,
        "correlation_time": found.correlation_time,
        "inlier_share": found.inlier_share,
        "rms": found.rms,
        "condition": found.condition,
        "seconds": result.seconds,
        "height_difference": result.height_difference,
        "notes": result.notes(),
    }
