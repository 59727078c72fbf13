"""Names of a package that are imported only when they are used, so that importing the package stays cheap."""

from __future__ import annotations

import importlib
from collections.abc import Callable, Mapping
from typing import Any


def lazily(package: str, homes: Mapping[str, str]) -> Callable[[str], Any]:
    """Make a package's ``__getattr__`` (PEP 562).

    Parameters
    ----------
    package : str
        Its ``__name__``.
    homes : mapping of str to str
        Module within the package, by the names it exports, separated by blanks: ``{"Track Tracks": "tracks"}``.

    Returns
    -------
    callable
        Takes a name; raises `AttributeError` for one that the package does not have.
    """
    modules = {name: f"{package}.{module}" for names, module in homes.items() for name in names.split()}

    def find(name: str) -> Any:
        if name not in modules:
            raise AttributeError(f"module {package!r} has no attribute {name!r}")
        return getattr(importlib.import_module(modules[name]), name)

    return find
