"""Several rooms with a radar or several each, from one YAML file: every room is a graph in a namespace of its own."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from radar_app.graph import VARIANTS, NodeSpec, graph
from radar_app.parameters import dotted, merged, zone_parameters
from radar_core import ConfigError
from radar_core.config import config, knob, load_file, plain
from radar_ros.home.entities import slug
from radar_ros.nodes.mqtt import MqttConfig
from radar_ros.nodes.osc import OscConfig

_FILES = ("password_file", "ca_file", "certificate_file", "key_file")  # of mqtt


@config
class RoomConfig:
    """One room: what its nodes are started with."""

    name: str = knob(doc="of the room, for people, in any language")
    namespace: str = knob("", doc="of its topics; empty: made of the name, Living room becomes living_room")
    graph: str = knob("", doc="which nodes (handwave up --help); empty: what suits the board, else live")
    board: str = knob("", doc="where frames come from: a board, or a Python file with one of your own")
    scene: str = knob("", doc="scene of the simulated radars")
    zones: str = knob("", doc="file of the room's zones")
    without: tuple[str, ...] = knob((), doc="nodes to leave out")
    parameters: Mapping[str, Mapping[str, Any]] = knob(default=None, doc="parameters of nodes, as node: {parameter: value}")

    def validate(self) -> None:
        """Check names that have to fit."""
        if not self.name.strip():
            raise ConfigError("a room needs a name, e.g. Living room", key=("name",))
        if self.graph and self.graph not in VARIANTS:
            raise ConfigError(f"there is no graph {self.graph!r}; choose one of {', '.join(VARIANTS)}", key=("graph",))
        if self.namespace and not re.fullmatch(r"[A-Za-z]\w*", self.namespace, re.ASCII):
            raise ConfigError(f"namespace is {self.namespace!r}; it must be letters, digits and _, a letter first", key=("namespace",))

    @property
    def place(self) -> str:
        """Namespace of the room's nodes."""
        short = slug(self.name)
        return self.namespace or (short if short[0].isalpha() else f"room_{short}")


@config
class RoomsConfig:
    """All rooms of a house."""

    rooms: tuple[RoomConfig, ...] = knob(doc="the rooms")
    mqtt: MqttConfig | None = knob(None, doc="broker that all rooms are told to; nothing: none")
    osc: OscConfig | None = knob(None, doc="instrument that all rooms are told to; nothing: none")
    respawn: bool = knob(True, doc="start a node again that died")

    def validate(self) -> None:
        """Check that no two rooms share a namespace or, in the smart home, a device."""
        if not self.rooms:
            raise ConfigError("there is no room; give at least one, with its name", key=("rooms",))
        for what, found in (("namespace", [r.place for r in self.rooms]), ("name", [slug(r.name) for r in self.rooms])):
            for number, one in enumerate(found):
                if one in found[:number]:
                    raise ConfigError(f"two rooms have the same {what} ({one}); give each one of its own", key=("rooms", number))
        for settings in (self.mqtt, self.osc):
            for key in ("room", "prefix"):
                if getattr(settings, key, ""):
                    raise ConfigError(f"{key} is set for each room by its name; leave it out here")


def is_rooms_file(name: str) -> bool:
    """Whether it is the name of a file rather than of a graph."""
    return Path(name).suffix in (".yaml", ".yml")


def load_rooms(path: str | Path) -> RoomsConfig:
    """Load a file of rooms; files that it names may be given relative to its folder.

    Raises
    ------
    ConfigError
        Naming file, line and key.
    """
    folder, found = Path(path).parent, load_file(RoomsConfig, path)

    def beside(name: str) -> str:
        near = folder / name
        return str(near.resolve()) if name and near.is_file() else name

    rooms = tuple(replace(room, board=beside(room.board), scene=beside(room.scene), zones=beside(room.zones)) for room in found.rooms)
    files: dict[str, Any] = {key: beside(getattr(found.mqtt, key)) for key in _FILES} if found.mqtt else {}
    mqtt = found.mqtt and replace(found.mqtt, **files)
    return replace(found, rooms=rooms, mqtt=mqtt)


def with_board(variant: str, board: str | None, parameters: dict[str, dict[str, Any]]) -> str:
    """Let the driver use a board; returns the variant, where none was asked for the one that suits it, else ``live``."""
    if board:
        from radar_driver.boards import board as find_board

        found = find_board(board)
        parameters.setdefault("driver", {})["source"] = str(Path(board).resolve()) if board.endswith(".py") else board
        variant = variant or found.variant
    return variant or "live"


def rooms_graph(house: RoomsConfig) -> tuple[NodeSpec, ...]:
    """List the nodes of all rooms; a label begins with its room's namespace."""
    return tuple(spec for room in house.rooms for spec in _room_graph(room, house))


def _room_graph(room: RoomConfig, house: RoomsConfig) -> list[NodeSpec]:
    given: dict[str, dict[str, Any]] = {node: dotted(dict(values)) for node, values in (room.parameters or {}).items()}
    variant = with_board(room.graph, room.board, given)
    if room.scene or variant == "live":
        given.setdefault("driver", {}).setdefault("scene", room.scene or "demo")
    given = merged(zone_parameters(Path(room.zones) if room.zones else None), given)
    beside = []
    for name, settings in (("mqtt", house.mqtt), ("osc", house.osc)):
        if settings is not None:
            given[name] = {**plain(settings), **({"room": room.name} if name == "mqtt" else {}), **given.get(name, {})}
            beside.append(name)
    specs = graph(variant, namespace=room.place, parameters=given, without=room.without, beside=beside)
    return [replace(spec, place=spec.namespace) for spec in specs]
