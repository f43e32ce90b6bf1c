"""Rules of a single autoreset mode. Each is a generator of the violations it sees; its docstring is the rule."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import closing

import numpy as np

from gymnasium_vector_checker.runs import FINAL, Case, Run, actions_of, difference, together

NO_END = "no episode ended: let make take max_episode_steps, or raise steps."


def next_step(case: Case) -> Iterator[str]:
    """After an end, the next step ignores that environment's action, and returns a first observation and reward 0."""
    with closing(case.open()) as env:
        run = Run(case, env)
        run.reset(1)
        ends = 0
        for _ in range(case.steps):
            ignored = run.ended
            _, rewards, terminated, truncated, _ = run.step()
            ends += ignored.sum()
            if rewards[ignored].any() or (terminated | truncated)[ignored].any():
                yield f"rewards {rewards!r}, ends {terminated | truncated!r} after the ends {ignored!r}."
        if not ends:
            yield NO_END
    seen = difference(case.play(1), case.play(1, junk=1))
    if seen is not None:
        yield f"with other actions after the ends, {seen}"


def same_step(case: Case) -> Iterator[str]:
    """At an end, infos hold the last observation and info in final_obs and final_info; their masks are true there only."""
    with closing(case.open()) as env:
        run = Run(case, env)
        run.reset(1)
        ends = 0
        for _ in range(case.steps):
            _, _, terminated, truncated, infos = run.step()
            done = terminated | truncated
            ends += done.sum()
            for key in FINAL:
                mask = infos.get(f"_{key}", np.zeros(case.num_envs, np.bool_))
                if not np.array_equal(mask, done):
                    yield f"_{key} is {mask!r} where the ends are {done!r}."
            for i in np.flatnonzero(done):
                if run.events[i][-2].observation not in env.single_observation_space:
                    yield f"final_obs of environment {i} is {run.events[i][-2].observation!r}."
        if not ends:
            yield NO_END


def final_objects(case: Case) -> Iterator[str]:
    """In infos final_obs is an array of objects, None where no episode ended, as SyncVectorEnv has it."""
    with closing(case.open()) as env:
        run = Run(case, env)
        run.reset(1)
        for _ in range(case.steps):
            _, _, terminated, truncated, infos = run.step()
            final, done = infos.get("final_obs"), terminated | truncated
            if final is None:
                continue
            if not isinstance(final, np.ndarray) or final.dtype != object or final.shape != (case.num_envs,):
                yield f"final_obs is {final!r}."
            elif any((last is not None) != ended for last, ended in zip(final, done, strict=True)):
                yield f"final_obs is {final!r} where the ends are {done!r}."


def disabled(case: Case) -> Iterator[str]:
    """Stepping while an environment's episode has ended is an error, until reset_mask has reset it."""
    with closing(case.open()) as env:
        env.reset(seed=1)
        source = actions_of(env, 1)
        for _ in range(case.steps):
            actions = together(env, [source.sample() for _ in range(case.num_envs)])
            ended = np.logical_or(*env.step(actions)[2:4])
            if ended.any():
                break
        else:
            yield NO_END
            return
        try:
            env.step(actions)
        except Exception:
            env.reset(options={"reset_mask": ended})
            env.step(actions)
            return
        yield f"no error although the episodes {np.flatnonzero(ended).tolist()} have ended."
