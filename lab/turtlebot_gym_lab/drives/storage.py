"""The files of a bag: which ones belong to it, and what of them is intact, also after a power cut.

``metadata.yaml`` only says which files there are: each file is read by itself, so that one that is damaged, or whose recording
was cut off, costs its own messages alone.
"""

from __future__ import annotations

import re
import textwrap
from collections.abc import Collection, Iterator
from contextlib import ExitStack, contextmanager
from itertools import islice
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, NamedTuple

from turtlebot_gym.files import load, regular
from turtlebot_gym_lab.drives.salvage import (
    MCAP,
    ROS_1,
    SQLITE,
    ZSTD,
    ZSTD_START,
    closed,
    copied,
    has_journal,
    suffix_of,
    unpacked,
)

_SPLIT = re.compile(r"(?P<stem>.*?)(_(?P<number>\d+))?(?P<suffix>\.db3|\.mcap|\.bag)(\.active|\.zstd)*$")
"""Name of a bag's file, with its number where the recorder began another file."""
_REINDEX = "its recording was not closed: repair a copy of it, as by `rosbag reindex`"


class Message(NamedTuple):
    """A message of a bag."""

    topic: str
    received: int
    """When it was recorded, ns."""
    value: Any
    """The message, or None if it cannot be decoded."""


class Bag:
    """An open bag.

    Args:
        path: A bag's folder, or a file of one.
        folder: Folder for what must be unpacked or repaired.
        stack: Closes the files.

    Raises:
        ValueError: If nothing in it can be read.
    """

    def __init__(self, path: Path, folder: Path, stack: ExitStack) -> None:
        self.remarks: list[str] = []
        """What was left out, and what is missing."""
        self._path, self._folder, self._stack = path, folder, stack
        self._readers: list[tuple[Path, Any]] = []
        files, failed = self._files(), []
        for file in files:
            try:
                self._readers.append((file, self._open(file)))
            except ValueError as error:
                failed.append(error)
        if len(failed) == len(files):
            raise failed[0]
        self.remarks += [f"{error}: the file is left out" for error in failed]

    @property
    def kinds(self) -> dict[str, str]:
        """Types of the messages, by topic."""
        return {each.topic: each.msgtype for each in self._connections()}

    @property
    def silent(self) -> set[str]:
        """Topics without messages: a recorder names every topic that it subscribes."""
        heard = {each.topic for each in self._connections() if each.msgcount}
        return set(self.kinds) - heard if heard else set()

    def _connections(self) -> list[Any]:
        return [each for _, reader in self._readers if reader is not None for each in reader.connections]

    @property
    def is_ros_1(self) -> bool:
        """Whether the bag is one of ROS 1."""
        return any(reader is not None and not reader.is2 for _, reader in self._readers)

    def messages(self, topics: Collection[str]) -> Iterator[Message]:
        """Yield the messages on some topics, in the order in which each file's were recorded."""
        for at, (file, reader) in enumerate(self._readers):
            read = 0
            try:
                for message in _messages(reader, topics):
                    read += 1
                    yield message
            except Exception as error:  # decoding raises whatever the storage and the codec raise
                repaired = self._repaired(file, error)
                self._readers[at] = file, repaired
                yield from islice(_messages(repaired, topics), read, None)

    def _files(self) -> list[Path]:
        """Return the files of the bag in the order of their recording."""
        if not self._path.exists():
            raise ValueError(f"{self._path}: there is no such bag.")
        if not self._path.is_dir():
            return [self._path]
        found = sorted(file for file in self._path.iterdir() if not file.is_dir() and _SPLIT.match(file.name))
        named, stems = self._named(), {_key(file)[0] for file in found}
        for name in named:
            if not (self._path / name).exists():
                self.remarks.append(f"{self._path}: {name} is missing: its messages are left out")
        if named:
            stems = {_key(Path(name))[0] for name in named}
        elif len(stems) > 1:
            raise ValueError(f"{self._path}: the folder holds several bags, and no metadata.yaml: give one of its files.")
        files = {_key(file): file for file in reversed(found) if _key(file)[0] in stems}  # x.db3 rather than x.db3.zstd
        if not files:
            inner = next((f": did you mean {each}?" for each in self._path.iterdir() if (each / "metadata.yaml").exists()), "")
            raise ValueError(
                f"{self._path}: the bag is damaged or incomplete: the folder holds no .mcap, .db3 or .bag file{inner or '.'}"
            )
        numbers = [number for _, number in sorted(files)]
        missing = sorted(set(range(numbers[0], numbers[-1])) - set(numbers)) if not named else []
        self.remarks += [f"{self._path}: the file with number {number} is missing" for number in missing[:3]]
        return [regular(files[key]) for key in sorted(files)]

    def _named(self) -> list[str]:
        """Return the names of the files in ``metadata.yaml``."""
        about = self._path / "metadata.yaml"
        if not about.exists():
            bags_of_ros_1 = any(self._path.glob("*.bag"))
            self.remarks += [] if bags_of_ros_1 else [f"{self._path}: metadata.yaml is missing: the files are read without it"]
            return []
        try:
            named = load(about)["rosbag2_bagfile_information"]["relative_file_paths"]
            return [Path(name).name for name in named]
        except (ValueError, TypeError, LookupError):
            self.remarks.append(f"{self._path}: metadata.yaml is damaged: the files are read without it")
            return []

    def _open(self, file: Path) -> Any:
        """Return a reader of a file; None if it holds nothing."""
        if not file.stat().st_size:
            self.remarks.append(f"{self._named_as(file)}the file is empty: the recording was cut off")
            return None
        source = file
        if suffix_of(source) == ZSTD:
            source, is_whole = unpacked(file, self._folder)
            self.remarks += [] if is_whole else [f"{self._named_as(file)}the file is cut short: its beginning is read"]
        if has_journal(file):
            source = closed(file, self._folder)
            self.remarks.append(f"{self._named_as(file)}the recording was not closed: what its journal holds is read, too")
        try:
            reader = self._reader(source)
            if not reader.message_count and file != self._path:
                self.remarks.append(f"{self._named_as(file)}the file holds no messages")
            return reader
        except Exception as error:  # storage plugins raise errors of their own, sqlite3's among them
            return self._repaired(source, error, file)

    def _named_as(self, file: Path) -> str:
        """Return the beginning of a message about one of the files."""
        return f"{self._path}: " if file == self._path else f"{self._path}: {file.name}: "

    def _reader(self, file: Path) -> Any:
        from rosbags.highlevel import AnyReader
        from rosbags.typesys import Stores, get_typestore

        suffix = suffix_of(file)
        if suffix not in (None, file.suffix):  # the name says to rosbags what a file holds
            link = self._folder / f"{len(list(self._folder.iterdir()))}{suffix}"
            link.symlink_to(file.absolute())
            file = link
        reader = AnyReader([file], default_typestore=get_typestore(Stores.ROS2_JAZZY))
        return self._stack.enter_context(reader)

    def _repaired(self, source: Path, error: Exception, file: Path | None = None) -> Any:
        """Return a reader of what is intact in a damaged file, and say so."""
        file = file or source
        if isinstance(error, MemoryError):
            raise error
        suffix = suffix_of(source)
        if suffix not in (MCAP, SQLITE):
            why = _REINDEX if suffix == ROS_1 else _line(error)
            raise ValueError(f"{self._named_as(file)}the bag is damaged or incomplete: {why}") from error
        try:
            copy, about = copied(source, self._folder, suffix)
            reader = self._reader(copy)
        except Exception as failure:
            if isinstance(failure, (ImportError, MemoryError)):
                raise
            why = f"no message is intact: {_line(error)}"
            raise ValueError(f"{self._named_as(file)}the bag is damaged or incomplete: {why}") from error
        self.remarks.append(f"{self._named_as(file)}{about}")
        return reader


@contextmanager
def opened(path: Path) -> Iterator[Bag]:
    """Open a bag; see `Bag`.

    Raises:
        ImportError: If rosbags is not installed.
    """
    try:
        import rosbags.highlevel  # noqa: F401  # pyright: ignore[reportUnusedImport]
    except ImportError as error:
        raise ImportError(f"{path} is a bag, which needs rosbags: pip install 'rosbags>=0.10.9,<0.12'") from error
    with TemporaryDirectory() as folder, ExitStack() as stack:
        yield Bag(path, Path(folder), stack)


def _messages(reader: Any | None, topics: Collection[str]) -> Iterator[Message]:
    if reader is None:
        return
    wanted = [connection for connection in reader.connections if connection.topic in topics]
    for connection, received, data in reader.messages(wanted) if wanted else ():
        if data[:4] == ZSTD_START:  # compressed by message; a message begins with its encoding
            import zstandard

            data = zstandard.decompress(data)
        try:
            value = reader.deserialize(data, connection.msgtype)
        except MemoryError:
            raise
        except Exception:
            value = None
        yield Message(connection.topic, received, value)


def _key(file: Path) -> tuple[str, int]:
    """Return the bag's name and the number of one of its files."""
    parts = _SPLIT.match(file.name)
    assert parts is not None
    return f"{parts['stem']}{parts['suffix']}", int(parts["number"] or -1)


def _line(error: BaseException) -> str:
    """Return an error's text on one line, shortened: a library's may hold all definitions of a damaged file."""
    return textwrap.shorten(str(error), 300, placeholder=" ...") or type(error).__name__
