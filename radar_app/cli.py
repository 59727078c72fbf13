"""The `handwave` command."""

from __future__ import annotations

import importlib.metadata
import json
import sys
from contextlib import closing
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Annotated, Any

import typer
from typer.core import TyperGroup

from radar_app import (
    blender_commands,
    calibration_commands,
    camera_commands,
    dataset_commands,
    device_commands,
    doctor_commands,
    gesture_commands,
    scene_commands,
    training_commands,
    view_commands,
    watch_commands,
)
from radar_app.compiling import compile_loops
from radar_app.exits import Ended, finish
from radar_app.parameters import (
    Configs,
    Domain,
    Namespace,
    Params,
    ZonesFile,
    comma_separated,
    merged,
    parse_parameters,
    stopping,
    zone_parameters,
)
from radar_core import ConfigError, HandwaveError
from radar_ros.signals import stopped

_GRAPH, _WATCH, _BAGS, _SETUP, _MORE = "Run a graph", "Watch it", "Recordings", "Set up", "More"


class Commands(TyperGroup):
    """The commands; signals and faults of files reach `radar_app.exits.finish`."""

    def invoke(self, ctx: Any) -> Any:
        """Run the command that was chosen."""
        try:
            return super().invoke(ctx)
        except (KeyboardInterrupt, OSError) as error:
            raise Ended from error


app = typer.Typer(
    cls=Commands,
    no_args_is_help=True,
    rich_markup_mode="markdown",
    pretty_exceptions_enable=False,
    help="Touchless interface from mmWave radar: people, arm gestures and a hand, as ROS 2 nodes.\n\n"
    "Start with `handwave demo`: a simulated room, everything running, a report at the end.",
)


def main() -> None:
    """Run the command; `radar_app.exits` says how it ends."""
    finish(partial(app, prog_name="handwave"))


def _version(wanted: bool) -> None:
    if wanted:
        print(f"handwave {importlib.metadata.version('handwave')}")
        raise typer.Exit


@app.callback()
def _options(
    version: Annotated[bool, typer.Option("--version", callback=_version, is_eager=True, help="print the version")] = False,
) -> None:
    """Take the options that stand before a command."""


@app.command(rich_help_panel=_GRAPH)
def demo(
    scene: Annotated[str, typer.Option(help="scene file, or one of ours by name (see: handwave scenes)")] = "demo",
    duration: Annotated[float | None, typer.Option(help="end after so many seconds", min=1.0)] = None,
    bag: Annotated[Path | None, typer.Option(help="folder of the recording; default: out/demo, with a number if it exists")] = None,
    headless: Annotated[bool, typer.Option("--headless", help="plain lines instead of the live display")] = False,
    as_json: Annotated[bool, typer.Option("--json", help="print the report as one JSON object")] = False,
    verbose: Annotated[bool, typer.Option("--verbose", help="show the nodes' logs")] = False,
    zones: ZonesFile = None,
    domain: Domain = None,
    namespace: Namespace = "",
) -> None:
    """Run the whole graph on a simulated room, watch it live, and compare what it recognised with the truth.

    Every node is a process of its own; everything is recorded into an MCAP bag.

    Examples: `handwave demo` · `handwave demo --scene one_user --headless` · `handwave demo --duration 20 --bag my_recording`
    """
    from rich.console import Console

    from radar_app.fork_server import fork_server_of

    with fork_server_of("demo") as fork_server:  # first: it loads what nodes need while this process loads what it needs
        from radar_app.demo import DemoOptions, run_demo, show_report

        console = Console(stderr=as_json)
        report = run_demo(DemoOptions(scene, duration, bag, headless, domain, namespace, verbose, zones), console, fork_server)
    if as_json:
        print(json.dumps(report))
    else:
        show_report(report, console)
    if report["crashes"] or report["missing"]:
        raise typer.Exit(1)
    if report["interrupted"]:
        raise typer.Exit(stopped())


@app.command(rich_help_panel=_GRAPH)
def up(
    variant: Annotated[
        str, typer.Argument(help="live, clouds, targets, cloud2, demo, two_radars, replay, camera (docs/reference/graph.md); or rooms.yaml")
    ] = "",
    board: Annotated[str | None, typer.Option(help="where frames come from: a board, or a Python file with one of your own")] = None,
    scene: Annotated[str | None, typer.Option(help="scene of the simulated radars; default: demo, or two_radars")] = None,
    bag: Annotated[Path | None, typer.Option(help="variant demo: folder to record into")] = None,
    composed: Annotated[bool, typer.Option("--composed", help="all nodes in one process")] = False,
    small: Annotated[
        bool, typer.Option("--small", help="for small devices: composed, with time budgets (docs/how-to/budget.md), without pictures")
    ] = False,
    respawn: Annotated[bool, typer.Option("--respawn", help="start a node again that died or hangs")] = False,
    mqtt: Annotated[str | None, typer.Option(help="broker to tell, [mqtt[s]://][user@]host[:port] (docs/how-to/home.md)")] = None,
    mqtt_password_file: Annotated[str | None, typer.Option(help="file with the password for --mqtt")] = None,
    osc: Annotated[str | None, typer.Option(help="instrument to tell, host:port (docs/how-to/home.md)")] = None,
    also: Annotated[list[str] | None, typer.Option(help="another node beside the graph's, e.g. vital; may be repeated")] = None,
    secure: Annotated[bool, typer.Option("--secure", help="DDS security: authenticate and encrypt (docs/research/secure.md)")] = False,
    keystore: Annotated[Path | None, typer.Option(help="keys of SROS2 for --secure; default: ROS_SECURITY_KEYSTORE")] = None,
    zones: ZonesFile = None,
    param: Params = None,
    config: Configs = None,
    domain: Domain = None,
    namespace: Namespace = "",
) -> None:
    """Start a graph: every node as its own process, logs with names, Ctrl-C stops all.

    Examples: `handwave up` · `handwave up --scene my_room.yaml --respawn` · `handwave up replay --composed` · `handwave up two_radars`
    · `handwave up --board my_board.py` (docs/how-to/adding-a-board.md) · `handwave up --zones living_room.yaml` (docs/how-to/zones.md)
    · `handwave up --mqtt homeassistant.local` · `handwave up rooms.yaml` (docs/how-to/home.md) · `handwave up --small`
    """
    from radar_app.graph import graph
    from radar_app.outputs import outputs
    from radar_app.rooms import is_rooms_file, load_rooms, rooms_graph, with_board
    from radar_app.small import small_graph
    from radar_app.supervisor import start_graph

    if secure or keystore is not None:
        from radar_app.security import switch_on

        switch_on(keystore, namespace, domain)
    parameters = merged(zone_parameters(zones), parse_parameters(param, config))
    beside = (*outputs(mqtt, mqtt_password_file, osc, parameters), *(also or ()))
    if is_rooms_file(variant):
        if board or scene or bag or namespace or parameters or also or small:
            raise ConfigError(f"{variant} says all of its rooms; of the options only --composed, --respawn, --secure, --domain go with it")
        house = load_rooms(variant)
        raise typer.Exit(start_graph(rooms_graph(house), domain, composed=composed, respawn=respawn or house.respawn))
    variant = with_board(variant, board, parameters)
    if variant in ("live", "demo") or scene is not None:
        parameters.setdefault("driver", {}).setdefault("scene", scene or "demo")
    if variant == "demo":
        from radar_ros.bags import free_folder

        parameters.setdefault("recorder", {}).setdefault("bag", str(bag or free_folder(Path("out") / "recording")))
    make = small_graph if small else graph
    specs = make(variant, namespace=namespace, parameters=parameters, beside=beside)
    raise typer.Exit(start_graph(specs, domain, composed=composed or small, respawn=respawn))


@app.command(rich_help_panel=_BAGS)
def record(
    out: Annotated[Path, typer.Argument(help="folder of the new bag")],
    topics: Annotated[str | None, typer.Option(help="comma-separated names; default: everything of the graph")] = None,
    domain: Domain = None,
    namespace: Namespace = "",
) -> None:
    """Record a running graph into a rosbag2 MCAP until Ctrl-C; a crash loses at most the last half second."""
    from radar_app.graph import NODES
    from radar_app.printing import Printer
    from radar_app.supervisor import Supervisor, supervise

    parameters = {"bag": str(out), **({"topics": comma_separated(topics)} if topics else {})}
    spec = replace(NODES["recorder"], namespace=namespace, parameters=parameters)
    with closing(Printer(8)) as sink:
        raise typer.Exit(supervise(Supervisor([spec], domain=domain, log=sink)))


@app.command(rich_help_panel=_BAGS)
def replay(
    bag: Annotated[Path, typer.Argument(help="folder of the recording")],
    lockstep: Annotated[bool, typer.Option("--lockstep", help="send each frame only after the last result; a drop is an error")] = False,
    out: Annotated[Path | None, typer.Option(help="with --lockstep: folder of a new bag for the results")] = None,
    rate: Annotated[float, typer.Option(help="pace; 2 is twice as fast", min=0.01, max=100.0)] = 1.0,
    loop: Annotated[bool, typer.Option("--loop", help="again and again")] = False,
    clock: Annotated[bool, typer.Option("--clock/--no-clock", help="publish /clock, or leave the nodes in the machine's time")] = True,
    topics: Annotated[str | None, typer.Option(help="comma-separated names to send; default: what the graph starts from")] = None,
    graph_too: Annotated[bool, typer.Option("--graph/--no-graph", help="also start the nodes, or use those that run")] = True,
    zones: ZonesFile = None,
    param: Params = None,
    config: Configs = None,
    domain: Domain = None,
    namespace: Namespace = "",
) -> None:
    """Send a recording through the graph: raw frames if it has them, else its point clouds, with /clock.

    Examples: `handwave replay my_demo` · `handwave replay my_demo --lockstep --out results` · `handwave replay walkers --rate 2`
    """
    from radar_app.replaying import ReplayOptions, run_replay

    parameters = merged(zone_parameters(zones), parse_parameters(param, config))
    options = ReplayOptions(bag, lockstep, out, rate, loop, graph_too, parameters, domain, namespace, clock, comma_separated(topics))
    raise typer.Exit(run_replay(options))


@app.command(rich_help_panel=_BAGS)
def process(
    bag: Annotated[Path, typer.Argument(help="folder of the recording")],
    out: Annotated[Path, typer.Option(help="folder of a new bag for clouds, tracks, gestures and hand")],
    zones: ZonesFile = None,
    param: Params = None,
    config: Configs = None,
) -> None:
    """Run the library over a recording without a graph: the same results as `replay --lockstep`, bit for bit.

    A calibration is named as in the graph: of the array by `baseband.calibration`, of the mount by `driver.calibration`.

    Examples: `handwave process my_demo --out results` · `handwave process walkers --out tracks --config tracking=dense`
    · `handwave process my_demo --out results --param baseband.calibration=array.npz`
    """
    from rich.progress import track

    from radar_core.mounting import load_mount
    from radar_ros.bags import BagWriter
    from radar_ros.offline import copy_info, open_recording, pipeline_config, process_recording, write_results

    areas = {"tracking": zone_parameters(zones).get("tracking", {})}  # all that a zones file says to the library
    chosen = pipeline_config(merged(areas, parse_parameters(param, config)))
    mount = load_mount(chosen.driver.calibration) if chosen.driver.calibration else None
    total, done, gestures = len(open_recording(bag)), 0, 0
    with stopping(lambda: f"stopped: {done} of {total} frames; their results are in {out}"), BagWriter(out) as writer:
        copy_info(bag, writer, mount)
        results = process_recording(bag, chosen, warn=partial(print, file=sys.stderr))
        for stamp_ns, result in track(results, total=total, description="processing"):
            write_results(writer, stamp_ns, result)
            done += 1
            gestures += len(result.gestures)
    print(f"{total} frames, {gestures} gestures; results in {out}")


@app.command(rich_help_panel=_BAGS)
def info(bag: Annotated[Path, typer.Argument(help="folder of the recording")]) -> None:
    """Show what a recording holds, and what can be done with it."""
    from rich.console import Console
    from rich.table import Table

    from radar_ros.bags import RECORDED, contents, incomplete, local, open_bag
    from radar_ros.offline import open_recording

    table, held = Table("topic", "messages"), contents(bag)
    for topic, count in held.items():
        table.add_row(topic, str(count))
    Console().print(table)
    with open_bag(bag) as reader:
        print(f"{reader.duration * 1e-9:.2f} s")
    if why := incomplete(bag):
        print(f"incomplete: {why}")
    missing = [topic for topic in RECORDED if topic not in {local(name) for name in held}]
    print(f"not in it: {', '.join(missing) or 'nothing, it is complete'}")
    try:
        recording = open_recording(bag)
    except HandwaveError as error:
        print(f"cannot be replayed: {error}")
    else:
        print(f"can be replayed from {recording.topic}")


@app.command(rich_help_panel=_BAGS)
def repair(bag: Annotated[Path, typer.Argument(help="folder of a recording that a crash cut off")]) -> None:
    """Recover a recording that was cut off; the damaged file is kept beside it."""
    from radar_ros.bags import repair as recover

    counts = recover(bag)
    if not counts:
        print(f"{bag} is whole; nothing had to be done")
        return
    print(f"recovered {sum(counts.values())} messages: " + ", ".join(f"{topic} {count}" for topic, count in sorted(counts.items())))


def _show_kinds(wanted: bool) -> None:
    if wanted:
        from radar_lab.importers import listing

        print(listing())
        raise typer.Exit


@app.command("import", rich_help_panel=_BAGS)
def import_(
    kind: Annotated[
        str,
        typer.Argument(
            help="npy, bgt60, a121, dca1000, dca1000_bin, crossing, mhomeges, mtranssee, mars, radhar, openradar, cubelearn or bgt60_eth"
        ),
    ],
    source: Annotated[Path, typer.Argument(help="file or folder of the original recording")],
    out: Annotated[Path, typer.Option(help="folder of the new bag")],
    option: Annotated[
        list[str] | None, typer.Option("--option", "-o", help="name=value (docs/reference/recordings.md); repeatable")
    ] = None,
    waveform: Annotated[str, typer.Option(help="of npy: YAML file with the Waveform")] = "",
    array: Annotated[str, typer.Option(help="of npy: YAML file with the AntennaArray")] = "",
    kinds: Annotated[
        bool, typer.Option("--kinds", is_eager=True, callback=_show_kinds, help="say what is known of each kind, and end")
    ] = False,
) -> None:
    """Turn a recording of your own or a public one into a bag that `handwave replay` understands.

    Examples: `handwave import crossing two_people.npz --out walkers` · `handwave import dca1000 x.pcap --out raw -o config=x.cfg`
    · `handwave import npy cube.npy --waveform w.yaml --array a.yaml --out raw -o axes='frame chirp channel sample'`
    """
    from radar_core.yaml_text import read_yaml
    from radar_ros.importing import import_recording

    options = {name: read_yaml(value, f"-o {name}") for name, _, value in (text.partition("=") for text in option or [])}
    options |= {name: value for name, value in (("waveform", waveform), ("array", array)) if value}
    with stopping(lambda: f"stopped: nothing was imported to {out}"):
        print(import_recording(kind, source, out, **options))


lab = typer.Typer(
    no_args_is_help=True,
    rich_markup_mode="markdown",
    help="Commands for studies: what effects do, calibration in a chamber, data sets, training, accuracy against time.",
)
_WATCHING = (watch_commands.watch, view_commands.view, watch_commands.status, watch_commands.listen)
_PANELS = {
    _WATCH: _WATCHING,
    _BAGS: (watch_commands.show, scene_commands.scenes, scene_commands.simulate),
    _SETUP: (device_commands.devices, device_commands.probe, doctor_commands.doctor),
}
for panel, commands in _PANELS.items():
    for command in commands:
        app.command(rich_help_panel=panel)(command)
app.command("compile", rich_help_panel=_SETUP)(compile_loops)
app.command("calibrate-coupling", rich_help_panel=_SETUP)(calibration_commands.calibrate_coupling)
app.command("calibrate-pair", rich_help_panel=_SETUP)(calibration_commands.calibrate_pair)
app.command("calibrate-tilt", rich_help_panel=_SETUP)(calibration_commands.calibrate_tilt)
app.add_typer(gesture_commands.app, name="gesture", rich_help_panel=_MORE)
app.add_typer(lab, name="lab", rich_help_panel=_MORE)

_ENTRIES = {entry.name: entry for entry in importlib.metadata.entry_points(group="handwave.commands")}  # one of each name
_STUDIES = {
    "blender": blender_commands.blender,
    "calibrate": calibration_commands.calibrate,
    "calibrate-camera": camera_commands.calibrate_camera,
    "evaluate": training_commands.evaluate,
    "explain": scene_commands.explain,
    "train": training_commands.train,
    "turntable": calibration_commands.turntable,
    **{name: entry.load() for name, entry in sorted(_ENTRIES.items()) if entry.module.startswith("benchmarks.")},
}
for name, study in _STUDIES.items():
    lab.command(name)(study)
    app.command(name, hidden=True)(study)  # as it was called before there was `lab`; it goes on working
lab.add_typer(dataset_commands.app, name="dataset")
app.add_typer(dataset_commands.app, name="dataset", hidden=True)
for name in sorted(_ENTRIES.keys() - _STUDIES.keys()):
    app.command(name, rich_help_panel=_MORE)(_ENTRIES[name].load())


if __name__ == "__main__":
    main()
