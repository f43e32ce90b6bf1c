"""A unit that logs its beginning and its end; workers import it by its name."""

import os
import signal
import time
from dataclasses import dataclass
from pathlib import Path

from turtlebot_gym_agents.cluster.units import Result


@dataclass(frozen=True, kw_only=True)
class Logged:
    """A unit that takes a while."""

    number: int
    folder: str
    seconds: float = 0.4
    holds: bool = False
    """Whether it never ends by itself if it begins before the folder has a file ``go``."""
    memory = 0
    size = 1

    def about(self):
        return {"logged": self.number}

    def run(self):
        stays = self.holds and not (Path(self.folder) / "go").exists()
        self._log("begin")
        time.sleep(120.0 if stays else self.seconds)
        self._log("end")
        blocked = signal.pthread_sigmask(signal.SIG_BLOCK, ())
        return Result({"number": self.number, "hears": signal.SIGINT not in blocked}, {}, {}, {})

    def _log(self, event):
        log = os.open(Path(self.folder) / "log", os.O_WRONLY | os.O_APPEND | os.O_CREAT)
        os.write(log, f"{event} {self.number} {os.getpid()}\n".encode())  # in one piece
        os.close(log)


@dataclass(frozen=True, kw_only=True)
class Deadly:
    """A unit that kills the process in which it runs."""

    folder: str
    memory = 0
    size = 1

    def about(self):
        return {"deadly": True}

    def run(self):
        Logged(number=0, folder=self.folder)._log("begin")
        os.kill(os.getpid(), signal.SIGKILL)


def read(folder):
    """Return the lines of a log: event, number, process."""
    path = Path(folder) / "log"
    lines = path.read_text().splitlines() if path.is_file() else []
    return [(event, int(number), int(process)) for event, number, process in map(str.split, lines)]
