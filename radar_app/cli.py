"""The `handwave` command."""

from __future__ import annotations

import importlib.metadata
import json
import sys
from pathlib import Path
from typing import Annotated, Any

import typer

from radar_app import calibration_commands, camera_commands, dataset_commands, device_commands, scene_commands, training_commands
from radar_core import HandwaveError

app = typer.Typer(
    no_args_is_help=True,
    rich_markup_mode="markdown",
    pretty_exceptions_enable=False,
    help="Touchless interface from mmWave radar: people, arm gestures and a hand, as ROS 2 nodes.\n\n"
    "Start with `handwave demo`: a simulated room, everything running, a report at the end.",
)

Domain = Annotated[int | None, typer.Option(help="ROS domain; default: ROS_DOMAIN_ID, else 0", min=0, max=232)]
Namespace = Annotated[str, typer.Option(help="namespace of the graph, one per radar, e.g. left")]
Params = Annotated[
    list[str] | None, typer.Option("--param", "-p", help="node.parameter=value, e.g. tracking.association.gate=1.2; may be repeated")
]

Configs = Annotated[
    list[str] | None,
    typer.Option("--config", "-c", help="node=file, or one of ours by name, e.g. tracking=dense; --param goes before it; may be repeated"),
]


def main() -> None:
    """Run the command; what the user got wrong ends in one message and status 2, never in a traceback."""
    from radar_ros.interrupts import interruptible

    try:
        with interruptible():  # so that what a command writes is whole when it is told to stop
            app()
    except HandwaveError as error:
        print(f"handwave: {error}", file=sys.stderr)
        sys.exit(2)


@app.command()
def demo(
    scene: Annotated[str, typer.Option(help="scene file, or one of ours by name (see: handwave scenes)")] = "demo",
    duration: Annotated[float | None, typer.Option(help="end after so many seconds", min=1.0)] = None,
    bag: Annotated[Path | None, typer.Option(help="folder of the recording; default: out/demo, with a number if it exists")] = None,
    headless: Annotated[bool, typer.Option("--headless", help="plain lines instead of the live display")] = False,
    as_json: Annotated[bool, typer.Option("--json", help="print the report as one JSON object")] = False,
    verbose: Annotated[bool, typer.Option("--verbose", help="show the nodes' logs")] = False,
    domain: Domain = None,
    namespace: Namespace = "",
) -> None:
    """Run the whole graph on a simulated room, watch it live, and compare what it recognised with the truth.

    Every node is a process of its own; everything is recorded into an MCAP bag.

    Examples: `handwave demo` · `handwave demo --scene one_user --headless` · `handwave demo --duration 20 --bag my_recording`
    """
    from rich.console import Console

    from radar_app.demo import DemoOptions, run_demo, show_report

    console = Console(stderr=as_json)
    report = run_demo(DemoOptions(scene, duration, bag, headless, domain, namespace, verbose), console)
    if as_json:
        print(json.dumps(report))
    else:
        show_report(report, console)
    if report["crashes"] or not report["frames"]:
        raise typer.Exit(1)
    if report["interrupted"]:
        raise typer.Exit(130)


@app.command()
def up(
    variant: Annotated[str, typer.Argument(help="live, clouds, cloud2, demo, two_radars, replay, stages, camera (docs/graph.md)")] = "live",
    scene: Annotated[str | None, typer.Option(help="scene of the simulated radars; default: demo, or two_radars")] = None,
    bag: Annotated[Path | None, typer.Option(help="variant demo: folder to record into")] = None,
    composed: Annotated[bool, typer.Option("--composed", help="all nodes in this one process")] = False,
    respawn: Annotated[bool, typer.Option("--respawn", help="start a node again that died")] = False,
    param: Params = None,
    config: Configs = None,
    domain: Domain = None,
    namespace: Namespace = "",
) -> None:
    """Start a graph: every node as its own process, logs with names, Ctrl-C stops all.

    Examples: `handwave up` · `handwave up --scene my_room.yaml --respawn` · `handwave up replay --composed` · `handwave up two_radars`
    """
    from radar_app.graph import graph
    from radar_app.supervisor import Supervisor, default_log_sink, refuse_busy_domain, run_composed

    parameters = parse_parameters(param, config)
    if variant in ("live", "demo") or scene is not None:
        parameters.setdefault("driver", {}).setdefault("scene", scene or "demo")
    if variant == "demo":
        from radar_ros.bags import free_folder

        parameters.setdefault("recorder", {}).setdefault("bag", str(bag or free_folder(Path("out") / "recording")))
    specs = graph(variant, namespace=namespace, parameters=parameters)
    refuse_busy_domain([spec.label for spec in specs], namespace, domain)
    if composed:
        raise typer.Exit(run_composed(specs, domain))
    supervisor = Supervisor(specs, domain=domain, respawn=respawn, log=default_log_sink(max(len(s.label) for s in specs)))
    raise typer.Exit(supervise(supervisor))


def supervise(supervisor: Any) -> int:
    """Run nodes until interrupted or until none is left; a node that dies leaves the others running.

    Returns
    -------
    int
        0 when no node died, 1 when one did, 2 when a node refused its settings (which ends all).
    """
    import signal
    import threading

    told = threading.Event()
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, lambda *_: told.set())
    with supervisor:
        while not told.wait(0.2):
            for name, code in supervisor.poll():
                if code == 2:
                    print(f"handwave: node {name} refused its settings, see above; everything is stopped", file=sys.stderr)
                    return 2
                if not supervisor.respawn:
                    advice = "" if code == 0 else "; the others go on, --respawn would start it again"
                    print(f"handwave: node {name} ended with status {code}{advice}", file=sys.stderr)
            if not supervisor.active:
                break
    return int(bool(supervisor.crashes) and not supervisor.respawn)


def _settings_of(node: str, name: str) -> dict[str, Any]:
    """Read a configuration file of a node; nested settings get dots, as ROS parameters are named."""
    import yaml

    from radar_core import ConfigError
    from radar_core.paths import find_config

    path = find_config(name, node, ".yaml")
    try:
        settings = yaml.safe_load(path.read_text(encoding="utf-8"))
    except (yaml.YAMLError, UnicodeDecodeError) as error:
        raise ConfigError(f"{path}: this is no YAML ({error})") from None
    if not isinstance(settings, dict):
        raise ConfigError(f"{path}: must hold knobs of the node {node}, one 'name: value' a line")

    def flat(values: dict[str, Any], prefix: str) -> dict[str, Any]:
        result: dict[str, Any] = {}
        for key, value in values.items():
            result.update(flat(value, f"{prefix}{key}.") if isinstance(value, dict) else {f"{prefix}{key}": value})
        return result

    return flat(settings, "")


def split(names: str | None) -> tuple[str, ...]:
    """Read a comma-separated list."""
    return tuple(name.strip() for name in (names or "").split(",") if name.strip())


def parse_parameters(given: list[str] | None, files: list[str] | None = None) -> dict[str, dict[str, Any]]:
    """Read ``node.parameter=value`` settings and ``node=file`` configurations; the single settings win.

    Raises
    ------
    ConfigError
        When one is not of that form, or a file is missing or no mapping.
    """
    import yaml

    from radar_core import ConfigError

    result: dict[str, dict[str, Any]] = {}
    for text in files or []:
        node, equals, name = text.partition("=")
        if not (equals and node and name):
            raise ConfigError(f"--config {text!r}: write node=file, e.g. tracking=dense")
        result.setdefault(node, {}).update(_settings_of(node, name))
    for text in given or []:
        name, equals, value = text.partition("=")
        node, dot, parameter = name.partition(".")
        if not (equals and dot and node and parameter):
            raise ConfigError(f"--param {text!r}: write node.parameter=value, e.g. tracking.association.gate=1.2")
        result.setdefault(node, {})[parameter] = yaml.safe_load(value)
    return result


@app.command()
def record(
    out: Annotated[Path, typer.Argument(help="folder of the new bag")],
    topics: Annotated[str | None, typer.Option(help="comma-separated names; default: everything of the graph")] = None,
    domain: Domain = None,
    namespace: Namespace = "",
) -> None:
    """Record a running graph into a rosbag2 MCAP until Ctrl-C; a crash loses at most the last half second."""
    from radar_app.graph import NODES, replace_parameters
    from radar_app.supervisor import Supervisor, default_log_sink

    settings: dict[str, Any] = {"bag": str(out)}
    if topics:
        settings["topics"] = split(topics)
    spec = replace_parameters(NODES["recorder"], namespace, settings)
    raise typer.Exit(supervise(Supervisor([spec], domain=domain, log=default_log_sink(8))))


@app.command()
def replay(
    bag: Annotated[Path, typer.Argument(help="folder of the recording")],
    lockstep: Annotated[
        bool, typer.Option("--lockstep", help="send the next frame only after the last result; a drop is an error")
    ] = False,
    out: Annotated[Path | None, typer.Option(help="with --lockstep: folder of a new bag for the results")] = None,
    rate: Annotated[float, typer.Option(help="pace; 2 is twice as fast", min=0.01, max=100.0)] = 1.0,
    loop: Annotated[bool, typer.Option("--loop", help="again and again")] = False,
    clock: Annotated[bool, typer.Option("--clock/--no-clock", help="publish /clock, or leave the nodes in the machine's time")] = True,
    topics: Annotated[str | None, typer.Option(help="comma-separated names to send; default: what the graph starts from")] = None,
    graph_too: Annotated[bool, typer.Option("--graph/--no-graph", help="also start the nodes, or use those that run")] = True,
    param: Params = None,
    config: Configs = None,
    domain: Domain = None,
    namespace: Namespace = "",
) -> None:
    """Send a recording through the graph: raw frames if it has them, else its point clouds, with /clock.

    Examples: `handwave replay my_demo` · `handwave replay my_demo --lockstep --out results` · `handwave replay walkers --rate 2`
    """
    from radar_app.replaying import ReplayOptions, run_replay

    chosen = split(topics)
    settings = parse_parameters(param, config)
    options = ReplayOptions(bag, lockstep, out, rate, loop, graph_too, settings, domain, namespace, clock, chosen)
    raise typer.Exit(run_replay(options))


@app.command()
def process(
    bag: Annotated[Path, typer.Argument(help="folder of the recording")],
    out: Annotated[Path, typer.Option(help="folder of a new bag for clouds, tracks, gestures and hand")],
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
    from radar_ros.bags import BagWriter, contents, local
    from radar_ros.offline import copy_info, open_recording, pipeline_config, process_recording, write_results

    chosen = pipeline_config(parse_parameters(param, config))
    mount = load_mount(chosen.driver.calibration) if chosen.driver.calibration else None
    recording = open_recording(bag)
    total = sum(count for topic, count in contents(bag).items() if local(topic) == recording.topic)
    gestures = 0
    with BagWriter(out) as writer:
        copy_info(bag, writer, mount)
        for stamp_ns, result in track(process_recording(bag, chosen), total=total, description="processing"):
            write_results(writer, stamp_ns, result)
            gestures += len(result.gestures)
    print(f"{total} frames, {gestures} gestures; results in {out}")


@app.command()
def info(bag: Annotated[Path, typer.Argument(help="folder of the recording")]) -> None:
    """Show what a recording holds, and what can be done with it."""
    from rich.console import Console
    from rich.table import Table

    from radar_ros.bags import RECORDED, contents, local, open_bag
    from radar_ros.offline import open_recording

    table = Table("topic", "messages")
    held = contents(bag)
    for topic, count in held.items():
        table.add_row(topic, str(count))
    Console().print(table)
    with open_bag(bag) as reader:
        print(f"{reader.duration * 1e-9:.2f} s")
    missing = [topic for topic in RECORDED if topic not in {local(name) for name in held}]
    print(f"not in it: {', '.join(missing) or 'nothing, it is complete'}")
    try:
        recording = open_recording(bag)
    except HandwaveError as error:
        print(f"cannot be replayed: {error}")
    else:
        print(f"can be replayed from {recording.topic}")


@app.command()
def repair(bag: Annotated[Path, typer.Argument(help="folder of a recording that a crash cut off")]) -> None:
    """Recover a recording that was cut off; the damaged file is kept beside it."""
    from radar_ros.bags import repair as recover

    counts = recover(bag)
    if not counts:
        print(f"{bag} is whole; nothing had to be done")
        return
    print(f"recovered {sum(counts.values())} messages: " + ", ".join(f"{topic} {count}" for topic, count in sorted(counts.items())))


@app.command("import")
def import_(
    kind: Annotated[str, typer.Argument(help="crossing, mhomeges, mtranssee, mars, dca1000, dca1000_bin or openradar")],
    source: Annotated[Path, typer.Argument(help="file or folder of the original recording")],
    out: Annotated[Path, typer.Option(help="folder of the new bag")],
    option: Annotated[list[str] | None, typer.Option("--option", "-o", help="name=value, see docs/recordings.md; may be repeated")] = None,
) -> None:
    """Turn a public recording into a bag that `handwave replay` understands.

    Examples: `handwave import crossing two_people.npz --out walkers` · `handwave import dca1000 x.pcap --out raw -o config=x.cfg`
    """
    import yaml

    from radar_ros.importing import import_recording

    options = {name: yaml.safe_load(value) for name, _, value in (text.partition("=") for text in option or [])}
    print(import_recording(kind, source, out, **options))


@app.command()
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
    """Find gain, phase and position of every channel from a corner reflector on a turntable (docs/calibration.md).

    Examples: `handwave calibrate chamber -o array.npz` · `handwave calibrate az el -o a.npz --azimuth -60:60:1 --elevation -30:30:1`
    """
    from radar_app.calibrate import calibrate as fit
    from radar_app.calibrate import sweep_options
    from radar_lab.arrays.calibration import Calibration

    settings = Calibration(method=method, distance=distance, offsets=offsets)
    report = fit(recordings, out, sweep_options(azimuth, elevation, dwell, settle), settings)
    print("\n".join(report.lines()))
    print(f"calibration in {out}, ambiguity functions in {out.with_suffix('.png')}")


@app.command()
def turntable(
    out: Annotated[Path, typer.Option(help="folder of the new bag")],
    config: Annotated[Path | None, typer.Option("--config", "-c", help="YAML with the knobs of radar_sim.turntable.Turntable")] = None,
) -> None:
    """Simulate a recording of a corner reflector seen from a turntable by a radar with errors, for `handwave calibrate`."""
    from rich.progress import track

    from radar_app.calibrate import record_turntable
    from radar_core.config import load_file
    from radar_sim.turntable import Turntable, TurntableSimulator

    settings = load_file(Turntable, config) if config is not None else Turntable()
    total = TurntableSimulator(settings).n_frames
    for _ in track(record_turntable(settings, out), total=total, description="turning"):
        pass
    print(f"{total} frames in {out}; what the turntable did is in {out / 'turntable.yaml'}")


_SCENES = (scene_commands.scenes, scene_commands.explain, scene_commands.simulate)
_DEVICES = (device_commands.devices, device_commands.probe)
_COMMANDS = (*_SCENES, *_DEVICES, training_commands.train, training_commands.evaluate)
for command in _COMMANDS:
    app.command()(command)
app.command("calibrate-pair")(calibration_commands.calibrate_pair)
app.command("calibrate-camera")(camera_commands.calibrate_camera)
app.add_typer(dataset_commands.app, name="dataset")
for entry in sorted(importlib.metadata.entry_points(group="handwave.commands"), key=lambda entry: entry.name):
    app.command(entry.name)(entry.load())


if __name__ == "__main__":
    main()
