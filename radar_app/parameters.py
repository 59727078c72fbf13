"""Parameters of nodes on the command line: options, and what they say."""

from __future__ import annotations

from typing import Annotated, Any

import typer
import yaml

from radar_core import ConfigError
from radar_core.paths import find_config

Domain = Annotated[int | None, typer.Option(help="ROS domain; default: ROS_DOMAIN_ID, else 0", min=0, max=232)]
Namespace = Annotated[str, typer.Option(help="namespace of the graph, one per radar, e.g. left")]
Params = Annotated[
    list[str] | None, typer.Option("--param", "-p", help="node.parameter=value, e.g. tracking.association.gate=1.2; may be repeated")
]

Configs = Annotated[
    list[str] | None,
    typer.Option("--config", "-c", help="node=file, or one of ours by name, e.g. tracking=dense; --param goes before it; may be repeated"),
]


def _settings_of(node: str, name: str) -> dict[str, Any]:
    """Read a configuration file of a node; nested settings get dots, as ROS parameters are named."""
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
