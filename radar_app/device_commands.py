"""Commands about boards: what is plugged in, and how well it works."""

from __future__ import annotations

import json
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from radar_app.parameters import Json, progress_bar
from radar_core import ConfigError, DataError, RadarFrame

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from radar_driver.boards import Board, Found
    from radar_driver.health import Probe
    from radar_driver.sources import Source

_COLOURS = {"ok": "green", "warn": "yellow", "fail": "red", "-": "dim"}
_FITS = "the radar gives what the gesture model that comes with Handwave needs"
_OTHER = "the radar gives less than the thirteen features need, so the networks on streams name most gestures (gestures.model: auto):"
_STATUS = {"ok": 0, "-": 0, "warn": 1, "fail": 2}


def devices(
    boards: Annotated[bool, typer.Option("--boards", help="list every board that is known, with its knobs, plugged in or not")] = False,
    as_json: Json = False,
) -> None:
    """List the boards that are plugged in, how to use each, and what is in the way.

    Looking changes nothing on a board, and another program may be using it meanwhile. The exit status is 0 when a board is there that can
    be used, 1 when there is none. Boards of other Python packages are found too (docs/how-to/adding-a-board.md).

    Examples: `handwave devices` · `handwave devices --boards` · `handwave devices --json`
    """
    registry = _registry()
    known, broken = registry.boards(), registry.broken()
    if boards:
        _list_known(known, broken, as_json)
        return
    found = [one for board in known.values() for one in _look(board)]
    if as_json:
        rows = [{"board": f.board, "address": f.address, "options": dict(f.options), "problem": f.problem, "use": _use(f)} for f in found]
        print(json.dumps({"devices": rows, "broken": dict(broken)}))
    else:
        _show_found(found, known, broken)
    if all(one.problem for one in found):
        raise typer.Exit(1)


def _registry() -> Any:
    """Give the registry of all sources: those of `radar_driver.boards`, and recordings, which register themselves."""
    import radar_ros.bag_source  # noqa: F401
    from radar_driver import boards

    return boards


def _look(board: Board) -> Sequence[Found]:
    """List the devices of one kind; whatever goes wrong is this board's problem alone."""
    from radar_driver.boards import Found

    try:
        return board.find() if board.find is not None else ()
    except Exception as error:  # a board may be somebody else's code, and its libraries may be missing
        return [Found(board.name, "?", {}, f"looking for it failed: {type(error).__name__}: {error}")]


def _use(found: Found) -> str:
    """Give the command that starts a graph with a device."""
    from radar_driver.boards import board

    words = [f"handwave up {board(found.board).variant} --param driver.source={found.board}"]
    return " ".join(words + [f"--param driver.{found.board}.{name}={value}" for name, value in found.options.items()])


def _show_found(found: Sequence[Found], known: Mapping[str, Board], broken: Mapping[str, str]) -> None:
    from rich.console import Console

    console = Console(highlight=False, soft_wrap=True)
    for one in found:
        console.print(f"{one.board}: {one.address}", style="bold", markup=False)
        if one.problem:
            console.print(f"  problem: {one.problem}", style="yellow", markup=False)
        else:
            knobs = "".join(f" --set {name}={value}" for name, value in one.options.items())
            console.print(f"  check:   handwave probe {one.board}{knobs}\n  use:     {_use(one)}", markup=False)
    for name, reason in broken.items():
        console.print(f"{name}: {reason}", style="yellow", markup=False)
    if not found:
        console.print("No board is plugged in, or none that answers. Looked for:")
        for board in known.values():
            if board.find is not None:
                console.print(f"  {board.name}: {board.title}", markup=False)
        console.print(
            "Check the cable (some carry power only), the power supply, and that the board starts its program, not its flash loader.\n"
            "On a network? Such boards are not looked for: name them (handwave devices --boards lists the knobs).\n"
            "Without a board: handwave demo, or handwave probe sim."
        )


def _list_known(known: Mapping[str, Board], broken: Mapping[str, str], as_json: bool) -> None:
    from rich.console import Console
    from rich.table import Table
    from rich.text import Text

    from radar_driver.boards import GIVES

    if as_json:
        told = [("board", "name"), ("title", "title"), ("clouds", "clouds"), ("graph", "variant")]
        rows = [{key: getattr(b, name) for key, name in told} | {"knobs": _knobs(b.config)} for b in known.values()]
        print(json.dumps({"boards": rows, "broken": dict(broken)}))
        return
    console = Console(highlight=False)
    for board in known.values():
        title = Text(f"{board.name}: {board.title}; gives {GIVES[board.variant]}", style="bold")
        table = Table("knob", "default", "unit", "meaning", title=title, title_justify="left")
        for knob in _knobs(board.config):
            table.add_row(*(Text(word) for word in (knob["name"], json.dumps(knob["default"]), knob["unit"], knob["doc"])))
        console.print(table)
    for name, reason in broken.items():
        console.print(f"{name}: {reason}", style="yellow", markup=False)
    console.print(
        "In a graph a knob is a parameter of the driver: --param driver.BOARD.KNOB=value (of sim and bag: --param driver.KNOB=value); "
        "in handwave probe: --set KNOB=value.",
        markup=False,
    )


def _knobs(config: type) -> list[dict[str, Any]]:
    from dataclasses import MISSING

    from radar_core.config import describe

    fields = [(name, None if field.default is MISSING else field.default, field.metadata) for name, field, _ in describe(config)]
    return [{"name": name, "default": default, "unit": told.get("unit", ""), "doc": told.get("doc", "")} for name, default, told in fields]


def probe(
    board: Annotated[str, typer.Argument(help="a board (see: handwave devices), sim, bag; or raw frames: a .npy, a recording")] = "",
    own: Annotated[str, typer.Option("--board", help="the same, or a Python file with a board of your own")] = "",
    knobs: Annotated[list[str] | None, typer.Option("--set", "-s", help="knob=value of the board; may be repeated")] = None,
    scene: Annotated[str | None, typer.Option(help="of sim: scene file, or one of ours by name")] = None,
    duration: Annotated[float, typer.Option(help="how long to listen [s]", min=0.5, max=3600.0)] = 5.0,
    waveform: Annotated[str, typer.Option(help="of a .npy: YAML file with the Waveform")] = "",
    array: Annotated[str, typer.Option(help="of a .npy: YAML file with the AntennaArray")] = "",
    axes: Annotated[str, typer.Option(help="of a .npy, in its order (docs/reference/recordings.md)")] = "frame tx chirp rx sample",
    walked: Annotated[
        str, typer.Option(help="of raw frames: left or right, to which side of the radar's view somebody walks in them")
    ] = "",
    limit: Annotated[list[str] | None, typer.Option(help="limit=value (radar_driver.health.HealthConfig); may be repeated")] = None,
    as_json: Json = False,
) -> None:
    """Check a board's health: link, temperature, noise floor, coupling, saturation, frame rate, losses; each with plain advice.

    Nobody else may use the board meanwhile: stop the graph first. For a board that gives point clouds: points per cloud and SNR instead of
    noise floor, coupling and saturation. Point the radar at a still room for figures that can be compared.

    Of raw frames in a file: what is probably wrong with them (order of axes, transmitters or chirps, I and Q, format, frames stitched
    together), named from the data alone; somebody should walk towards the radar or away from it, with furniture in view. Mirrored angles
    cannot be told so: record a walk across the view, and say to which side it went (`--walked left`, as the radar looks).

    The exit status is 0 when all is well, 1 when something deserves a look, 2 when something failed, or the command makes no sense.

    Examples: `handwave probe sim` · `handwave probe sim --scene five_people` · `handwave probe ti_demo --set port=/dev/ttyACM1`
    · `handwave probe cube.npy --waveform w.yaml --array a.yaml`
    """
    from radar_core.config import load, nest
    from radar_driver.health import HealthConfig
    from radar_driver.health import probe as listen
    from radar_gestures.classifiers.model import load_model
    from radar_gestures.needs import lacks, needs

    board = board or own
    if not board:
        raise ConfigError("say what to probe: a board (handwave devices lists them), or --board my_board.py")
    if walked not in ("", "left", "right"):
        raise ConfigError(f"--walked {walked!r}: say left or right, as the radar looks")
    if board.endswith(".npy") or (Path(board) / "metadata.yaml").is_file():
        raise typer.Exit(_probe_frames(Path(board), waveform, array, axes, walked, as_json))
    if walked:
        raise ConfigError("--walked is for raw frames: a .npy or a recording")
    limits = load(HealthConfig, nest(_parse(limit, "--limit")), "--limit")
    if scene is not None and board != "sim":
        raise ConfigError(f"--scene is for sim; for {board} give --set knob=value (handwave devices --boards lists the knobs)")
    given = {**({} if scene is None else {"scene": scene}), **_parse(knobs, "--set")}
    chosen = _registry().board(board)
    source: Source = chosen.source(load(chosen.config, nest(given), "--set"))
    with progress_bar(f"listening to {board}", quiet=as_json, transient=True) as progress:
        found = listen(source, duration, config=limits, progress=progress)
    lacking = lacks(needs(load_model("gestures")), source.info)
    if as_json:
        told = ("value", "unit", "text", "advice")
        checks = [{"check": c.name, "verdict": c.verdict.value, **{key: getattr(c, key) for key in told}} for c in found.checks]
        said = {"board": board, "verdict": found.verdict.value, "checks": checks, "report": found.report, "gestures": lacking}
        print(json.dumps(said, default=str))
    else:
        _show(board, found)
        print("\n  ".join([_OTHER, *lacking]) if lacking else _FITS)
    raise typer.Exit(_STATUS[found.verdict.value])


def _probe_frames(path: Path, waveform: str, array: str, axes: str, walked: str, as_json: bool) -> int:
    """Say what is probably wrong with raw frames in a file; 1: something is."""
    import numpy as np

    from radar_lab.cube_faults import name_fault
    from radar_lab.importers.npy import NpyOptions, open_described, to_frames
    from radar_ros.offline import open_recording

    if path.suffix == ".npy":
        data, info = open_described(path, NpyOptions(waveform=waveform, array=array, axes=axes))
        frames: Any = (frame.cube for frame in to_frames(data, axes, info))
        if axes == NpyOptions().axes and data.ndim == 5 and np.iscomplexobj(data):
            frames = data  # also where the order of the axes is what is wrong
    else:
        recording = open_recording(path)
        info, frames = recording.info, (item.cube for _, item in recording.messages() if isinstance(item, RadarFrame))
    first = list(islice(frames, 64))
    if not first:
        raise DataError(f"{path} holds no raw frames")
    cubes = np.stack(first).astype(np.complex64)
    fault = name_fault(cubes, info)
    if fault is None and walked:
        from radar_lab.mirrored_angle import name_mirrored

        fault = name_mirrored(cubes, info, "left" if walked == "left" else "right")
    if as_json:
        print(json.dumps({"frames": len(cubes), "fault": fault and fault._asdict()}))
    else:
        said = "nothing speaks against these frames" if fault is None else f"{fault.name}: {fault.reason}\n  what to do: {fault.remedy}"
        print(f"{path}, {len(cubes)} frames: {said}")
    return int(fault is not None)


def _parse(given: list[str] | None, option: str) -> dict[str, Any]:
    """Read ``name=value``; a `ConfigError` says that one is not of that form."""
    from radar_core.yaml_text import read_yaml

    result: dict[str, Any] = {}
    for text in given or []:
        name, equals, value = text.partition("=")
        if not (name and equals):
            raise ConfigError(f"{option} {text!r}: write knob=value, e.g. {option} port=/dev/ttyACM1")
        parsed = read_yaml(value, f"{option} {text!r}")
        result[name] = "" if parsed is None else parsed
    return result


def _show(board: str, found: Probe) -> None:
    from rich.console import Console
    from rich.table import Table
    from rich.text import Text

    table = Table("check", "measured", "", "what to do", title=f"health of {board}", title_justify="left")
    for check in found.checks:
        mark = Text(check.verdict.value, style=_COLOURS[check.verdict.value])
        table.add_row(Text(check.name), Text(check.text), mark, Text(check.advice))
    console = Console(highlight=False)
    console.print(table)
    if known := ", ".join(f"{key} {value}" for key, value in found.report.items() if value not in ("", None)):
        console.print(f"the board says: {known}", markup=False)
