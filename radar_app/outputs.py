"""Where results go besides ROS topics: what ``--mqtt`` and ``--osc`` say, as parameters of the nodes."""

from __future__ import annotations

from typing import Any
from urllib.parse import urlsplit

from radar_core import ConfigError

_MQTT = "write --mqtt [mqtt[s]://][user@]host[:port], e.g. homeassistant.local or mqtts://radar@broker.example:8883"
_OSC = "write --osc host:port, e.g. localhost:9000"


def mqtt_parameters(text: str, password_file: str | None = None) -> dict[str, Any]:
    """Turn an address into parameters of the node ``mqtt``.

    Parameters
    ----------
    text : str
        ``[mqtt[s]://][user@]host[:port]``; ``mqtts`` encrypts.
    password_file : str or None
        File with the password.

    Raises
    ------
    ConfigError
        When it is no such address, or holds a password, which everybody on this machine could read in the list of processes.
    """
    from radar_ros.home.broker import PASSWORD

    scheme, slashes, rest = text.partition("://")
    parts = _split(rest if slashes else text, _MQTT)
    if parts.password is not None:
        raise ConfigError(f"--mqtt: no password here, others could see it; put it into a file (--mqtt-password-file) or into {PASSWORD}")
    if slashes and scheme not in ("mqtt", "mqtts"):
        raise ConfigError(f"--mqtt: {scheme}:// is not known; {_MQTT}")
    found: dict[str, Any] = {"host": parts.hostname}
    if parts.port:
        found["port"] = parts.port
    if parts.username:
        found["user"] = parts.username
    if scheme == "mqtts" and slashes:
        found["tls"] = True
    if password_file:
        found["password_file"] = password_file
    return found


def osc_parameters(text: str) -> dict[str, Any]:
    """Turn ``host:port`` into parameters of the node ``osc``; a `ConfigError` says when it is none."""
    parts = _split(text, _OSC)
    if parts.port is None or parts.username is not None:
        raise ConfigError(f"--osc {text!r}: {_OSC}")
    return {"host": parts.hostname, "port": parts.port}


def outputs(mqtt: str | None, password_file: str | None, osc: str | None, parameters: dict[str, dict[str, Any]]) -> tuple[str, ...]:
    """Put what the options say into ``parameters``, where a single parameter wins; returns the names of the nodes that are asked for."""
    if password_file and not mqtt:
        raise ConfigError("--mqtt-password-file is of use only with --mqtt")
    wanted = {}
    if mqtt:
        wanted["mqtt"] = mqtt_parameters(mqtt, password_file)
    if osc:
        wanted["osc"] = osc_parameters(osc)
    for node, values in wanted.items():
        parameters[node] = {**values, **parameters.get(node, {})}
    return tuple(wanted)


def _split(address: str, advice: str) -> Any:
    try:
        parts = urlsplit(f"//{address}")
        port = parts.port  # raises where it is no port
    except ValueError as error:
        raise ConfigError(f"{error}; {advice}") from None
    if not parts.hostname or parts.path or parts.query or parts.fragment or port == 0:
        raise ConfigError(f"this is no address of a machine; {advice}")
    return parts
