"""`handwave view`: the live page."""

from __future__ import annotations

import os
import signal
import sys
from collections.abc import Iterator
from contextlib import closing, contextmanager
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from radar_app.parameters import Configs, Domain, Namespace, Params, ZonesFile, parse_parameters
from radar_core import ConfigError

if TYPE_CHECKING:
    from radar_app.view.bag import BagSource
    from radar_app.view.live import LiveSource
    from radar_app.view.page import TabMaker

LIVE = "live"
_PORT = 5006
_NICE = 10  # on a busy machine the page draws fewer pictures, and the graph that it looks at goes on as before


def view(
    what: Annotated[str, typer.Argument(help="live: the graph that runs; or the folder of a recording")] = LIVE,
    port: Annotated[int, typer.Option(help="of the page; 0: any that is free", min=0, max=65535)] = _PORT,
    host: Annotated[str | None, typer.Option(help="address to listen on, for others; they need the token (docs/how-to/view.md)")] = None,
    token_file: Annotated[
        Path | None, typer.Option(help="with --host: file with the token; default: $HANDWAVE_VIEW_TOKEN, or a new one")
    ] = None,
    zones: ZonesFile = None,
    rate: Annotated[float, typer.Option(help="of a recording: pace; 2 is twice as fast", min=0.05, max=100.0)] = 1.0,
    loop: Annotated[bool, typer.Option("--loop", help="of a recording: again and again")] = False,
    compute: Annotated[bool, typer.Option("--compute", help="of a recording: work out the results anew")] = False,
    log: Annotated[
        Path | None, typer.Option(help="folder of a session: keep every gesture there, to be labelled on the page (docs/how-to)")
    ] = None,
    subject: Annotated[str, typer.Option(help="with --log: who performs the gestures; default: as before in that session")] = "",
    choices: Annotated[Path | None, typer.Option(help="folder that handwave lab tradeoff made; default: what comes with Handwave")] = None,
    param: Params = None,
    config: Configs = None,
    domain: Domain = None,
    namespace: Namespace = "",
) -> None:
    """Show in a browser what a graph does, live; or a recording, without a graph.

    A recording shows its own results; where it has none, or with --compute, the library works them out. To see a recording go through a
    graph run `handwave replay` beside `handwave view`.

    Examples: `handwave view` · `handwave view my_demo` · `handwave view --zones living_room.yaml` · `handwave view --host 0.0.0.0`
    """
    from radar_app.supervisor import environment

    if host is None and token_file is not None:
        raise ConfigError("--token-file goes with --host; on this machine no token is needed")
    if subject and log is None:
        raise ConfigError("--subject goes with --log")
    os.environ.update(environment(domain))
    source = _live(namespace, zones) if what == LIVE else _bag(Path(what), rate, loop, compute, zones, param, config)
    try:
        with _logging(source, log, subject) as tabs:
            told = _serve(source, [*_own_tabs(choices), *tabs], port, host, token_file)
    finally:
        source.close()
    raise typer.Exit(128 + told if told == signal.SIGHUP else 0)  # any other signal is how it ends


def _own_tabs(choices: Path | None) -> list[TabMaker]:
    """List the tabs that every page has."""
    from radar_app.view.choices_tab import ChoicesTab
    from radar_app.view.room_tab import RoomTab

    return [RoomTab, partial(ChoicesTab, folder=choices)]


@contextmanager
def _logging(source: LiveSource | BagSource, log: Path | None, subject: str) -> Iterator[list[TabMaker]]:
    """Keep gestures for as long as the block runs, where a folder is given; yields the tabs for that."""
    if log is None:
        yield []
        return
    from radar_app.logger.logger import Logger
    from radar_app.logger.store import SessionStore
    from radar_app.logger.tab import LoggerTab

    store = SessionStore(log, subject)
    for line in store.told:
        print(line, file=sys.stderr)
    with closing(Logger(source.feed, store)) as logger:
        yield [partial(LoggerTab, logger=logger)]


def _live(namespace: str, zones: Path | None) -> LiveSource:
    from radar_app.view.live import LiveSource
    from radar_ros.priority import give_way

    give_way(_NICE)
    return LiveSource(namespace.strip("/"), zones)


def _bag(
    path: Path, rate: float, loop: bool, compute: bool, zones: Path | None, param: list[str] | None, config: list[str] | None
) -> BagSource:
    from radar_app.view.bag import BagOptions, BagSource
    from radar_ros.offline import pipeline_config

    if not path.exists():
        raise ConfigError(f"{path}: there is no such recording; give its folder, or {LIVE} for the graph that runs")
    chosen = pipeline_config(parse_parameters(param, config)) if param or config else None
    return BagSource(path, BagOptions(rate, loop, compute or chosen is not None, zones, chosen))


def _serve(source: LiveSource | BagSource, tabs: list[TabMaker], port: int, host: str | None, token_file: Path | None) -> int:
    """Serve the page until a signal ends it, and say where it is; returns the signal's number."""
    from radar_app.view.access import LOCAL, LOGIN, addresses, find_token
    from radar_app.view.server import ServerOptions, ViewServer

    token, fresh = find_token(token_file) if host is not None else ("", False)
    server = ViewServer(source, tabs, ServerOptions(port, host or LOCAL, token))
    try:
        if host is None:
            print(f"http://{LOCAL}:{server.port}/", flush=True)
        for address in addresses(host) if host is not None else ():
            print(f"http://{address}:{server.port}/", flush=True)
        if fresh:  # told once, to who started it, on the terminal; behind # it reaches no log
            print(f"token, for {LOGIN}#TOKEN or the page's question: {token}", file=sys.stderr, flush=True)
        return server.run()
    finally:
        server.close()
