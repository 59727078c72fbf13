"""Every number of every configuration: NaN and infinity are refused by name, wherever a knob is, now and when one is added."""

import dataclasses
import functools
import importlib
import math
import pkgutil

import pytest

from radar_core import ConfigError
from radar_core.config import check_knobs

PACKAGES = ("radar_core", "radar_sim", "radar_driver", "radar_dsp", "radar_tracking", "radar_gestures", "radar_lab")
OPTIONAL = ("radar_lab.blender", "radar_lab.camera.mediapipe_pose", "radar_lab.training.cnn")


@functools.cache
def configurations() -> list[type]:
    """Every class with knobs of the packages that need no ROS."""
    found = {}
    for package in PACKAGES:
        root = importlib.import_module(package)
        for info in pkgutil.walk_packages(root.__path__, f"{package}."):
            if ".nodes" in info.name or info.name.endswith((".node", ".messages")) or info.name.startswith(OPTIONAL):
                continue
            for value in vars(importlib.import_module(info.name)).values():
                if (
                    isinstance(value, type)
                    and dataclasses.is_dataclass(value)
                    and any("doc" in f.metadata for f in dataclasses.fields(value))
                ):
                    found[f"{value.__module__}.{value.__name__}"] = value
    return list(found.values())


def numbers(cls: type) -> list[str]:
    """Knobs that are a number by default."""
    fields = [f for f in dataclasses.fields(cls) if "doc" in f.metadata and not isinstance(f.default, bool)]
    return [f.name for f in fields if isinstance(f.default, (int, float))]


def test_all_configurations_are_found():
    """The walk sees the packages: fewer would mean that it has lost its way."""
    assert len(configurations()) > 60
    assert sum(len(numbers(cls)) for cls in configurations()) > 300


@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf], ids=str)
def test_no_knob_takes_what_is_no_number(bad):
    """A comparison with NaN is False, so a range check alone lets it through; the message names class and knob."""
    for cls in configurations():
        for name in numbers(cls):
            instance = object.__new__(cls)  # some need other knobs: only the check of the knobs matters here
            for field in dataclasses.fields(cls):
                value = field.default_factory() if field.default_factory is not dataclasses.MISSING else field.default
                object.__setattr__(instance, field.name, () if value is dataclasses.MISSING else value)
            object.__setattr__(instance, name, bad)
            with pytest.raises(ConfigError, match=rf"{cls.__name__}\.{name} is"):
                check_knobs(instance)


@pytest.mark.parametrize("bad", [math.nan, math.inf])
def test_lists_of_numbers_are_looked_into(bad):
    """Boxes of zones, walls, positions of elements: one bad entry is enough."""
    from radar_core import AntennaArray
    from radar_tracking.people.zones import ZonesConfig

    with pytest.raises(ConfigError, match=r"AntennaArray\.rx"):
        AntennaArray(rx=((0.0, 0.0), (bad, 0.0)))
    with pytest.raises(ConfigError, match=r"ZonesConfig\.boundaries"):
        ZonesConfig(boundaries=(0.0, bad, 0.0, 1.0))
