"""The subcommand ``data``: the public recordings of the documentation, each fetched from its origin and checked by its hash."""

from __future__ import annotations

import hashlib
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, NamedTuple
from urllib.error import URLError
from urllib.request import urlopen

import tyro

from turtlebot_gym.files import read_bytes, replacing
from turtlebot_gym.validation import choose
from turtlebot_gym_agents.commands.console import print_tables, progress
from turtlebot_gym_agents.outputs import FOLDER

PATIENCE = 30.0
"""Longest wait for an answer, s."""
_WIFIBOT = (
    "https://raw.githubusercontent.com/CAOR-MINES-ParisTech/ukfm/4cc2a5f3809fe5575e194829d3c8ebdb9f49c4a7/python/examples/data"
)
_TURTLEBOT3 = (
    "https://raw.githubusercontent.com/Robust-Autonomous-Systems-Laboratory/project4_group4/"
    "faa0a3c6c8de866d43604f10d467691b95a8ec7c/rosbag2_2026_02_02-14_33_55"
)
_BAG = "rosbag2_2026_02_02-14_33_55_0.mcap"


class Recording(NamedTuple):
    """A file of a public recording."""

    url: str
    sha256: str
    size: int
    """bytes"""
    license: str


RECORDINGS = {
    "wifibot1.txt": Recording(
        f"{_WIFIBOT}/wifibot1.txt", "ae689d204ba4f68ff4fd9b776f0a549a4e5d042a9ffb369806df017988035445", 197_210, "BSD-3-Clause"
    ),
    "wifibot2.txt": Recording(
        f"{_WIFIBOT}/wifibot2.txt", "2b6025976d6e76ff34b3c0a7e47a748dac7ac00f17732f925257e41072c417f4", 710_117, "BSD-3-Clause"
    ),
    "turtlebot3/metadata.yaml": Recording(
        f"{_TURTLEBOT3}/metadata.yaml", "426a6f645b5825a0592f42a9b471651b942e909f2733e59f4d93c8f7e636ce9b", 12_890, "Apache-2.0"
    ),
    f"turtlebot3/{_BAG}": Recording(
        f"{_TURTLEBOT3}/{_BAG}", "58217cac5957c9dc3d57b52ffd939114daa1b78574844ac8850ff8e204b061e8", 3_873_215, "Apache-2.0"
    ),
}
"""Files by name in the folder of recordings."""


@dataclass(frozen=True, kw_only=True)
class Data:
    """Fetch the public recordings that the documentation uses, or list them. Each file is checked by its hash."""

    action: tyro.conf.Positional[str] = "list"
    """list or fetch."""
    out: Annotated[Path, FOLDER] = Path("data")
    """Folder of the recordings; existing files are not fetched again."""

    def run(self) -> None:
        choose("action", self.action, dict.fromkeys(("list", "fetch")))
        if self.action == "fetch":
            missing = [name for name in RECORDINGS if not self._has(name)]
            with progress(len(missing)) as advance_to:
                for done, name in enumerate(missing):
                    fetch(name, self.out)
                    advance_to(done + 1)
        from rich.table import Table

        table = Table("file", "bytes", "license", "there", "from", title=f"recordings in {self.out}")
        for name, recording in RECORDINGS.items():
            present = "yes" if self._has(name) else "no"
            table.add_row(name, f"{recording.size:,}", recording.license, present, recording.url.split("/")[3])
        print_tables(table)

    def _has(self, name: str) -> bool:
        path = self.out / name
        if not path.is_file():
            return False
        if hashlib.sha256(read_bytes(path)).hexdigest() == RECORDINGS[name].sha256:
            return True
        print(f"{path} is not the recording of that name: another hash.", file=sys.stderr)
        return False


def fetch(name: str, folder: Path) -> None:
    """Fetch a recording into a folder.

    Raises:
        OSError: If its origin cannot be reached.
        ValueError: If another file of that name is there, or the origin's is not the recorded one.
    """
    recording, path = RECORDINGS[name], folder / name
    if path.exists():
        raise ValueError(f"{path} exists and is not the recording: choose another folder with --out.")
    try:
        with urlopen(recording.url, timeout=PATIENCE) as answer:
            content = answer.read(recording.size + 1)
    except (URLError, TimeoutError) as error:
        raise OSError(f"{recording.url} cannot be reached: {getattr(error, 'reason', error)}.") from error
    if hashlib.sha256(content).hexdigest() != recording.sha256:
        raise ValueError(f"{recording.url}: it is not the recorded file: another hash. Nothing was kept.")
    with replacing(path) as beside:
        beside.write_bytes(content)
