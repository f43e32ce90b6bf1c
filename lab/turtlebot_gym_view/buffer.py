"""A drive that grows while browsers read it."""

from __future__ import annotations

from threading import Lock

from turtlebot_gym.drive import Drive, concatenate


class DriveBuffer:
    """A drive that grows: the recorder adds pieces, and each browser reads at its own pace. Thread-safe.

    A `restart` begins another drive, such as the next episode; readers notice it by the drive's number.
    """

    def __init__(self, *pieces: Drive) -> None:
        self._lock, self._pieces, self._number = Lock(), list(pieces), 0

    def add(self, piece: Drive) -> None:
        """Add the next piece; a piece without rows changes only the outcome."""
        with self._lock:
            self._pieces.append(piece)

    def restart(self, piece: Drive) -> None:
        """Begin another drive with its first piece."""
        with self._lock:
            self._pieces, self._number = [piece], self._number + 1

    def read(self, number: int = -1, after: int = 0) -> tuple[int, Drive | None, int]:
        """Return the drive's number, the part that a reader has not yet read, and the number of pieces.

        Args:
            number: Number of the drive that the reader has read; another drive is read from its start.
            after: Number of pieces already read.

        Returns:
            The drive is None if there is nothing new.
        """
        with self._lock:
            fresh = self._pieces[after if number == self._number else 0 :]
            number, pieces = self._number, len(self._pieces)
        return number, concatenate(fresh) if fresh else None, pieces
