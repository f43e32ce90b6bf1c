"""A rosbag2 bag that loses at most the messages since its last commit.

It is written as sqlite3, so that committed messages survive a ``kill -9``. After a kill of the recorder the folder has
``NAME.db3`` without its ``metadata.yaml``, which ``ros2 bag reindex`` makes.

A disk that is full ends a bag early, and complete: the last commit stands, and `RESERVE` bytes, held since the start, are given
back for ``metadata.yaml``.
"""

from __future__ import annotations

import sqlite3
from contextlib import closing, suppress
from pathlib import Path
from typing import Any, NamedTuple

from ament_index_python import get_package_share_directory
from rosbags.interfaces import Connection, Nodetype, Qos, QosDurability, QosHistory, QosLiveliness, QosReliability, QosTime
from rosbags.rosbag2 import Writer
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from rosbags.typesys.store import Typestore

RESERVE = 2**20
"""Space that a bag holds back to finish itself on a full disk, bytes."""
_FOREVER = QosTime(2147483647, 4294967295)
_LATCHED = Qos(
    QosHistory.KEEP_LAST,
    1,
    QosReliability.RELIABLE,
    QosDurability.TRANSIENT_LOCAL,
    _FOREVER,
    _FOREVER,
    QosLiveliness.AUTOMATIC,
    _FOREVER,
    avoid_ros_namespace_conventions=False,
)


class _Closed(NamedTuple):
    """Stands for the storage of a bag whose database is closed already, so that only the metadata are still written."""

    path: Path

    def close(self, version: int, metadata: str) -> None:
        """Do nothing."""


class Bag:
    """A bag written as sqlite3 that loses at most the messages since the last commit.

    Its methods raise an error of `FULL` if the disk takes no more; `end_early` then finishes it.
    """

    FULL = (sqlite3.Error, OSError)

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self._types = get_typestore(Stores.ROS2_JAZZY)
        self._writer, self._reserve = Writer(folder, version=9), folder / "reserve"
        try:
            self._writer.open()
            self._reserve.write_bytes(bytes(RESERVE))
            self.commit()
        except sqlite3.Error as error:
            raise OSError(f"no bag can be written in {folder}: {error}") from None

    def add(self, topic: str, kind: str, *, latched: bool) -> Connection:
        """Open a topic for messages of a type such as ``nav_msgs/msg/Odometry``.

        Raises:
            LookupError: If the definition of the type is not installed.
        """
        _teach(self._types, kind)
        qos = [_LATCHED] if latched else []
        return self._writer.add_connection(topic, kind, typestore=self._types, offered_qos_profiles=qos)

    def write(self, connection: Connection, stamp: int, data: bytes) -> None:
        """Append a serialized message, received at a time in ns."""
        self._writer.write(connection, stamp, data)

    def commit(self) -> None:
        """Commit all messages so far."""
        # rosbags commits only at the end; this attribute is private, hence its upper bound in pyproject.toml.
        writer = self._writer
        writer.storage.conn.commit()  # type: ignore[union-attr]
        self._committed = len(writer.connections), dict(writer.counts), writer.min_timestamp, writer.max_timestamp

    def end_early(self) -> None:
        """Finish the bag after an error, with all messages that still fit, and at least those of the last commit."""
        self._reserve.unlink(missing_ok=True)
        writer = self._writer
        if writer.storage is None:  # it is closed already
            return
        database = writer.storage.conn  # type: ignore[union-attr]
        try:
            if not database.in_transaction:  # sqlite has taken the transaction back itself
                raise sqlite3.OperationalError
            self.commit()
        except self.FULL:
            with suppress(*self.FULL):  # a transaction that is open when a database closes is taken back too
                database.rollback()
            count, writer.counts, writer.min_timestamp, writer.max_timestamp = self._committed
            del writer.connections[count:]
        database.close()
        with closing(sqlite3.connect(writer.storage.path)) as anew:  # takes back what the failed transaction left in the file
            anew.execute("SELECT COUNT(*) FROM messages")
        writer.storage = _Closed(writer.storage.path)  # type: ignore[assignment,union-attr]
        writer.close()

    def close(self) -> None:
        """Finish the bag."""
        self._reserve.unlink()
        self._writer.close()


def _teach(types: Typestore, kind: str) -> None:
    """Load a message type unknown to rosbags, and the types it consists of, from the ROS installation."""
    if kind in types.fielddefs:
        return
    package, _, name = kind.split("/")
    text = Path(get_package_share_directory(package), "msg", f"{name}.msg").read_text(encoding="utf-8")
    learned = get_types_from_msg(text, kind)
    for _, field in learned[kind][1]:
        element: Any = field[1][0] if field[0] in (Nodetype.ARRAY, Nodetype.SEQUENCE) else field
        if element[0] == Nodetype.NAME:
            _teach(types, element[1])
    types.register(learned)
