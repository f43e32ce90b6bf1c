"""Options of commands whose work can be distributed: where units run, and where their results are stored."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, NamedTuple

import tyro

from turtlebot_gym_agents.outputs import FOLDER

if TYPE_CHECKING:
    from turtlebot_gym_agents.cluster.units import Store, Workers


class _Place(NamedTuple):
    """Workers and store: arguments of `cluster.units.complete`."""

    workers: Workers
    store: Store | None


@dataclass(frozen=True, kw_only=True)
class Placement:
    """Where the work runs; results do not depend on it."""

    cluster: str | None = None
    """Run the work in several processes: "local" for one per core of this machine; with the extra [cluster], "auto" for the Ray
    cluster that this machine belongs to, or the ADDRESS of one, HOST:PORT."""
    workers: int | None = None
    """With --cluster local: number of workers."""
    store: Annotated[Path | None, tyro.conf.arg(metavar="FOLDER"), FOLDER] = None
    """Folder for the result of each unit of work; units whose result is there are not repeated."""

    @property
    def spread(self) -> bool:
        """Whether the work is split into units."""
        return self.cluster is not None or self.store is not None

    @contextmanager
    def place(self, *, memory: int, store: Path | None = None) -> Iterator[_Place]:
        """Provide workers for the duration of the block.

        Args:
            memory: Memory of a unit, bytes.
            store: Default folder for results.
        """
        from turtlebot_gym_agents.cluster.units import Store, in_turn

        self.require_cluster()
        folder = self.store or store
        kept = None if folder is None else Store(folder)
        if self.cluster is None:
            yield _Place(in_turn, kept)
            return
        from turtlebot_gym_agents.cluster.workers import workers_on

        with workers_on(self.cluster, workers=self.workers, memory=memory) as workers:
            yield _Place(workers, kept)

    def require_cluster(self) -> None:
        """Raise ValueError if workers are given without a cluster."""
        if self.workers is not None and self.cluster is None:
            raise ValueError("workers is an option of a cluster: add --cluster local.")

    def settings(self) -> Mapping[str, Any]:
        """Return the options that results depend on."""
        elsewhere = {item.name for item in fields(Placement)} | {"json", "plot", "storage", "resume", "force", "wandb"}
        return {name: value for name, value in asdict(self).items() if name not in elsewhere}
