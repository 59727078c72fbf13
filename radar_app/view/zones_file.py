"""Zones drawn on the page: the file that they are kept in, changed one zone at a time."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import yaml

from radar_core import ConfigError
from radar_core.config import load, load_file
from radar_core.yaml_text import read_yaml
from radar_tracking.zones import LayoutConfig

_WIDTH = 120


class ZonesFile:
    """A zones file, which may not exist yet.

    Every change reads the file, changes one zone and leaves all else as it was, but for comments; the text of before is kept beside it,
    with ``.bak`` behind its name.
    """

    def __init__(self, path: Path) -> None:
        self.path = Path(path)

    def layout(self) -> LayoutConfig:
        """Read it; no zones while there is no file. A `ConfigError` names file and line of what makes no sense."""
        return load_file(LayoutConfig, self.path) if self.path.exists() else LayoutConfig()

    def save(self, name: str, kind: str, corners: Sequence[tuple[float, float]]) -> LayoutConfig:
        """Add a zone, or give the one of that name another shape and kind; returns all zones.

        A `ConfigError` says why it is none, or that the file cannot be written; nothing is changed then.
        """
        data = self._read()
        zones = data.setdefault("zones", [])
        zone = next((zone for zone in zones if zone.get("name") == name), None)
        if zone is None:
            zone = {"name": name}
            zones.append(zone)
        zone["polygon"] = [[round(float(x), 3), round(float(y), 3)] for x, y in corners]
        zone.pop("kind", None)
        if kind != "counting":
            zone["kind"] = kind
        return self._write(data)

    def remove(self, name: str) -> LayoutConfig:
        """Take a zone out; returns those that are left. A `ConfigError` says that there is none of that name."""
        data = self._read()
        kept = [zone for zone in data.get("zones", []) if zone.get("name") != name]
        if len(kept) == len(data.get("zones", [])):
            raise ConfigError(f"{self.path} has no zone {name!r}; it may have been changed meanwhile")
        data["zones"] = kept
        return self._write(data)

    def _read(self) -> dict[str, Any]:
        self.layout()  # what makes no sense is not written again
        if not self.path.exists():
            return {}
        data = read_yaml(self.path.read_text(encoding="utf-8"), self.path) or {}
        data["zones"] = [dict(zone) for zone in data.get("zones") or []]
        return dict(data)

    def _write(self, data: dict[str, Any]) -> LayoutConfig:
        layout = load(LayoutConfig, data, str(self.path))
        text = yaml.dump(data, Dumper=_Dumper, sort_keys=False, allow_unicode=True, width=_WIDTH)
        partial = self.path.with_name(f"{self.path.name}.partial")
        try:
            partial.write_text(text, encoding="utf-8")
            if self.path.exists():
                self.path.with_name(f"{self.path.name}.bak").write_bytes(self.path.read_bytes())
            os.replace(partial, self.path)
        except OSError as error:
            partial.unlink(missing_ok=True)
            raise ConfigError(
                f"{self.path}: cannot be written ({error.strerror}); start the page with --zones and a file of yours"
            ) from None
        return layout


class _Dumper(yaml.SafeDumper):
    """Writes lists of numbers, and of such lists, on one line, as people write polygons."""


def _list(dumper: yaml.SafeDumper, items: list[Any]) -> yaml.Node:
    flat = all(isinstance(item, (int, float, list)) for item in items)
    return dumper.represent_sequence("tag:yaml.org,2002:seq", items, flow_style=flat and bool(items))


_Dumper.add_representer(list, _list)
