"""Commands about a running graph and about what is in a bag: watch, status, listen, show."""

from __future__ import annotations

import json
import os
import time
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from radar_app.exits import CLOSED, pipe_closed
from radar_app.parameters import Domain, Json, Namespace
from radar_core import ConfigError, DataError

if TYPE_CHECKING:
    from radar_app.watching.listener import Listener

_LOOK = 0.2  # s: how often it is looked whether anybody still reads


def _enter(domain: int | None) -> None:
    """Look into a ROS domain as graphs of this machine do."""
    from radar_app.supervisor import environment

    os.environ.update(environment(domain))


def status(as_json: Json = False, domain: Domain = None, namespace: Namespace = "") -> None:
    """Say how every node of a running graph is doing: alive, rate, latency, what was lost, and what is wrong.

    Exit status: 0 healthy, 1 something is wrong, 2 there is no graph.

    Examples: `handwave status` · `handwave status --json` · `handwave status --namespace hall`
    """
    from rich.console import Console

    from radar_app.watching import status as one_look
    from radar_ros.interrupts import ros

    _enter(domain)
    with ros():
        found = one_look.look(namespace)
    if as_json:
        print(json.dumps(one_look.as_json(found)))
    elif found.nodes:
        Console().print(one_look.screen(found), highlight=False)
    else:
        number = os.environ.get("ROS_DOMAIN_ID") or "0"
        print(f"no graph in ROS domain {number} at {found.namespace}; start one with: handwave up (other places: --domain, --namespace)")
    raise typer.Exit(found.code)


def listen(
    as_json: Annotated[bool, typer.Option("--json", help="one JSON object a line, with all that there is to know")] = False,
    gestures: Annotated[bool, typer.Option("--gestures", help="gestures; without any of these four: all of them")] = False,
    people: Annotated[bool, typer.Option("--people", help="where everybody is; without --json: who comes and goes")] = False,
    hand: Annotated[bool, typer.Option("--hand", help="the hand that is used as a control")] = False,
    zones: Annotated[bool, typer.Option("--zones", help="who is in which zone")] = False,
    count: Annotated[int | None, typer.Option("--count", "-n", help="end after so many lines", min=1)] = None,
    domain: Domain = None,
    namespace: Namespace = "",
) -> None:
    """Print what a running graph recognises, a line at a time, for other programs and for people; Ctrl-C ends it.

    Lines are flushed at once. Times are seconds of the graph's clock, places metres in the room (x forward, y left, z up), speeds metres
    per second, confidence and control value 0 to 1; what is not known is null. It ends when nobody reads any more (status 141).

    Examples: `handwave listen` · `handwave listen --json --gestures` · `handwave listen --json --people | jq .count`
    """
    from radar_app.watching.lines import RECORDS, Words
    from radar_app.watching.listener import Listener
    from radar_app.watching.people import finite
    from radar_ros.interrupts import ros

    _enter(domain)
    asked = {"gestures": gestures, "people": people, "hand": hand, "zones": zones}
    chosen = [what for what, wanted in asked.items() if wanted] or list(asked)
    words, left, failed = Words(), count, list[OSError]()

    def tell(what: str, space: str, msg: Any) -> None:
        nonlocal left
        lines = [json.dumps(finite(RECORDS[what][1](space, msg)))] if as_json else words.process(what, space, msg)
        try:
            for line in lines if left is None else lines[:left]:
                print(line, flush=True)
        except OSError as error:  # nobody reads any more, or the disk is full; within a callback rclpy would log a traceback
            failed.append(error)
        left = None if left is None else max(left - len(lines), 0)

    def enough() -> bool:
        if failed:
            raise failed[0]
        return left == 0

    with ros(), Listener("listen", namespace) as listener:
        for what in chosen:
            listener.hear_each(RECORDS[what][0], partial(tell, what))
        _until_told(listener, enough)


def watch(
    duration: Annotated[float | None, typer.Option(help="end after so many seconds", min=0.1)] = None,
    domain: Domain = None,
    namespace: Namespace = "",
) -> None:
    """Show a running graph live in the terminal: people on a map of the room, gestures, hand, rates; Ctrl-C ends it.

    It fits 80 columns and 24 lines. Where the output is no terminal, there is one plain line a second instead.

    Examples: `handwave watch` · `handwave watch --namespace hall` · `handwave watch --duration 60`
    """
    from rich.console import Console
    from rich.live import Live

    from radar_app.live import Monitor
    from radar_ros.interrupts import ros

    _enter(domain)
    console, title = Console(), f"handwave watch{f' {namespace}' if namespace else ''}"
    end = None if duration is None else time.monotonic() + duration
    with ros(), Monitor(namespace) as monitor:

        def over() -> bool:
            return end is not None and time.monotonic() > end

        if console.is_terminal:
            with Live(monitor.render(title), console=console, refresh_per_second=8) as display:
                _until_told(monitor, over, lambda: display.update(monitor.render(title)))
        else:
            _until_told(monitor, over, lambda: print(monitor.line(), flush=True), every=1.0)


def _until_told(listener: Listener, done: Any, show: Any = None, every: float = 0.12) -> None:
    """Listen until that is enough, nobody reads any more, or Ctrl-C, which is how such a command ends: status 0."""
    from radar_ros.signals import interruptible, stopped, told

    shown = time.monotonic()
    with interruptible():
        try:
            while not done():
                listener.spin(min(every, _LOOK))
                if pipe_closed():
                    raise typer.Exit(CLOSED)
                if show is not None and time.monotonic() - shown >= every:
                    shown = time.monotonic()
                    show()
        except KeyboardInterrupt:
            raise typer.Exit(0 if told() != 1 else stopped()) from None


def show(
    bag: Annotated[Path, typer.Argument(help="folder of the recording")],
    as_csv: Annotated[bool, typer.Option("--csv", help="gestures and people as CSV, a row each")] = False,
    positions: Annotated[bool, typer.Option("--positions", help="where everybody was at every moment, as CSV")] = False,
    as_json: Json = False,
    preview: Annotated[Path | None, typer.Option(help="also draw room, people, gestures and spectra: .png or .mp4")] = None,
    range_doppler: Annotated[Path | None, typer.Option(help="also plot the range-Doppler map of a frame: .png")] = None,
    micro_doppler: Annotated[Path | None, typer.Option(help="also plot the micro-Doppler over time: .png")] = None,
    at: Annotated[float | None, typer.Option(help="of --range-doppler: seconds since the beginning; default: the middle", min=0.0)] = None,
) -> None:
    """Show what is in a recording: gestures and people as tables, CSV or JSON; as a picture, a film, or plots.

    A recording without gestures and tracks can be drawn too; `handwave process` recognises what is in it.

    Examples: `handwave show my_demo` · `handwave show my_demo --csv > my_demo.csv` · `handwave show walkers --preview walkers.mp4`
    · `handwave show raw --range-doppler map.png --at 2.5`
    """
    from rich.console import Console

    from radar_app.showing import plots, tables
    from radar_app.showing.results import read_results

    if sum((as_csv, positions, as_json)) > 1:
        raise ConfigError("show: choose one of --csv, --positions and --json")
    results = read_results(bag)
    if preview is not None:
        plots.draw_preview(results, preview)
    if range_doppler is not None:
        plots.draw_range_doppler(results, range_doppler, at)
    if micro_doppler is not None:
        plots.draw_micro_doppler(results, micro_doppler)
    drawn = [path for path in (preview, range_doppler, micro_doppler) if path is not None]
    known = bool(results.people or results.gestures)
    if not (known or drawn):
        advice = f"recognise what is in it with: handwave process {bag} --out results, then: handwave show results"
        raise DataError(f"{bag}: holds no gestures and no tracks; {advice}")
    if as_csv or positions:
        print(tables.positions_csv(results) if positions else tables.as_csv(results), end="")
    elif as_json:
        print(json.dumps(tables.as_json(results)))
    else:
        Console().print(tables.screen(results) if known else "no gestures and no tracks in it", highlight=False)
        print("".join(f"drawn: {path}\n" for path in drawn), end="")
