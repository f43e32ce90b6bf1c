"""The options of commands whose work can be spread: where its units run, and where their results are kept."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, NamedTuple

import tyro

if TYPE_CHECKING:
    from turtlebot_gym_agents.cluster.store import Store
    from turtlebot_gym_agents.cluster.work import Workers


class Place(NamedTuple):
    """Who does units, and where results are kept: arguments of `cluster.work.complete`."""

    workers: Workers
    store: Store | None


@dataclass(frozen=True, kw_only=True)
class Placement:
    """Where the work is done; its results do not depend on it."""

    cluster: str | None = None
    """Do the work on Ray, with the extra [cluster]: "local", one worker for each core of this machine; "auto", the cluster that
    this machine belongs to; or the ADDRESS of one, HOST:PORT."""
    workers: int | None = None
    """With --cluster local: how many work at the same time."""
    store: Annotated[Path | None, tyro.conf.arg(metavar="FOLDER")] = None
    """Folder where the result of each unit of work is kept as it comes; what is there is not done again."""

    @property
    def spread(self) -> bool:
        """Whether the work is cut into units."""
        return self.cluster is not None or self.store is not None

    @contextmanager
    def place(self, *, memory: int, store: Path | None = None) -> Iterator[Place]:
        """Provide workers for as long as the block lasts.

        Args:
            memory: What a unit needs, bytes.
            store: Where results are kept if nothing else was told.
        """
        from turtlebot_gym_agents.cluster.store import Store
        from turtlebot_gym_agents.cluster.work import in_turn

        self.require_cluster()
        folder = self.store or store
        kept = None if folder is None else Store(folder)
        if self.cluster is None:
            yield Place(in_turn, kept)
            return
        from turtlebot_gym_agents.cluster.ray_workers import ray_workers

        with ray_workers(self.cluster, workers=self.workers, memory=memory) as workers:
            yield Place(workers, kept)

    def require_cluster(self) -> None:
        """Raise ValueError if there are workers without a cluster."""
        if self.workers is not None and self.cluster is None:
            raise ValueError("workers is an option of a cluster: add --cluster local.")

    def settings(self) -> Mapping[str, Any]:
        """Return what results depend on: all options but where the work is done and where results are written."""
        elsewhere = {item.name for item in fields(Placement)} | {"json", "plot", "storage", "resume", "wandb"}
        return {name: value for name, value in asdict(self).items() if name not in elsewhere}
