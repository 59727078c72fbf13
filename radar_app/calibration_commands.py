"""Commands that calibrate a radar's array, its tilt, and radars to each other."""

from __future__ import annotations

import functools
import json
import os
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import closing
from dataclasses import asdict, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, TypeVar

import typer

from radar_app.parameters import Domain, Json, Namespace, Params, comma_separated, parse_parameters, progress_bar, stopping
from radar_core import ConfigError

if TYPE_CHECKING:
    from radar_core import RadarInfo
    from radar_ros.walks import Follower

F = TypeVar("F", bound="Follower")


def calibrate(
    recordings: Annotated[list[Path], typer.Argument(help="one recording of a turntable, or one per sweep, azimuth first")],
    out: Annotated[Path, typer.Option("--out", "-o", help="file for the calibration (.npz); a picture is drawn beside it")],
    azimuth: Annotated[str | None, typer.Option(help="start:stop:step in degrees; default: turntable.yaml in the recording")] = None,
    elevation: Annotated[str | None, typer.Option(help="the same of the sweep in elevation")] = None,
    dwell: Annotated[float, typer.Option(help="with these: seconds at each angle")] = 1.0,
    settle: Annotated[float, typer.Option(help="with these: seconds at either end of a dwell that are left out")] = 0.0,
    distance: Annotated[float, typer.Option(help="where the reflector stands [m]; 0: the strongest echo")] = 0.0,
    offsets: Annotated[bool, typer.Option("--offsets", help="also fit constant mounting offsets")] = False,
    method: Annotated[str, typer.Option(help="fit; or outer: also the thesis's table of both sweeps")] = "fit",
) -> None:
    """Find gain, phase and position of every channel from a corner reflector on a turntable (docs/how-to/calibration.md).

    Examples: `handwave calibrate chamber -o array.npz` · `handwave calibrate az el -o a.npz --azimuth -60:60:1 --elevation -30:30:1`
    """
    from radar_core.config import load
    from radar_lab.arrays.calibration import Calibration
    from radar_lab.arrays.turntable import sweep_options
    from radar_ros.turntables import calibrate as fit

    chosen = load(Calibration, {"method": method, "distance": distance, "offsets": offsets}, "options")
    report = fit(recordings, out, sweep_options(azimuth, elevation, dwell, settle), chosen)
    print("\n".join(report.lines()))
    print(f"calibration in {out}, ambiguity functions in {out.with_suffix('.png')}")


def turntable(
    out: Annotated[Path, typer.Option(help="folder of the new bag")],
    config: Annotated[Path | None, typer.Option("--config", "-c", help="YAML with the knobs of radar_sim.turntable.Turntable")] = None,
) -> None:
    """Simulate a recording of a corner reflector seen from a turntable by a radar with errors, for `handwave calibrate`."""
    from rich.progress import track

    from radar_core.config import load_file
    from radar_ros.turntables import record_turntable
    from radar_sim.turntable import Turntable, TurntableSimulator

    chosen = load_file(Turntable, config) if config is not None else Turntable()
    total = TurntableSimulator(chosen).n_frames
    done = 0
    with stopping(lambda: f"stopped: {done} of {total} frames in {out}, without a turntable.yaml"):
        for _ in track(record_turntable(chosen, out), total=total, description="turning"):
            done += 1
    print(f"{total} frames in {out}; what the turntable did is in {out / 'turntable.yaml'}")


def calibrate_coupling(
    recording: Annotated[Path, typer.Argument(help="some seconds of raw frames; nobody and nothing within a metre of the radar")],
    out: Annotated[Path, typer.Option("--out", "-o", help="file with the baseband's knobs (.yaml)")],
    seconds: Annotated[float, typer.Option(help="of the recording's beginning that are used", min=0.1, max=3600.0)] = 5.0,
    as_json: Json = False,
) -> None:
    """Measure how far a radar hears itself, and suppress that much (docs/how-to/calibration.md).

    The file goes to the graph: `handwave up live --config baseband=coupling.yaml`.

    Example: `handwave calibrate-coupling empty -o coupling.yaml`
    """
    import yaml

    from radar_core.files import write_whole
    from radar_dsp import BasebandConfig
    from radar_dsp.coupling import measure_leakage
    from radar_ros.offline import open_recording, raw_frames

    opened = open_recording(recording)
    found = measure_leakage(raw_frames(opened, seconds), BasebandConfig(), opened.info)
    chosen = {"range_extent": round(found.config.range_extent, 4), "speed_extent": round(found.config.speed_extent, 4)}
    write_whole(out, yaml.safe_dump({"coupling": chosen}))
    if as_json:
        print(
            json.dumps(
                {"level_db": found.level, "range_m": found.range_extent, "speed_mps": found.speed_extent, "frames": found.n_frame, **chosen}
            )
        )
        return
    reach = f"{found.level:.0f} dB above the noise, up to {found.range_extent:.2f} m and {found.speed_extent:.2f} m/s"
    print(f"leakage in {found.n_frame} frames: {reach if found.range_extent else 'none'}; knobs in {out}")


def calibrate_pair(
    out: Annotated[Path, typer.Option("--out", "-o", help="file for the second radar's mount (.yaml)")],
    bag: Annotated[Path | None, typer.Argument(help="recording of both radars; left out: listen to the running graph")] = None,
    radars: Annotated[str, typer.Option(help="namespaces: the radar whose mount is taken as it is, the one to calibrate")] = "left,right",
    duration: Annotated[float, typer.Option(help="running graph: seconds to listen; Ctrl-C ends it sooner", min=2.0, max=3600.0)] = 60.0,
    config: Annotated[Path | None, typer.Option("--config", "-c", help="YAML with knobs of radar_lab.alignment.pair.PairConfig")] = None,
    picture: Annotated[Path | None, typer.Option(help="also draw both trajectories, before and after (.png)")] = None,
    as_json: Json = False,
    param: Params = None,
    domain: Domain = None,
    namespace: Namespace = "",
) -> None:
    """Find where the second radar stands, from one person who walks before both for a minute (docs/how-to/calibration.md).

    Walk alone, 1 to 5 m in front of the radars, to and fro and across, where both see you. Height and tilt are taken as given. The file
    goes to the drivers: `handwave up two_radars --param driver.calibration=right.yaml`. Raw frames of a recording go through basebands that
    take parameters as in the graph: `--param left/baseband.calibration=left.npz`.

    Examples: `handwave calibrate-pair walk -o right.yaml --picture walk.png` · `handwave calibrate-pair -o right.yaml --duration 60`
    """
    from radar_core.config import load_file
    from radar_lab.alignment.pair import PairConfig, Walker, draw, rows
    from radar_lab.alignment.pair import as_json as report
    from radar_lab.alignment.pair import calibrate_pair as fit

    names = comma_separated(radars)
    if len(names) != 2 or names[0] == names[1]:
        raise ConfigError(f"--radars {radars!r}: name two radars, e.g. left,right")
    chosen = load_file(PairConfig, config) if config is not None else PairConfig()
    parameters = parse_parameters(param)
    first, second = _followers(bag, names, functools.partial(Walker, chosen), "walk now", duration, parameters, as_json, domain, namespace)
    result = fit(first, second, chosen)
    result.mount.save(out)
    if picture is not None:
        draw(result, picture)
    if as_json:
        print(json.dumps(report(result)))
        return
    _show(f"{result.mount.radar}, beside {result.mount.reference}", rows(result), result.notes())
    print(f"mount in {out}" + (f", picture in {picture}" if picture is not None else ""))


def calibrate_tilt(
    out: Annotated[Path, typer.Option("--out", "-o", help="file for the radar's mount (.yaml)")],
    bag: Annotated[Path | None, typer.Argument(help="recording; left out: listen to the running graph")] = None,
    radar: Annotated[str, typer.Option(help="its namespace, where there are several")] = "",
    activity: Annotated[str, typer.Option(help="what the person does: walk about, or stand and move their arms")] = "walk",
    height: Annotated[float | None, typer.Option(help="of the radar above the floor [m]; default: as its driver says")] = None,
    duration: Annotated[float, typer.Option(help="running graph: seconds to listen; Ctrl-C ends it sooner", min=2.0, max=3600.0)] = 30.0,
    as_json: Json = False,
    param: Params = None,
    domain: Domain = None,
    namespace: Namespace = "",
) -> None:
    """Find how far a radar is tilted, from one person who moves before it for half a minute (docs/how-to/calibration.md).

    Let one person walk about alone, 1 to 5 m in front of the radar, or stand and move their arms (`--activity arms`). Where the tilt is
    wrong people seem to float, and they and their gestures are lost. Measure the height with a tape. The file goes to the driver:
    `handwave up --param driver.calibration=mount.yaml`. Raw frames of a recording go through a baseband that takes parameters as in the
    graph: `--param baseband.calibration=array.npz`.

    Examples: `handwave calibrate-tilt -o mount.yaml` · `handwave calibrate-tilt walk -o mount.yaml --height 1.4`
    """
    from radar_core.config import load
    from radar_core.mounting import MountCalibration
    from radar_lab.alignment.tilt import TiltConfig, TiltFinder, rows

    chosen = load(TiltConfig, {"activity": activity}, "options")

    def follow(info: RadarInfo) -> TiltFinder:
        return TiltFinder(chosen, info if height is None else replace(info, mount=replace(info.mount, z=height)))

    doing = "walk now" if activity == "walk" else "move your arms now"
    (finder,) = _followers(bag, [radar], follow, doing, duration, parse_parameters(param), as_json, domain, namespace)
    result = finder.result()
    MountCalibration(radar=result.radar, mount=result.mount, tilt_std=result.std).save(out)
    if as_json:
        print(json.dumps({**asdict(result), "notes": result.notes()}))
        return
    _show(f"{result.radar}: {activity}", rows(result), result.notes())
    print(f"mount in {out}")


def _followers(
    bag: Path | None,
    names: Sequence[str],
    follow: Callable[[RadarInfo], F],
    doing: str,
    duration: float,
    parameters: Mapping[str, Mapping[str, object]],
    quiet: bool,
    domain: int | None,
    namespace: str,
) -> tuple[F, ...]:
    """Follow the person with each radar, in a recording or, where there is none, in the running graph."""
    from radar_app.supervisor import environment
    from radar_ros.interrupts import ros
    from radar_ros.walks import Listener, from_bag

    with progress_bar("reading" if bag is not None else doing, quiet=quiet) as progress:
        if bag is not None:
            return from_bag(bag, names, follow, progress, parameters)
        if parameters:
            raise ConfigError("--param sets the baseband of a recording; a running graph has its own")
        os.environ.update(environment(domain))
        with ros(), closing(Listener(names, follow, namespace)) as listener:
            return listener.listen(duration, progress)


def _show(title: str, rows: Iterable[tuple[str, str, str]], notes: Sequence[str]) -> None:
    from rich.console import Console
    from rich.table import Table

    table = Table("", "measured", "standard deviation", title=title)
    for row in rows:
        table.add_row(*row)
    console = Console()
    console.print(table)
    for note in notes:
        console.print(f"note: {note}", markup=False, highlight=False)
