"""Message definitions of recordings: what an older version recorded is translated where nothing is guessed, and refused elsewhere."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from rosbags.interfaces import MessageDefinitionFormat, Nodetype
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from rosbags.typesys.store import Typestore

from radar_core import DataError

_EARLIER: dict[str, Any] = {f"earlier_{name}": np.empty(0, np.uint64) for name in ("sequence", "processed", "dropped", "monotonic_ns")}
_EARLIER |= {"earlier_stamp_ns": np.empty(0, np.int64), "earlier_compute_s": np.empty(0)}
_ADDED: Mapping[str, Mapping[str, Any]] = {
    "handwave/msg/HandTrack": {"velocity_rank": 0, "velocity_condition": math.nan, "outliers": 0},
    "handwave/msg/PointCloud": {"every": 1},
    "handwave/msg/CloudSource": {"every": 1},
    "handwave/msg/TrackArray": {"every": 1},
    "handwave/msg/Gesture": {"position": np.full(3, math.nan), "zones": [], "labels": []},
    "handwave/msg/StageStatus": {"stale": False, **_EARLIER},
    "handwave/msg/Truth": {"labels": []},
}
"""Fields that came later, by message type, and what stands for them in recordings without."""


def as_recorded(msgtype: str, definition: str) -> Typestore:
    """Message types as a recording itself defines them.

    ``definition`` is that of the type and of the messages in it, in the form of ``.msg`` files, as MCAP embeds them.
    """
    store = get_typestore(Stores.EMPTY)
    store.register(get_types_from_msg(definition, msgtype))
    return store


def _known(ours: Typestore, theirs: Typestore, msgtype: str) -> bool:
    """Whether a type, and those of the messages in it, lack only fields that are known to have come later."""
    if msgtype not in ours.fielddefs:
        return False
    fields, added = theirs.fielddefs[msgtype][1], _ADDED.get(msgtype, {})
    names = {name for name, _ in fields}
    if fields != [field for field in ours.fielddefs[msgtype][1] if field[0] in names or field[0] not in added]:
        return False
    return all(_known(ours, theirs, inner) for inner in (_message_in(kind) for _, kind in fields) if inner)


def _message_in(kind: Any) -> str:
    """Name of the message that a field holds one or many of; empty: numbers or text."""
    form, inner = kind
    if form in (Nodetype.ARRAY, Nodetype.SEQUENCE):
        form, inner = inner[0]
    return str(inner) if form is Nodetype.NAME else ""


def _renewed(ours: Typestore, theirs: Typestore, old: Any, msgtype: str) -> Any:
    """Make a message of this version of one that `_known` found to lack nothing else, messages in it included."""
    values = dict(_ADDED.get(msgtype, {}))
    for name, kind in theirs.fielddefs[msgtype][1]:
        value, inner = getattr(old, name), _message_in(kind)
        if inner and kind[0] is Nodetype.NAME:
            value = _renewed(ours, theirs, value, inner)
        elif inner:
            value = [_renewed(ours, theirs, one, inner) for one in value]
        values[name] = value
    return ours.types[msgtype](**values)


def translator_of(path: Path, connection: Any, ours: Typestore) -> Callable[[bytes], bytes] | None:
    """Find out how to read the messages of one connection (``rosbags.interfaces.Connection``) of a bag.

    Returns what makes a serialised message of this version (``ours``) of a recorded one; None: they are the same, the type is none of ours,
    or the bag embeds no definition. A `DataError` names bag and topic, when the definition is another than ours in more than the fields
    that are known to have come later.
    """
    msgtype, embedded = connection.msgtype, connection.msgdef.format is MessageDefinitionFormat.MSG
    if not embedded or not msgtype.startswith("handwave/") or msgtype not in ours.fielddefs:
        return None
    theirs = as_recorded(msgtype, connection.msgdef.data)
    if theirs.hash_rihs01(msgtype) == ours.hash_rihs01(msgtype):
        return None
    if not _known(ours, theirs, msgtype):
        other = f"{msgtype} was recorded by another version of this package, which defines it otherwise"
        raise DataError(f"{path}: {connection.topic}: {other}; read it with that version, or record again")

    def translate(data: bytes) -> bytes:
        new = _renewed(ours, theirs, theirs.deserialize_cdr(data, msgtype), msgtype)
        return bytes(ours.serialize_cdr(new, msgtype))

    return translate
