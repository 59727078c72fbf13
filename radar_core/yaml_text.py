"""YAML as everything here reads it: a key stands once, `77e9` is a number, and whatever is wrong is a `ConfigError` that says where."""

from __future__ import annotations

import re
from collections.abc import Hashable
from typing import Any, Final

import yaml

from radar_core.errors import ConfigError

_FLOAT: Final = re.compile(r"[-+]?[0-9]+(\.[0-9]*)?[eE][-+]?[0-9]+$")  # which YAML 1.1 takes for text


class _Loader(yaml.SafeLoader):
    """Refuses a key that stands twice: the second value would silently win."""

    def construct_mapping(self, node: Any, deep: bool = False) -> dict[Hashable, Any]:
        """Make a mapping, as PyYAML does."""
        seen: set[Any] = set()
        for key, _ in node.value if isinstance(node, yaml.MappingNode) else ():
            if key.value in seen and isinstance(key, yaml.ScalarNode):
                raise yaml.constructor.ConstructorError(None, None, f"the key {key.value!r} stands twice", key.start_mark)
            if isinstance(key, yaml.ScalarNode):
                seen.add(key.value)
        return super().construct_mapping(node, deep)


_Loader.add_implicit_resolver("tag:yaml.org,2002:float", _FLOAT, list("-+0123456789"))


def read_yaml(text: str, source: object) -> Any:
    """Read a YAML document; None when it is empty. ``source`` says where it stands, for the message.

    Raises
    ------
    ConfigError
        When it is no YAML, or a key stands twice.
    """
    return read_document(text, source)[0]


def read_document(text: str, source: object) -> tuple[Any, yaml.Node | None]:
    """Read a YAML document, with its nodes, so that messages can name lines."""
    try:
        loader = _Loader(text)
        node = loader.get_single_node()
        return None if node is None else loader.construct_document(node), node
    except Exception as error:  # of hostile text: YAMLError, ValueError, RecursionError, OverflowError and others
        raise ConfigError(f"{source}: not valid YAML: {error or type(error).__name__}") from None
