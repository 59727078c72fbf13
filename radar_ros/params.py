"""Configurations as ROS parameters: one parameter per knob, described, with unit and range."""

from __future__ import annotations

import dataclasses
import traceback
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any, Generic, TypeVar

from rcl_interfaces.msg import FloatingPointRange, IntegerRange, ParameterDescriptor, SetParametersResult
from rclpy.exceptions import InvalidParameterTypeException, InvalidParameterValueException
from rclpy.parameter import Parameter

from radar_core import ConfigError, HandwaveError
from radar_core.config import describe, load, nearest, nest
from radar_ros import heartbeat

T = TypeVar("T")
_OWN = ("use_sim_time", "start_type_description_service")  # declared or read by rclpy itself


def declare(
    node: Any,
    name: str,
    default: Any,
    doc: str,
    *,
    unit: str = "",
    low: float | None = None,
    high: float | None = None,
    choices: Sequence[Any] | None = None,
    changeable: bool = False,
) -> Any:
    """Declare one parameter and return its value; it is read only unless ``changeable``.

    A `ConfigError` names the parameter, when the value given is of the wrong type or out of range.
    """
    descriptor = ParameterDescriptor(description=f"{doc} [{unit}]" if unit else doc, read_only=not changeable, dynamic_typing=True)
    if choices is not None:
        descriptor.additional_constraints = "one of " + ", ".join(map(repr, choices))
    if isinstance(default, float) and (low is not None or high is not None):
        start, end = -1e308 if low is None else float(low), 1e308 if high is None else float(high)
        descriptor.floating_point_range = [FloatingPointRange(from_value=start, to_value=end)]
    elif isinstance(default, int) and not isinstance(default, bool) and (low is not None or high is not None):
        start, end = -(2**62) if low is None else int(low), 2**62 if high is None else int(high)
        descriptor.integer_range = [IntegerRange(from_value=start, to_value=end)]
    given = node._parameter_overrides.get(name)
    meant = _meant(default, given)
    if meant is not None:
        return node.declare_parameter(name, meant, descriptor, ignore_override=True).value
    try:
        return node.declare_parameter(name, default, descriptor).value
    except (InvalidParameterTypeException, InvalidParameterValueException) as error:
        shown = f" (given {given.value!r})" if given is not None else ""
        raise ConfigError(f"parameter {name} of node {node.get_name()}{shown}: {error}; {doc}") from None


def _meant(default: Any, given: Any) -> Any:
    """Value that `ros2 param dump` wrote and ROS's reader of parameter files takes for something else; None: there is no such thing.

    An empty list has no type there, and arrives as nothing. The words y and n are written without quotes, and arrive as true and false.
    """
    if given is not None and isinstance(default, list) and given.type_ == Parameter.Type.NOT_SET:
        return []
    if given is not None and isinstance(default, str) and given.type_ == Parameter.Type.BOOL:
        return "y" if given.value else "n"
    return None


def declare_config(
    node: Any, cls: type[T], prefix: str = "", *, changeable: bool | Callable[[str], bool] = False, base: T | None = None
) -> T:
    """Declare one parameter per knob of ``cls`` (made with `radar_core.config.config`) and build it from their values.

    ``prefix`` is put before every name, e.g. ``"consistency."``. ``changeable`` ones (all, or those whose name a function accepts) may be
    set while the node runs; then call `on_change` too. Defaults are those of ``base``, None: of the class. A `ConfigError` names the
    parameter that makes no sense.
    """
    values: dict[str, Any] = {}
    for name, field, default in _knobs(cls, base):
        limits: dict[str, Any] = {key: field.metadata[key] for key in ("unit", "low", "high", "choices") if key in field.metadata}
        may = changeable(name) if callable(changeable) else changeable
        values[name] = declare(node, prefix + name, default, field.metadata.get("doc", name), **limits, changeable=may)
    return _build(node, cls, values)


def on_change(node: Any, current: T, prepare: Callable[[T], Callable[[], None]], prefix: str = "") -> None:
    """Let the parameters of a configuration be set while the node runs, all that come in one call together or not at all.

    ``declare_config(node, ..., prefix, changeable=True)`` gave the ``current`` one. ``prepare`` is called with the new configuration. It
    makes whatever the node needs to work with it, changes nothing yet, and returns a function that puts it in place. That function is
    called between two callbacks of the node, once nobody refuses the new values. A `HandwaveError` refuses them: its text goes to whoever
    set the parameters, and the node works on with the old ones. So does any other error, because a trial must not end a running node.
    """
    changes = _Changes(node, current, prepare, prefix)
    node.add_on_set_parameters_callback(changes.check)
    node.add_post_set_parameters_callback(changes.put_in_place)


class _Changes(Generic[T]):
    """One configuration of a node, whose parameters are set while it runs; see `on_change`."""

    def __init__(self, node: Any, current: T, prepare: Callable[[T], Callable[[], None]], prefix: str) -> None:
        self._node, self._held, self._prepare = node, current, prepare
        self._names = {prefix + name: name for name, _, _ in _knobs(type(current))}
        self._pending: tuple[T, Callable[[], None], str] | None = None

    def check(self, parameters: Sequence[Any]) -> SetParametersResult:
        """Refuse new values, or prepare to work with them."""
        self._pending = None
        ours = [p for p in parameters if p.name in self._names]
        said = ", ".join(f"{p.name} = {p.value!r}" for p in ours)
        log = self._node.get_logger()
        try:
            wanted = _changed(self._node, type(self._held), self._names, ours) if ours else self._held
            if wanted != self._held:
                self._pending = wanted, heartbeat.busy()(self._prepare)(wanted), said
        except HandwaveError as error:
            log.error(f"refused {said}: {error}")
            return SetParametersResult(successful=False, reason=str(error))
        except Exception as error:
            log.error(f"refused {said}, because of a fault of this program:\n{traceback.format_exc()}")
            return SetParametersResult(successful=False, reason=f"{type(error).__name__}: {error}")
        return SetParametersResult(successful=True)

    def put_in_place(self, _: Sequence[Any]) -> None:
        """Work with the values that were prepared; every other callback has accepted them too."""
        if self._pending is not None:
            wanted, place, said = self._pending
            place()
            self._held = wanted
            self._node.get_logger().info(f"works with {said} from now on")


def _knobs(cls: Any, base: Any = None) -> Iterator[tuple[str, dataclasses.Field[Any], Any]]:
    """List the knobs that can be ROS parameters, which are never empty or nested (the others are set in files): name, field, default."""
    for name, field, _ in describe(cls, base=base):
        default = list(field.default) if isinstance(field.default, tuple) else field.default
        nested = isinstance(default, list) and bool(default) and isinstance(default[0], (list, tuple))
        if default is not None and default is not dataclasses.MISSING and not nested:
            yield name, field, default


def _build(node: Any, cls: type[T], values: Mapping[str, Any]) -> T:
    plain = {name: list(value) if hasattr(value, "__len__") and not isinstance(value, str) else value for name, value in values.items()}
    return load(cls, nest(plain), f"parameters of node {node.get_name()}")


def _changed(node: Any, cls: type[T], names: Mapping[str, str], given: Sequence[Any]) -> T:
    """Build the configuration from the node's parameters, those that are about to be set instead of the old ones."""
    for parameter in given:
        if parameter.type_ == Parameter.Type.NOT_SET:
            raise ConfigError(f"parameter {parameter.name} of node {node.get_name()} cannot be deleted; set it to its default instead")
    values = {name: node.get_parameter(full).value for full, name in names.items()}
    values.update({names[parameter.name]: parameter.value for parameter in given})
    return _build(node, cls, values)


def explained(node: Any, parameters: Sequence[Any], result: SetParametersResult) -> SetParametersResult:
    """Say why parameters cannot be set that are read only, which rclpy does not; any other result stays as it is."""
    fixed = [p.name for p in parameters if node.has_parameter(p.name) and node.describe_parameter(p.name).read_only]
    if not result.successful and fixed:
        names = ", ".join(fixed)
        advice = " ".join(f"-p {name}:=..." for name in fixed)
        result.reason = f"{names} cannot change while the node runs, because {node.fixed_because}; start it anew with {advice}"
    return result


def refuse_unknown(node: Any) -> None:
    """Raise `ConfigError` when parameters were given that the node does not have; rclpy would ignore them in silence."""
    unknown = [n for n in node._parameter_overrides if not node.has_parameter(n) and n not in _OWN and not n.startswith("qos_overrides.")]
    if unknown:
        known = sorted(n for n in node._parameters if n not in _OWN)
        named = ", ".join(f"{name!r}{nearest(name, known)}" for name in unknown)
        raise ConfigError(f"node {node.get_name()} has no parameter {named}; it knows: {', '.join(known)}")
