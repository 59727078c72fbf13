"""`handwave replay`: the graph and the player together."""

from __future__ import annotations

import os
from collections.abc import Mapping
from contextlib import ExitStack, closing
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.progress import Progress

from radar_app import compiling
from radar_app.graph import STAGES, graph
from radar_app.live import Monitor
from radar_app.supervisor import Supervisor, environment, refuse_busy_domain
from radar_core import ConfigError, DataError
from radar_core.mounting import MountCalibration, load_mount
from radar_ros.bags import TYPES, BagWriter
from radar_ros.interrupts import ros
from radar_ros.offline import Recording, copy_info, open_recording
from radar_ros.replay import Lockstep, Player, play
from radar_ros.signals import interruptible
from radar_ros.waiting import PATIENCE, REMEDY, Patience

READER_TIMEOUT = PATIENCE
"""How long the player waits for a reader of its frames while no node works [s]."""


@dataclass(frozen=True)
class ReplayOptions:
    """What the user asked for."""

    bag: Path
    lockstep: bool = False
    out: Path | None = None
    rate: float = 1.0
    loop: bool = False
    graph_too: bool = True
    parameters: Mapping[str, Mapping[str, Any]] | None = None
    domain: int | None = None
    namespace: str = ""
    clock: bool = True
    topics: tuple[str, ...] = ()


def run_replay(options: ReplayOptions) -> int:
    """Replay a recording; returns the exit status: 0, 1 when a node died.

    A `DataError` says that the bag cannot be replayed, or that in lockstep a frame was lost.
    """
    _refuse_contradictions(options)
    recording = open_recording(options.bag)
    os.environ.update(environment(options.domain))
    common = {"reliable": True} if options.lockstep else {"use_sim_time": options.clock}
    parameters = {name: dict(values) for name, values in (options.parameters or {}).items()}
    parameters["*"] = {**common, **parameters.get("*", {})}
    # The driver does not run in a replay: the player sends the recording in its place, so it gets the measured mount.
    file = parameters.get("driver", {}).get("calibration", "")
    mount = load_mount(file) if file else None
    without = ("baseband",) if recording.topic == "radar/points" else ()
    specs = graph("stages" if options.lockstep else "replay", namespace=options.namespace, parameters=parameters, without=without)
    if options.graph_too:
        refuse_busy_domain([spec.name for spec in specs], options.namespace, options.domain)
    console = Console()

    def errors_only(name: str, line: str) -> None:
        if "[INFO]" not in line or compiling.told(line):
            console.print(f"{name}: {line}", markup=False, highlight=False, soft_wrap=True)

    supervisor = Supervisor(specs if options.graph_too else (), domain=options.domain, log=errors_only)
    with interruptible(), ros(), supervisor:
        if options.lockstep:
            _lockstep(options, supervisor, recording, console, mount)
        else:
            _in_time(options, supervisor, recording.topic, console, mount)
        supervisor.poll()
    for name, code in supervisor.crashes:
        console.print(f"[red]node {name} died with status {code}")
    return int(bool(supervisor.crashes))


def _refuse_contradictions(options: ReplayOptions) -> None:
    """Options that would be ignored are refused."""
    if options.out is not None and not options.lockstep:
        raise ConfigError("--out goes with --lockstep; to record a replay in its own time run: handwave record")
    if options.lockstep and (options.loop or options.rate != 1.0 or options.topics or not options.clock):
        raise ConfigError("--lockstep goes once, as fast as the nodes answer: leave out --loop, --rate, --topics and --no-clock")
    for topic in options.topics:
        if topic not in TYPES:
            raise ConfigError(f"--topics: there is no {topic!r}; topics: {', '.join(TYPES)}")


def _lockstep(options: ReplayOptions, nodes: Supervisor, recording: Recording, console: Console, mount: MountCalibration | None) -> None:
    def watch() -> None:
        for name, status in nodes.poll():
            raise DataError(f"node {name} ended with status {status}; the replay is not complete")

    stages = [stage for stage in STAGES if stage != "baseband" or recording.topic == "radar/frame"]
    with ExitStack() as stack:
        out = stack.enter_context(BagWriter(options.out)) if options.out is not None else None
        if out is not None:
            copy_info(options.bag, out, mount)
        lockstep = stack.enter_context(closing(Lockstep(stages, options.namespace, out, watch, mount, nodes.cpu_seconds)))
        with Progress(console=console) as progress:
            task = progress.add_task("lockstep", total=len(recording))
            count = lockstep.run(options.bag, lambda done: progress.update(task, completed=done))
    console.print(f"{count} frames, none lost" + (f"; results in {options.out}" if options.out else ""))


def _in_time(options: ReplayOptions, supervisor: Supervisor, topic: str, console: Console, mount: MountCalibration | None) -> None:
    topics = options.topics or ("radar/info", topic, "truth", "tf_static", "hand/trigger")
    awaited = next((name for name in topics if name in ("radar/frame", "radar/points")), topics[0])
    player, monitor = Player(options.namespace, mount), Monitor(options.namespace)
    try:
        source = player.publisher(awaited)
        patience = Patience(READER_TIMEOUT, supervisor.cpu_seconds)
        while not source.get_subscription_count():
            if supervisor.poll():
                raise DataError("a node did not start; its message stands above")
            if patience.over():
                advice = REMEDY if options.graph_too else "start the graph (handwave up replay), or let replay start it (--graph)"
                raise DataError(f"nobody reads {awaited}; {advice}")
            monitor.spin(0.1)
        monitor.spin(0.5)

        def spin(seconds: float) -> None:
            monitor.spin(seconds)
            while monitor.gestures:
                track, name, confidence = monitor.gestures.popleft()
                console.print(f"person {track}: {name} ({confidence:.0%})", highlight=False)

        while True:
            count = play(player, options.bag, topics, rate=options.rate, spin=spin, clock=options.clock)
            monitor.spin(0.5)
            people = len(monitor.tracks.tracks) if monitor.tracks is not None else 0
            console.print(f"{count} messages sent, {monitor.received} track arrays came back, {people} tracks at the end", highlight=False)
            if not options.loop:
                return
    finally:
        monitor.close()
        player.close()
