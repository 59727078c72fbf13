"""Configurations as ROS parameters: one parameter per knob, described, with unit and range."""

from __future__ import annotations

import dataclasses
from typing import Any, TypeVar

from rcl_interfaces.msg import FloatingPointRange, IntegerRange, ParameterDescriptor
from rclpy.exceptions import InvalidParameterTypeException, InvalidParameterValueException

from radar_core import ConfigError
from radar_core.config import describe, load, nest

T = TypeVar("T")
_OWN = ("use_sim_time", "start_type_description_service")  # declared or read by rclpy itself


def declare(node: Any, name: str, default: Any, doc: str, *, unit: str = "", low: float | None = None, high: float | None = None) -> Any:
    """Declare one parameter and return its value.

    Raises
    ------
    ConfigError
        Naming the parameter, when the value given is of the wrong type or out of range.
    """
    descriptor = ParameterDescriptor(description=f"{doc} [{unit}]" if unit else doc, read_only=True, dynamic_typing=True)
    if isinstance(default, float) and (low is not None or high is not None):
        descriptor.floating_point_range = [
            FloatingPointRange(from_value=-1e308 if low is None else float(low), to_value=1e308 if high is None else float(high))
        ]
    elif isinstance(default, int) and not isinstance(default, bool) and (low is not None or high is not None):
        descriptor.integer_range = [
            IntegerRange(from_value=-(2**62) if low is None else int(low), to_value=2**62 if high is None else int(high))
        ]
    try:
        return node.declare_parameter(name, default, descriptor).value
    except (InvalidParameterTypeException, InvalidParameterValueException) as error:
        given = node._parameter_overrides.get(name)
        shown = f" (given {given.value!r})" if given is not None else ""
        raise ConfigError(f"parameter {name} of node {node.get_name()}{shown}: {error}; {doc}") from None


def declare_config(node: Any, cls: type[T], prefix: str = "") -> T:
    """Declare one parameter per knob of ``cls`` and build it from their values.

    Parameters
    ----------
    node : rclpy.node.Node
        Whose parameters they become.
    cls : type
        A class made with `radar_core.config.config`.
    prefix : str
        Put before every name, e.g. ``"tracker."``.

    Raises
    ------
    ConfigError
        Naming the parameter that makes no sense.
    """
    values: dict[str, Any] = {}
    for name, field, _ in describe(cls):
        default = list(field.default) if isinstance(field.default, tuple) else field.default
        if (
            default is None
            or default is dataclasses.MISSING
            or (isinstance(default, list) and default and isinstance(default[0], (list, tuple)))
        ):
            continue  # ROS parameters are never empty or nested: such knobs are set in files
        meta = field.metadata
        value = declare(
            node, prefix + name, default, meta.get("doc", name), unit=meta.get("unit", ""), low=meta.get("low"), high=meta.get("high")
        )
        values[name] = list(value) if isinstance(default, list) else value
    return load(cls, nest(values), f"parameters of node {node.get_name()}")


def refuse_unknown(node: Any) -> None:
    """Raise `ConfigError` when parameters were given that the node does not have; rclpy would ignore them in silence."""
    unknown = [n for n in node._parameter_overrides if not node.has_parameter(n) and n not in _OWN and not n.startswith("qos_overrides.")]
    if unknown:
        known = ", ".join(sorted(n for n in node._parameters if n not in _OWN))
        raise ConfigError(f"node {node.get_name()} has no parameter {', '.join(map(repr, unknown))}; it knows: {known}")
