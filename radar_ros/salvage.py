"""Damaged recordings: one door that nothing foreign leaves, checksums of what is written, and every whole message of a file that is not."""

from __future__ import annotations

import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from radar_core import DataError, HandwaveError

if TYPE_CHECKING:  # nodes that neither record nor repair start without mcap
    from mcap.records import Channel, Chunk, Message, Schema

_CHECKSUM_AT: Final = 9 + 3 * 8  # bytes from the start of a chunk's record: opcode, length, two times and a size are before it


@contextmanager
def door(path: Path, advice: str = "check the path, or try: handwave repair") -> Iterator[None]:
    """Read a recording that may be damaged in any way: whatever the libraries that read it raise becomes a `DataError`.

    Not for writing: a full disk has to stay an `OSError`.
    """
    try:
        yield
    except HandwaveError:
        raise
    except Exception as error:
        if not Path(path).exists():
            raise DataError(f"{path}: there is no such recording; give its folder") from None
        said = str(error) or type(error).__name__
        raise DataError(f"{path}: cannot be read as a bag ({said}); {advice} {path}") from None


def write_checksums(storage: Any) -> None:
    """Let rosbags' MCAP writer put the checksum of every chunk into its record, where it writes 0 (not known)."""
    close = storage.close_chunk

    def close_chunk() -> None:
        checksum, start = zlib.crc32(storage.chunk.bio.getbuffer()), storage.bio.tell()
        close()
        end = storage.bio.tell()
        storage.bio.seek(start + _CHECKSUM_AT)
        storage.bio.write(checksum.to_bytes(4, "little"))
        storage.bio.seek(end)

    storage.close_chunk = close_chunk


def salvage(file: Path) -> Iterator[tuple[Schema, Channel, Message]]:
    """Every whole message of a file: up to where it is cut off, without those of chunks whose checksum is wrong."""
    from mcap.records import Channel, Message, Schema

    schemas: dict[int, Schema] = {}
    channels: dict[int, Channel] = {}
    for record in _records(file):  # all of them before the messages: the summary at the end has them again
        if isinstance(record, Schema):
            schemas.setdefault(record.id, record)
        elif isinstance(record, Channel):
            channels.setdefault(record.id, record)
    for record in _records(file):
        if isinstance(record, Message) and record.channel_id in channels:
            channel = channels[record.channel_id]
            if channel.schema_id in schemas:
                yield schemas[channel.schema_id], channel, record


def _records(file: Path) -> Iterator[Any]:
    """Give the records of a file, those within chunks included, as far as they can be read."""
    from mcap.records import Chunk
    from mcap.stream_reader import StreamReader

    size = file.stat().st_size
    with file.open("rb") as stream:
        records = iter(StreamReader(stream, emit_chunks=True, record_size_limit=size).records)
        while True:
            try:
                record = next(records, None)
            except Exception:  # the cut; damaged lengths raise whatever they raise
                return
            if record is None:
                return
            yield from _inside(record) if isinstance(record, Chunk) else (record,)


def _inside(chunk: Chunk) -> list[Any]:
    """Give the records of a chunk; none when it is damaged."""
    from mcap.stream_reader import breakup_chunk

    try:
        return list(breakup_chunk(chunk, validate_crc=True))
    except Exception:
        return []
