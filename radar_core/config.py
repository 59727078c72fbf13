"""Configurations: frozen dataclasses that validate themselves, with units and ranges beside every knob.

A configuration is declared once and serves everywhere: the library constructs it, a YAML file is loaded into it with errors that name file,
line and key, and a node declares one ROS parameter per knob with the same description, unit and range.
"""

from __future__ import annotations

import copy
import dataclasses
import difflib
import functools
import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import Any, Literal, TypeVar, get_args, get_origin, get_type_hints

import yaml
from pydantic import TypeAdapter, ValidationError
from typing_extensions import dataclass_transform

from radar_core.errors import ConfigError
from radar_core.lookalikes import lookalikes
from radar_core.yaml_text import read_document

T = TypeVar("T")


def knob(
    default: Any = dataclasses.MISSING,
    *,
    doc: str,
    unit: str = "",
    low: float | None = None,
    high: float | None = None,
    choices: Sequence[Any] | None = None,
) -> Any:
    """Declare one field of a configuration.

    Parameters
    ----------
    default : Any
        Value when the user says nothing; missing: the user must say.
    doc : str
        One sentence for users.
    unit : str
        Unit of the value, e.g. ``"m"``; empty for pure numbers and names.
    low, high : float or None
        Inclusive range of a number (of each entry, for a tuple).
    choices : sequence or None
        The only values allowed, where they are known only at run time (a registry, say). None: those of a ``Literal`` annotation, if it is
        one: write ``name: Literal["slow", "fast"] = knob("slow", doc="...")``.

    Returns
    -------
    Any
        A dataclass field that carries the description.
    """
    metadata = {"doc": doc, "unit": unit, "low": low, "high": high, "choices": tuple(choices) if choices is not None else None}
    return dataclasses.field(default=default, metadata=metadata)


# knob is not named as a field specifier: type checkers only know `default=` there, and a positional default reads better.
@dataclass_transform(frozen_default=True, kw_only_default=True, field_specifiers=(dataclasses.field,))
def config(cls: type[T]) -> type[T]:
    """Make ``cls`` a frozen, keyword-only dataclass that checks its knobs, then calls its ``validate`` method if it has one.

    Raises
    ------
    ConfigError
        On construction, when a knob is outside its range or not among its choices, or a number is not finite.
    """

    def check(self: Any) -> None:
        check_knobs(self)
        validate = getattr(self, "validate", None)
        if validate is not None:
            validate()

    cls.__post_init__ = check  # type: ignore[attr-defined]
    cls.__pydantic_config__ = {"extra": "forbid"}  # type: ignore[attr-defined]
    return dataclasses.dataclass(frozen=True, kw_only=True)(cls)


def check_knobs(instance: Any) -> None:
    """Raise `ConfigError` when a field of ``instance`` is outside the range or the choices that its `knob` states."""
    choices = _choices(instance.__class__)
    for field in dataclasses.fields(instance):
        meta = field.metadata
        if "doc" not in meta:
            continue
        where = f"{type(instance).__name__}.{field.name}"
        value = getattr(instance, field.name)
        _check_choice(where, value, choices.get(field.name))
        for number in _numbers(value):
            if not math.isfinite(number):
                raise ConfigError(f"{where} is {number}; it must be a finite number")
            _check_range(where, number, meta)


@functools.cache
def _choices(cls: type) -> Mapping[str, tuple[Any, ...]]:
    """Values that the fields of a configuration may have, of those fields that have choices: from `knob` or from a ``Literal``."""
    hints = get_type_hints(cls)
    found = {field.name: field.metadata.get("choices") or _literals(hints[field.name]) for field in dataclasses.fields(cls)}
    return MappingProxyType({name: choices for name, choices in found.items() if choices is not None})


def _literals(hint: Any) -> tuple[Any, ...] | None:
    """Values of a ``Literal``, alone, with ``None`` beside it, or of each entry of a tuple; None: the annotation has none."""
    if get_origin(hint) is Literal:
        return get_args(hint)
    inside = [part for part in get_args(hint) if part not in (type(None), ...)]
    values = _literals(inside[0]) if len(inside) == 1 else None
    return (*values, None) if values is not None and type(None) in get_args(hint) else values


def _check_choice(where: str, value: Any, choices: tuple[Any, ...] | None) -> None:
    """Raise `ConfigError` when a value is none of the choices; of a tuple that is no choice itself, each entry has to be one."""
    if choices is None or value in choices:
        return
    entries = value if isinstance(value, tuple) and not isinstance(choices[0], tuple) else (value,)
    for entry in entries:
        if entry not in choices:
            raise ConfigError(f"{where} is {_other_than(entry, choices)}")


def _other_than(value: Any, choices: tuple[Any, ...]) -> str:
    return f"{value!r}{nearest(value, choices)}; choose one of {', '.join(map(repr, choices))}"


def nearest(given: Any, known: Iterable[Any]) -> str:
    """Name what was probably meant, for a message: ``" (did you mean 'gate'?)"``; empty where nothing is near."""
    near = difflib.get_close_matches(str(given), [str(name) for name in known if name is not None], n=1)
    return f" (did you mean {near[0]!r}?)" if near else ""


def _numbers(value: Any) -> Iterator[float]:
    if isinstance(value, (int, float)) and not isinstance(value, bool):
        yield value
    elif isinstance(value, tuple):
        for entry in value:
            yield from _numbers(entry)


def _check_range(where: str, number: float, meta: Mapping[str, Any]) -> None:
    low, high, unit = meta["low"], meta["high"], meta["unit"]
    if (low is not None and number < low) or (high is not None and number > high):
        bounds = f"at least {low:g}" if high is None else f"at most {high:g}" if low is None else f"between {low:g} and {high:g}"
        raise ConfigError(f"{where} is {number:g}; it must be {bounds}{' ' + unit if unit else ''} ({meta['doc']})")


def load(cls: type[T], data: Any, source: str = "configuration", lines: yaml.Node | None = None) -> T:
    """Build a configuration from plain data, refusing unknown keys and wrong types.

    Parameters
    ----------
    cls : type
        A class decorated with `config` (or a dataclass of such).
    data : Any
        Mappings, sequences and scalars, as YAML gives them; None means all defaults.
    source : str
        File name for the error message.
    lines : yaml.Node or None
        The composed YAML document, to name lines.

    Raises
    ------
    ConfigError
        Naming source, line, key and what was expected.
    """
    try:
        made: T = _adapter(cls).validate_python(_complete(cls, {} if data is None else data))  # type: ignore[arg-type]  # a class has a hash
    except ValidationError as error:
        problems = [_explain(cls, problem, source, lines) for problem in error.errors()]
        raise ConfigError("\n".join(problems)) from None
    except RecursionError:
        raise ConfigError(f"{source}: it is nested too deeply") from None
    if problems := [f"{_place(source, lines, place)}: {'.'.join(map(str, place))}: {text}" for place, text in lookalikes(data, made)]:
        raise ConfigError("\n".join(problems))
    return made


@functools.cache
def _adapter(cls: Any) -> TypeAdapter[Any]:
    """Make the checks of a class once: for a tracker's configuration it takes 50 ms."""
    return TypeAdapter(cls)


def load_file(cls: type[T], path: str | Path) -> T:
    """Load a YAML file into a configuration; errors name file, line and key.

    Raises
    ------
    ConfigError
        When the file is missing, is not YAML, or does not describe a ``cls``.
    """
    path = Path(path)
    try:
        text = path.read_text(encoding="utf-8")
    except OSError as error:
        raise ConfigError(f"{path}: cannot read it ({error.strerror or error}); check the path") from None
    except UnicodeDecodeError as error:
        raise ConfigError(f"{path}: is no text ({error}); check the path") from None
    data, lines = read_document(text, path)
    return load(cls, data, str(path), lines)


def _complete(cls: Any, data: Any) -> Any:
    """Add what a configuration's default for a nested one says otherwise than the nested one's own class; what is given stays."""
    if not (isinstance(data, Mapping) and dataclasses.is_dataclass(cls)):
        return data
    result = dict(data)
    for field in dataclasses.fields(cls):
        if dataclasses.is_dataclass(field.default) and isinstance(result.get(field.name), Mapping):
            result[field.name] = _complete(type(field.default), _merged(plain(field.default), result[field.name]))
    return result


def _merged(base: Mapping[str, Any], data: Mapping[str, Any]) -> dict[str, Any]:
    """Put ``data`` over ``base``, mappings into mappings."""
    both = (name for name in base if isinstance(base[name], Mapping) and isinstance(data.get(name), Mapping))
    return {**base, **data, **{name: _merged(base[name], data[name]) for name in both}}


def _explain(cls: type, problem: Any, source: str, lines: yaml.Node | None) -> str:
    location = [part for part in problem["loc"] if not str(part).startswith("function-")]
    location += getattr(problem.get("ctx", {}).get("error"), "key", ())
    where = _place(source, lines, location)
    key = ".".join(map(str, location)) or "(top level)"
    if problem["type"] in ("unexpected_keyword_argument", "extra_forbidden"):
        owner = _inside(cls, location[:-1])
        known = [field.name for field in dataclasses.fields(owner)] if owner is not None else []
        return f"{where}: unknown key '{key}'{nearest(location[-1], known)}" + (f"; known here: {', '.join(known)}" if known else "")
    if problem["type"] in ("missing", "missing_argument"):
        return f"{where}: '{key}' is missing; add it"
    if problem["type"] == "literal_error":
        names = [part for part in location if isinstance(part, str)]
        owner = _inside(cls, location[: location.index(names[-1])])
        return f"{where}: {key} is {_other_than(problem['input'], _choices(owner)[names[-1]])}"
    message = str(problem["msg"]).removeprefix("Value error, ")
    given = problem.get("input")
    shown = f" (given {given!r})" if isinstance(given, (str, int, float, bool)) and problem["type"] != "value_error" else ""
    return f"{where}: {key}: {message}{shown}"


def _place(source: str, lines: yaml.Node | None, location: Sequence[Any]) -> str:
    """Name a source, and the line where it is known."""
    line = _line_of(lines, location)
    return f"{source}:{line}" if line else source


def _line_of(node: yaml.Node | None, location: Sequence[Any]) -> int | None:
    if node is None:
        return None
    for part in location:
        child = _child(node, part)
        if child is None:
            break
        node = child
    return int(node.start_mark.line) + 1


def _child(node: yaml.Node, part: Any) -> yaml.Node | None:
    if isinstance(node, yaml.MappingNode):
        for key, value in node.value:
            if key.value == str(part):
                # A scalar sits beside its key; a block starts on the line after it, so its key is the better place to point to.
                return value if isinstance(value, (yaml.MappingNode, yaml.SequenceNode)) else key
    elif isinstance(node, yaml.SequenceNode) and isinstance(part, int) and part < len(node.value):
        return node.value[part]  # type: ignore[no-any-return]
    return None


def _inside(cls: Any, location: Sequence[Any]) -> Any:
    """Find the configuration at a place within another one; None: there is none."""
    for part in location:
        if isinstance(part, str):
            if not dataclasses.is_dataclass(cls):
                return None
            cls = get_type_hints(cls).get(part)
        cls = _configuration(cls)
    return cls if dataclasses.is_dataclass(cls) else None


def _configuration(hint: Any) -> Any:
    """Find the configuration in ``X | None``, ``tuple[X, ...]`` and the like; None: there is none."""
    if dataclasses.is_dataclass(hint):
        return hint
    return next((found for found in map(_configuration, get_args(hint)) if found is not None), None)


def plain(instance: Any, base: Any = None) -> Any:
    """Turn a configuration into what its YAML file would hold: mappings, lists and scalars, without what has its default.

    `load` makes an equal configuration of it. ``base`` is what a nested one is when nothing is said; None: its class's defaults.
    """
    if isinstance(instance, tuple):
        return [plain(entry) for entry in instance]
    if not dataclasses.is_dataclass(instance):
        return instance
    result = {}
    for field in dataclasses.fields(instance):
        value, default = getattr(instance, field.name), field.default if type(base) is not type(instance) else getattr(base, field.name)
        if value != default:
            result[field.name] = plain(value, default)
    return result


def describe(cls: Any, prefix: str = "", base: Any = None) -> Iterator[tuple[str, dataclasses.Field[Any], Any]]:
    """List the knobs of a configuration class, nested ones with dotted names and the defaults that they have in this one.

    ``base`` is what a nested one is when nothing is said; None: its class's defaults.

    Yields
    ------
    tuple of (str, dataclasses.Field, type)
        Dotted name, field (its metadata has doc, unit, low, high, choices; those of a ``Literal`` too) and resolved type.
    """
    hints, choices = get_type_hints(cls), _choices(cls)
    for field in dataclasses.fields(cls):
        name, default = f"{prefix}{field.name}", field.default if base is None else getattr(base, field.name)
        if dataclasses.is_dataclass(hints[field.name]):
            yield from describe(hints[field.name], f"{name}.", default if isinstance(default, hints[field.name]) else None)
        else:
            here = copy.copy(field)
            here.default = default
            if "doc" in field.metadata:
                here.metadata = MappingProxyType({**field.metadata, "choices": choices.get(field.name)})
            yield name, here, hints[field.name]


def nest(flat: Mapping[str, Any]) -> dict[str, Any]:
    """Turn ``{"cfar.pfa": 1}`` into ``{"cfar": {"pfa": 1}}``, for `load`."""
    result: dict[str, Any] = {}
    for dotted, value in flat.items():
        *parents, last = dotted.split(".")
        place = result
        for parent in parents:
            place = place.setdefault(parent, {})
        place[last] = value
    return result


def flat(instance: Any) -> dict[str, Any]:
    """Give the values of all knobs of a configuration by dotted name, as `describe` lists them."""
    values = {}
    for name, _, _ in describe(type(instance)):
        place = instance
        for part in name.split("."):
            place = getattr(place, part)
        values[name] = place
    return values


def override(instance: T, knobs: Mapping[str, Any], source: str = "configuration") -> T:
    """Make a configuration like another one, some of its knobs set to other values.

    Parameters
    ----------
    instance : dataclass
        The other one; it stays as it is.
    knobs : mapping of str to value
        By dotted name, as `describe` lists them.
    source : str
        Who says so, for the error message.

    Raises
    ------
    ConfigError
        Naming the knob that there is not, or whose value makes no sense.
    """
    return load(type(instance), _merged(plain(instance), nest(knobs)), source)
