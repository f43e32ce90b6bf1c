"""The environments measured in this process: this package's, and Gymnasium's CartPole as their base.

Actions are sampled beforehand, infos are the default ones, and all returned arrays are new.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import Any

import gymnasium as gym

from harness.turns import Contender, timed
from turtlebot_gym.compiled.threads import limited
from turtlebot_gym_agents.training.randomization import randomized

NAV = "turtlebot_gym/TurtleBotNav-v0"
SQUARE = "turtlebot_gym/TurtleBotSquare-v0"
CARTPOLE = "CartPole-v1"
SIZES = (4096, 65_536)
OURS, GYMNASIUM = "turtlebot_gym", "gymnasium"


_MORE: dict[str, dict[str, Any]] = {
    "info full": {"info": "full"},
    "randomized": {"drawn": True},
    "fix late": {"fix": "late"},
}
"""What is measured for the first size only, by name."""


@contextmanager
def one_thread() -> Iterator[None]:
    """Let compiled loops use one thread."""
    with limited(1):
        yield


def base_of(size: int) -> str:
    """Return the name of the contender with which others of this number of environments are compared."""
    return name_of(size, CARTPOLE)


def name_of(size: int, *words: str) -> str:
    """Return a contender's name; a size of 1 is the scalar environment."""
    return ", ".join(["scalar" if size == 1 else f"vector of {size}", *words])


def _scalar(env_id: str, *, by: str, key: bool = False, **options: Any) -> Contender:
    """Return a scalar environment made by ``gym.make``."""
    env = gym.make(env_id, **options)
    env.reset(seed=0)
    env.action_space.seed(0)
    actions = [env.action_space.sample() for _ in range(256)]

    def step(k: int) -> None:
        _, _, terminated, truncated, _ = env.step(actions[k % 256])
        if terminated or truncated:
            env.reset()

    return Contender(run=timed(step), size=1, base=base_of(1), by=by, key=key)


def _vector(
    env_id: str, size: int, *, by: str, threads: int | None = None, key: bool = False, drawn: bool = False, **options: Any
) -> Contender:
    """Return a native vector environment; threads are None or 1, and parameters may be drawn for each as in trainings."""
    envs = gym.make_vec(env_id, num_envs=size, vectorization_mode="vector_entry_point", **options)
    if drawn:
        bare: Any = envs.unwrapped
        bare.set_parameters(randomized(bare.parameters, size, seed=0))
    envs.reset(seed=0)
    envs.action_space.seed(0)
    actions = [envs.action_space.sample() for _ in range(16)]
    step = timed(lambda k: envs.step(actions[k % 16]), one_thread) if threads else timed(lambda k: envs.step(actions[k % 16]))
    return Contender(run=step, size=size, base=base_of(size), by=by, threads=threads, key=key)


def contenders(sizes: Sequence[int] = SIZES) -> dict[str, Contender]:
    """Return scalar environments, and vector environments of each size, by name; CartPole is the first of each size.

    Args:
        sizes: Numbers of environments stepped together; more options are measured for the first one.
    """
    rows = {
        base_of(1): _scalar(CARTPOLE, by=GYMNASIUM, key=True),
        name_of(1, "TurtleBotNav-v0"): _scalar(NAV, by=OURS, key=True),
        name_of(1, "TurtleBotNav-v0", "filter tutorial"): _scalar(NAV, by=OURS, filter="tutorial"),
    }
    for size in sizes:
        rows[base_of(size)] = _vector(CARTPOLE, size, by=GYMNASIUM, key=True)
        for threads, words in ((None, ()), (1, ("one thread",))):
            rows[name_of(size, "TurtleBotNav-v0", *words)] = _vector(NAV, size, by=OURS, threads=threads, key=True)
            rough = _vector(NAV, size, by=OURS, threads=threads, noise="rough")
            rows[name_of(size, "TurtleBotNav-v0", "noise rough", *words)] = rough
            rows[name_of(size, "TurtleBotSquare-v0", *words)] = _vector(SQUARE, size, by=OURS, threads=threads)
            if size == sizes[0]:
                for name, chosen in _MORE.items():
                    rows[name_of(size, "TurtleBotNav-v0", name, *words)] = _vector(
                        NAV, size, by=OURS, threads=threads, **chosen
                    )
    return rows
