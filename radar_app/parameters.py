"""What commands share: options, parameters of nodes, a bar for what takes long, and how Ctrl-C ends it."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated, Any, Final

import typer

from radar_core import ConfigError
from radar_core.paths import find_config
from radar_core.yaml_text import read_yaml

Domain = Annotated[int | None, typer.Option(help="ROS domain; default: ROS_DOMAIN_ID, else 0", min=0, max=232)]
Namespace = Annotated[str, typer.Option(help="namespace of the graph, one per radar, e.g. left")]
Params = Annotated[list[str] | None, typer.Option("--param", "-p", help="node.parameter=value, e.g. driver.scene=demo; may be repeated")]
Configs = Annotated[
    list[str] | None,
    typer.Option("--config", "-c", help="node=file, or one of ours by name, e.g. tracking=dense; --param goes before it; may be repeated"),
]
ZonesFile = Annotated[Path | None, typer.Option("--zones", help="YAML file with the zones of the room (docs/how-to/zones.md)")]
Json = Annotated[bool, typer.Option("--json", help="print one JSON object")]

_NAME: Final = re.compile(r"[^\s:]+")  # of a parameter: ROS writes name:=value, which is not meant here


@contextmanager
def stopping(told: Callable[[], str]) -> Iterator[None]:
    """Let Ctrl-C end a command with what ``told`` returns, and the status of the signal: 130, of a closed terminal 129."""
    from radar_ros.signals import interruptible, stopped

    with interruptible():
        try:
            yield
        except KeyboardInterrupt:
            print(told())
            raise typer.Exit(stopped()) from None


@contextmanager
def progress_bar(title: str, *, quiet: bool, transient: bool = False) -> Iterator[Callable[[float], None]]:
    """Show on the terminal how far something is; yields what is told the share, 0..1."""
    from rich.console import Console
    from rich.progress import Progress

    with Progress(console=Console(stderr=True), disable=quiet, transient=transient) as bar:
        task = bar.add_task(title, total=1.0)
        yield lambda share: bar.update(task, completed=share)


def dotted(values: dict[str, Any], prefix: str = "") -> dict[str, Any]:
    """Give nested knobs dots, as ROS parameters are named."""
    result: dict[str, Any] = {}
    for key, value in values.items():
        result |= dotted(value, f"{prefix}{key}.") if isinstance(value, dict) else {f"{prefix}{key}": value}
    return result


def _config_of(node: str, name: str) -> dict[str, Any]:
    """Read a configuration file of a node."""
    path = find_config(name, node, ".yaml")
    try:
        config = read_yaml(path.read_text(encoding="utf-8"), path)
    except UnicodeDecodeError as error:
        raise ConfigError(f"{path}: not valid YAML: {error}") from None
    if not isinstance(config, dict):
        raise ConfigError(f"{path}: must hold knobs of the node {node}, one 'name: value' a line")
    return dotted(config)


def comma_separated(names: str | None) -> tuple[str, ...]:
    """Read a comma-separated list."""
    return tuple(name.strip() for name in (names or "").split(",") if name.strip())


def parse_parameters(given: list[str] | None, files: list[str] | None = None) -> dict[str, dict[str, Any]]:
    """Read ``node.parameter=value`` and ``node=file``; single parameters win.

    A `ConfigError` says that one is not of that form, or that a file is missing or no mapping.
    """
    result: dict[str, dict[str, Any]] = {}
    for text in files or []:
        node, equals, name = text.partition("=")
        if not (equals and node and name):
            raise ConfigError(f"--config {text!r}: write node=file, e.g. tracking=dense")
        result.setdefault(node, {}).update(_config_of(node, name))
    for text in given or []:
        name, equals, value = text.partition("=")
        node, dot, parameter = name.partition(".")
        if not (equals and dot and node and _NAME.fullmatch(parameter)):
            raise ConfigError(f"--param {text!r}: write node.parameter=value, e.g. tracking.association.gate=1.2")
        result.setdefault(node, {})[parameter] = read_yaml(value, f"--param {text!r}")
    return result


def zone_parameters(file: Path | None) -> dict[str, dict[str, Any]]:
    """Say to the nodes of a graph what a zones file holds: `parse_parameters` goes before it; nothing without a file.

    A `ConfigError` names file, line and zone, when one makes no sense.
    """
    if file is None:
        return {}
    from radar_core.config import load_file
    from radar_tracking.zones import LayoutConfig

    areas = list(load_file(LayoutConfig, file).areas)
    return {"zones": {"zones_file": str(file.resolve())}, "tracking": {"zones.areas": areas} if areas else {}}


def merged(parameters: dict[str, dict[str, Any]], given: dict[str, dict[str, Any]]) -> dict[str, dict[str, Any]]:
    """Put parameters of nodes together; those that were ``given`` win."""
    return {node: {**parameters.get(node, {}), **given.get(node, {})} for node in {**parameters, **given}}
