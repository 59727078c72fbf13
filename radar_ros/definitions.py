"""Message definitions of recordings: what an older version recorded is translated where nothing is guessed, and refused elsewhere."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from rosbags.interfaces import MessageDefinitionFormat
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from rosbags.typesys.store import Typestore

from radar_core import DataError

_ADDED: Mapping[str, Mapping[str, Any]] = {
    "handwave/msg/HandTrack": {"velocity_rank": 0, "velocity_condition": math.nan, "outliers": 0},
}
"""Fields that came later, by message type, and what stands for them in recordings without."""


def as_recorded(msgtype: str, definition: str) -> Typestore:
    """Message types as a recording itself defines them.

    Parameters
    ----------
    msgtype : str
        E.g. ``handwave/msg/HandTrack``.
    definition : str
        Its definition and those of the messages in it, in the form of ``.msg`` files, as MCAP embeds them.
    """
    store = get_typestore(Stores.EMPTY)
    store.register(get_types_from_msg(definition, msgtype))
    return store


def translator(ours: Typestore, msgtype: str, definition: str) -> Callable[[bytes], bytes] | None:
    """Find out how to read messages of a recording.

    Parameters
    ----------
    ours : Typestore
        Message types of this version.
    msgtype, definition : str
        As for `as_recorded`.

    Returns
    -------
    callable or None
        Makes a serialised message of this version of a recorded one; None: they are the same, or the type is none of ours.

    Raises
    ------
    DataError
        When the definition is another than ours in more than the fields that are known to have come later.
    """
    if not msgtype.startswith("handwave/") or msgtype not in ours.fielddefs:
        return None
    theirs = as_recorded(msgtype, definition)
    if theirs.hash_rihs01(msgtype) == ours.hash_rihs01(msgtype):
        return None
    added = _ADDED.get(msgtype, {})
    fields = theirs.fielddefs[msgtype][1]
    if not added or fields != [field for field in ours.fielddefs[msgtype][1] if field[0] not in added]:
        raise DataError(
            f"{msgtype} was recorded by another version of this package, which defines it otherwise; read it with that version, or record "
            "again"
        )

    def translate(data: bytes) -> bytes:
        old = theirs.deserialize_cdr(data, msgtype)
        new = ours.types[msgtype](**{name: getattr(old, name) for name, _ in fields}, **added)
        return bytes(ours.serialize_cdr(new, msgtype))

    return translate


def translator_of(path: Path, connection: Any, ours: Typestore) -> Callable[[bytes], bytes] | None:
    """Find out how to read the messages of one connection of a bag.

    Parameters
    ----------
    path : Path
        The bag, for the error.
    connection : rosbags.interfaces.Connection
        As the reader lists it.
    ours : Typestore
        Message types of this version.

    Returns
    -------
    callable or None
        As of `translator`; None also where the bag embeds no definition.

    Raises
    ------
    DataError
        Naming bag and topic, when an older version recorded something else.
    """
    if connection.msgdef.format is not MessageDefinitionFormat.MSG:
        return None
    try:
        return translator(ours, connection.msgtype, connection.msgdef.data)
    except DataError as error:
        raise DataError(f"{path}: {connection.topic}: {error}") from None
