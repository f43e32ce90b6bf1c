"""What is intact in a damaged file of a bag, as a copy that has an end and an index.

References:
    MCAP's format, https://mcap.dev/spec: its records are read one after the other, without the index at their end.
    SQLite, "Write-Ahead Logging" and "Atomic Commit": what a journal beside a database is for.
"""

from __future__ import annotations

import shutil
import sqlite3
import struct
from collections.abc import Iterator
from contextlib import closing, suppress
from io import BytesIO
from pathlib import Path
from typing import Any

from turtlebot_gym.extras import installing

SQLITE, MCAP, ROS_1, ZSTD = ".db3", ".mcap", ".bag", ".zstd"
"""Name endings of the files of bags."""
ZSTD_START = b"\x28\xb5\x2f\xfd"
MAGIC = {b"SQLite format 3\0": SQLITE, b"\x89MCAP0\r\n": MCAP, b"#ROSBAG V2.0": ROS_1, ZSTD_START: ZSTD}
"""First bytes of the files of bags."""
_LONGEST = 2**28
"""Longest record of an MCAP file that is read, bytes."""
_TABLES = ("schema", "metadata", "topics", "message_definitions")
"""Small tables of a database; its messages are in another one."""


def suffix_of(path: Path) -> str | None:
    """Return the file name ending of a bag's file by its first bytes; None if they are another file's."""
    with path.open("rb") as file:
        first = file.read(16)
    return next((suffix for magic, suffix in MAGIC.items() if first.startswith(magic)), None)


def unpacked(path: Path, folder: Path) -> tuple[Path, bool]:
    """Return a decompressed copy of a file, and whether the file is whole."""
    import zstandard

    target = folder / path.with_suffix("").name
    with path.open("rb") as source, target.open("wb") as sink:
        try:
            zstandard.ZstdDecompressor().copy_stream(source, sink)
        except zstandard.ZstdError:
            return target, False
        return target, True


def has_journal(path: Path) -> bool:
    """Return whether a database was not closed: what its journal holds is missing from it, or has to be taken back."""
    return any(_beside(path, end).is_file() and _beside(path, end).stat().st_size for end in ("-wal", "-journal"))


def closed(path: Path, folder: Path) -> Path:
    """Return a copy of a database with what its journal holds."""
    copy = folder / path.name
    shutil.copyfile(path, copy)
    for end in ("-wal", "-journal"):
        if _beside(path, end).is_file():
            shutil.copyfile(_beside(path, end), _beside(copy, end))
    with suppress(sqlite3.Error), closing(sqlite3.connect(copy)) as database:
        database.execute("PRAGMA wal_checkpoint(TRUNCATE)")
        database.execute("PRAGMA journal_mode=DELETE")
    return copy


def copied(path: Path, folder: Path, suffix: str) -> tuple[Path, str]:
    """Return a copy of what is intact in a file, and a remark on it.

    Raises:
        ValueError: If no message is intact.
        ImportError: If the file is MCAP's, and mcap is not installed.
    """
    target = folder / f"intact-{path.stem}{suffix}"
    number, lost = (_copy_records if suffix == MCAP else _copy_rows)(path, target)
    if not number:
        raise ValueError("no message is intact")
    return target, f"the file is damaged or has no end, as after a power cut: {number} messages are read{lost}"


def _copy_records(path: Path, target: Path) -> tuple[int, str]:
    """Copy the intact messages of an MCAP file; return their number, and what is lost."""
    try:
        from mcap.records import Channel, Message, Schema
        from mcap.writer import CompressionType, Writer
    except ImportError as error:
        raise ImportError(f"{path} has no end, and reading it needs mcap: {installing('lab')}") from error
    schemas, channels, number, damaged = {0: 0}, {}, 0, []
    with target.open("wb") as sink:
        writer = Writer(sink, compression=CompressionType.NONE)
        writer.start(profile="ros2")
        for record in _records(path, damaged):
            if isinstance(record, Schema) and record.id not in schemas:
                schemas[record.id] = writer.register_schema(record.name, record.encoding, record.data)
            elif isinstance(record, Channel) and record.id not in channels and record.schema_id in schemas:
                channels[record.id] = writer.register_channel(
                    record.topic, record.message_encoding, schemas[record.schema_id], record.metadata
                )
            elif isinstance(record, Message) and record.channel_id in channels:
                times = record.log_time, record.publish_time
                writer.add_message(channels[record.channel_id], times[0], record.data, times[1], record.sequence)
                number += 1
        writer.finish()
    return number, f", {len(damaged)} damaged chunks are left out" if damaged else ""


def _records(path: Path, damaged: list[object]) -> Iterator[Any]:
    """Yield the records of an MCAP file up to the first one that is cut, without those of damaged chunks."""
    from mcap.records import Chunk
    from mcap.stream_reader import StreamReader, breakup_chunk

    with path.open("rb") as file:
        records, start = iter(StreamReader(file, emit_chunks=True, record_size_limit=_LONGEST).records), 8
        while True:
            try:
                record = next(records)
            except MemoryError:
                raise
            except Exception:  # the end, of whatever kind
                file.seek(start)
                yield from _of_cut_chunk(file.read(_LONGEST))
                return
            start = file.tell()
            if not isinstance(record, Chunk):
                yield record
                continue
            try:
                yield from breakup_chunk(record, validate_crc=True)
            except MemoryError:
                raise
            except Exception as error:  # decompression raises whatever the codec raises
                damaged.append(error)


def _of_cut_chunk(content: bytes) -> Iterator[Any]:
    """Yield the records at the beginning of a chunk whose end is missing; nothing of another record."""
    import zstandard
    from lz4.frame import LZ4FrameDecompressor
    from mcap.opcode import Opcode
    from mcap.stream_reader import StreamReader

    with suppress(Exception):  # whatever the codec raises: there is nothing more
        if content[:1] != bytes([Opcode.CHUNK]):
            return
        (length,) = struct.unpack_from("<I", content, 37)
        codec, packed = content[41 : 41 + length].decode(), content[49 + length :]
        if codec == "zstd":
            packed = zstandard.ZstdDecompressor().decompressobj().decompress(packed)
        elif codec == "lz4":
            packed = LZ4FrameDecompressor().decompress(packed)
        yield from StreamReader(BytesIO(packed), skip_magic=True).records


def _copy_rows(path: Path, target: Path) -> tuple[int, str]:
    """Copy the intact rows of a database: from its start up to the damage, and from its end back to it."""
    address = f"file:{path.absolute()}?mode=ro&immutable=1"
    with closing(sqlite3.connect(address, uri=True)) as source, closing(sqlite3.connect(target)) as copy:
        source.execute("PRAGMA writable_schema=ON")  # reads a file that is shorter than its header says
        made = "SELECT sql FROM sqlite_master WHERE type = 'table' AND name = ?"
        for name in (*_TABLES, "messages"):
            found = source.execute(made, (name,)).fetchone()
            if found is None:
                continue
            copy.execute(found[0])
            if name in _TABLES:
                with suppress(sqlite3.DatabaseError):
                    for row in source.execute(f"SELECT * FROM {name}"):
                        copy.execute(f"INSERT INTO {name} VALUES ({', '.join('?' * len(row))})", row)
        number = 0
        for order in ("ASC", "DESC"):
            with suppress(sqlite3.DatabaseError):
                for row in source.execute(
                    f"SELECT id, topic_id, timestamp, data FROM messages NOT INDEXED ORDER BY id {order}"
                ):
                    if not copy.execute("INSERT OR IGNORE INTO messages VALUES (?, ?, ?, ?)", row).rowcount:
                        break  # the rows from here on are copied
                    number += 1
        copy.commit()
    return number, ""


def _beside(path: Path, end: str) -> Path:
    return path.with_name(path.name + end)
