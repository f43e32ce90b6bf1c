"""Rules of every mode, and the table of all. Each rule is a generator of violations; its docstring is the rule."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import closing
from copy import deepcopy
from typing import Any

import numpy as np
from gymnasium.utils.env_checker import data_equivalence
from gymnasium.vector import VectorEnv
from gymnasium.vector.utils import batch_space

from gymnasium_vector_checker.mode_rules import disabled, final_objects, next_step, same_step
from gymnasium_vector_checker.runs import (
    DISABLED,
    LIMIT,
    NEXT_STEP,
    SAME_STEP,
    Case,
    Event,
    Run,
    actions_of,
    difference,
    rows_of,
    together,
)


def spaces(case: Case) -> Iterator[str]:
    """The batched spaces are batch_space(single space, num_envs), and num_envs is the requested number."""
    with closing(case.open()) as env:
        if not isinstance(env, VectorEnv):
            yield f"a {type(env).__name__}, which is no gymnasium.vector.VectorEnv."
        if env.num_envs != case.num_envs:
            yield f"num_envs is {env.num_envs!r} instead of {case.num_envs}."
        for name in ("observation_space", "action_space"):
            single, batched = getattr(env, f"single_{name}"), getattr(env, name)
            if batched != batch_space(single, case.num_envs):
                yield f"{name} is {batched!r}, single_{name} {single!r}."


def metadata(case: Case) -> Iterator[str]:
    """metadata["autoreset_mode"] is the AutoresetMode in force."""
    with closing(case.open()) as env:
        if env.metadata.get("autoreset_mode") is not case.mode:
            yield f"{env.metadata.get('autoreset_mode')!r} instead of {case.mode!r}."


def mode_attribute(case: Case) -> Iterator[str]:
    """The attribute autoreset_mode is the AutoresetMode in force too, as SyncVectorEnv and AsyncVectorEnv have it."""
    with closing(case.open()) as env:
        mode = getattr(env.unwrapped, "autoreset_mode", "no such attribute")
        if mode is not case.mode:
            yield f"{mode!r} instead of {case.mode!r}."


def returns(case: Case) -> Iterator[str]:
    """Observations lie in observation_space, rewards are floats and ends booleans of shape (num_envs,)."""
    with closing(case.open()) as env:
        run = Run(case, env)
        observations, _ = run.reset(1)
        if observations not in env.observation_space:
            yield f"reset returned the observations {observations!r}."
        for _ in range(case.steps):
            observations, rewards, *ends, _ = run.step()
            if observations not in env.observation_space:
                yield f"step returned the observations {observations!r}."
            if not isinstance(rewards, np.ndarray) or rewards.shape != (case.num_envs,) or rewards.dtype.kind != "f":
                yield f"step returned the rewards {rewards!r}."
            for end in ends:
                if not isinstance(end, np.ndarray) or end.shape != (case.num_envs,) or end.dtype != np.bool_:
                    yield f"step returned terminations or truncations {end!r}."


def info_masks(case: Case) -> Iterator[str]:
    """Infos are a dict; each key k holds a row per environment and has a boolean mask _k of shape (num_envs,)."""

    def wrong(infos: Any) -> Iterator[str]:
        if not isinstance(infos, dict):
            yield f"infos of type {type(infos).__name__}."
            return
        for key in infos:
            mask = infos[key] if key.startswith("_") else infos.get(f"_{key}")
            if not isinstance(mask, np.ndarray) or mask.dtype != np.bool_ or mask.shape != (case.num_envs,):
                yield f"the key {key!r} with the mask {mask!r}."
            elif key.startswith("_"):
                if key[1:] not in infos:
                    yield f"the mask {key!r} of nothing."
            elif isinstance(infos[key], dict):
                yield from wrong(infos[key])
            elif key == "final_obs":
                continue  # for a composite space it need not be an array
            elif not isinstance(infos[key], np.ndarray) or len(infos[key]) != case.num_envs:
                yield f"the key {key!r} with {infos[key]!r}."

    with closing(case.open()) as env:
        run = Run(case, env)
        yield from wrong(run.reset(1)[1])
        for _ in range(case.steps):
            yield from wrong(run.step()[4])


def seeding(case: Case) -> Iterator[str]:
    """The same seed and actions give the same episodes; an int stands for seed + i, and a list has one seed for each."""
    expected = case.play(1, stagger=False)
    for seed in (1, list(range(1, case.num_envs + 1))):
        seen = difference(expected, case.play(seed, stagger=False))
        if seen is not None:
            yield f"with seed={seed!r}, {seen}"
    shifted = case.play(2, rows=[*range(1, case.num_envs), 0], stagger=False)
    seen = difference(expected[1:], shifted[:-1])
    if seen is not None:
        yield f"seed=2 does not begin with the second environment of seed=1: {seen}"
    with closing(case.open()) as env:
        too_many: Any = [1] * (case.num_envs + 1)
        try:
            env.reset(seed=too_many)
        except Exception:
            return
        yield f"no error for {len(too_many)} seeds of {case.num_envs} environments."


def seed_none(case: Case) -> Iterator[str]:
    """reset() without a seed continues the random numbers in use and so is repeatable too; so does None in a list of seeds."""

    def again(seed: Any) -> list[list[Event]]:
        with closing(case.open()) as env:
            run = Run(case, env, stagger=False)
            run.reset(1)
            run.step()
            run.reset(seed)
            for _ in range(case.steps):
                run.step()
            return run.events

    with closing(case.open()) as env:
        env.reset()
    expected = again(None)
    for seed in (None, [None] * case.num_envs):
        seen = difference(expected, again(seed))
        if seen is not None:
            yield f"with seed={seed!r}, {seen}"


def rows_alone(case: Case) -> Iterator[str]:
    """Environment i of a batch with seed s has the same episodes as a batch of one with seed s + i."""
    together = case.play(1)
    for i in range(case.num_envs):
        alone = case.play(1 + i, rows=[i])
        seen = difference(alone, together[i : i + 1])
        if seen is not None:
            yield f"for i = {i} (0 in what follows), {seen}"


def fresh_arrays(case: Case) -> Iterator[str]:
    """Arrays that reset and step return do not change afterwards, nor do the actions passed to step."""
    with closing(case.open()) as env:
        source = actions_of(env, 1)
        returned: list[Any] = [env.reset(seed=1)]
        kept = [deepcopy(returned[0])]
        for _ in range(case.steps):
            actions = together(env, [source.sample() for _ in range(case.num_envs)])
            before = deepcopy(actions)
            returned.append(env.step(actions))
            kept.append(deepcopy(returned[-1]))
            if not data_equivalence(actions, before, exact=True):
                yield f"the actions {before!r} turned into {actions!r}."
            ended = np.logical_or(*returned[-1][2:4])
            if case.mode is DISABLED and ended.any():
                returned.append(env.reset(options={"reset_mask": ended.copy()}))
                kept.append(deepcopy(returned[-1]))
        env.reset(seed=2)
        for at, (array, copy) in enumerate(zip(returned, kept, strict=True)):
            if not data_equivalence(array, copy, exact=True):
                yield f"what call {at} returned turned from {copy!r} into {array!r}."


def own_arrays(case: Case) -> Iterator[str]:
    """Writing into arrays that reset and step returned changes nothing in the environment."""
    seen = difference(case.play(1), case.play(1, scribble=True))
    if seen is not None:
        yield seen


def reset_mask_form(case: Case) -> Iterator[str]:
    """A reset_mask that is not a boolean array of shape (num_envs,), true somewhere, is an error."""
    ones = np.ones(case.num_envs, np.bool_)
    for mask in (ones.tolist(), np.ones(case.num_envs + 1, np.bool_), ones.astype(np.int64), ~ones):
        with closing(case.open()) as env:
            env.reset(seed=1)
            try:
                env.reset(options={"reset_mask": mask})
            except Exception:
                continue
            yield f"no error for {mask!r}."


def options_kept(case: Case) -> Iterator[str]:
    """reset leaves the caller's options as they are."""
    with closing(case.open()) as env:
        env.reset(seed=1)
        options = {"reset_mask": np.arange(case.num_envs) == 0}
        before = deepcopy(options)
        env.reset(options=options)
        if not data_equivalence(options, before, exact=True):
            yield f"{options!r} instead of {before!r}."


def reset_mask_rows(case: Case) -> Iterator[str]:
    """reset_mask begins new episodes where it is true, seeded if asked, and leaves the other environments as they are."""
    first = np.arange(case.num_envs) == 0
    for when in (2, LIMIT):  # in the middle of the episodes, and when all of them have just ended
        with closing(case.open()) as env, closing(case.open()) as twin, closing(case.open(1)) as new:
            runs = [Run(case, batch, stagger=False) for batch in (env, twin)]
            last: Any = None
            for run in runs:
                run.reset(1)
                for _ in range(when):
                    last = run.step()[0]
            observations, _ = runs[0].reset(50, first)
            fresh = Run(case, new, stagger=False)
            fresh.queues = [deepcopy(runs[0].queues[0])]
            fresh.reset(50)
            for name, now, then in zip(range(case.num_envs), rows_of(env, observations), rows_of(env, last), strict=True):
                if name and case.mode is not DISABLED and not data_equivalence(now, then, exact=True):
                    yield f"environment {name}, which the mask leaves out: observation {now!r} instead of {then!r}."
            start = len(runs[0].events[0]) - 1
            for run in (*runs, fresh):
                for _ in range(case.steps):
                    run.step()
            seen = difference(runs[1].events, runs[0].events, rows=range(1, case.num_envs))
            if seen is not None:
                yield f"with row 0 reset after {when} steps, {seen}"
            seen = difference(fresh.events, [runs[0].events[0][start:]])
            if seen is not None:
                yield f"of row 0, reset after {when} steps, with seed 50: {seen}"


def first_reset_whole(case: Case) -> Iterator[str]:
    """A first reset whose reset_mask leaves an environment out is an error: that environment has no observation yet."""
    with closing(case.open()) as env:
        try:
            env.reset(seed=1, options={"reset_mask": np.arange(case.num_envs) == 0})
        except Exception:
            return
        yield "no error."


def reset_mask_infos(case: Case) -> Iterator[str]:
    """The infos of a reset cover the environments in its reset_mask; their masks are false for the others."""
    with closing(case.open()) as env:
        env.reset(seed=1)
        mask = np.arange(case.num_envs) == 0
        infos = env.reset(options={"reset_mask": mask.copy()})[1]
        for key, value in infos.items():
            if key.startswith("_") and (value & ~mask).any():
                yield f"{key} is {value!r} after a reset of {mask!r}."


def truncation(case: Case) -> Iterator[str]:
    """With max_episode_steps=n an episode that has not terminated earlier is truncated at its n-th step."""
    for i, events in enumerate(case.play(1, stagger=False) if case.limit else []):
        count = 0
        for event in events:
            count = 0 if event.kind == "reset" else count + 1
            if count > LIMIT or (count == LIMIT and not (event.truncated or event.terminated)):
                yield f"environment {i} had its step {count} of {LIMIT} and was not truncated."


def closing_twice(case: Case) -> Iterator[str]:
    """close sets closed, and may be called twice."""
    env = case.open()
    env.reset(seed=1)
    env.close()
    env.close()
    if not env.closed:
        yield f"closed is {env.closed!r}."


RULES = {
    None: (
        spaces,
        metadata,
        mode_attribute,
        returns,
        info_masks,
        seeding,
        seed_none,
        rows_alone,
        fresh_arrays,
        own_arrays,
        reset_mask_form,
        options_kept,
        reset_mask_rows,
        first_reset_whole,
        reset_mask_infos,
        truncation,
        closing_twice,
    ),
    NEXT_STEP: (next_step,),
    SAME_STEP: (same_step, final_objects),
    DISABLED: (disabled,),
}
"""The rules of every mode, and those of one alone."""
