"""The checker passes our environments, and catches each of a row of broken ones."""

from __future__ import annotations

from functools import partial

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.vector import AutoresetMode

from turtlebot_gym.checker import ContractError, check_vector_env
from turtlebot_gym.envs.navigation_vector import NavigationVectorEnv

NEXT_STEP, SAME_STEP, DISABLED = AutoresetMode.NEXT_STEP, AutoresetMode.SAME_STEP, AutoresetMode.DISABLED


@pytest.mark.parametrize("info", ["default", "full"])
@pytest.mark.parametrize("name", ["Nav", "Pose", "Square"])
def test_our_environments_keep_the_contract(name, info):
    make = partial(gym.make_vec, f"turtlebot_gym/TurtleBot{name}-v0", info=info, noise="rough")
    assert check_vector_env(make) == tuple(AutoresetMode)


def test_a_batch_of_several_tiles_keeps_the_contract():
    check_vector_env(partial(gym.make_vec, "turtlebot_gym/TurtleBotNav-v0", info="full"), num_envs=35, steps=16)


class StaleBuffers(NavigationVectorEnv):
    """fresh_arrays"""

    def step(self, actions):
        observations, *rest = super().step(actions)
        if not hasattr(self, "_buffer"):
            self._buffer = np.empty_like(observations)
        self._buffer[:] = observations
        return self._buffer, *rest


class ChangesActions(NavigationVectorEnv):
    """fresh_arrays"""

    def step(self, actions):
        np.multiply(actions, 0.5, out=actions)
        return super().step(actions)


class LiveView(NavigationVectorEnv):
    """own_arrays"""

    def _info(self, outcomes, mask=None):
        infos = super()._info(outcomes, mask)
        rows = self._batch._tiles[0].reshape(-1, 32)[:5, : self.num_envs].T
        return infos | {"true_state": rows, "_true_state": np.ones(self.num_envs, np.bool_)}


class MissingMasks(NavigationVectorEnv):
    """info_masks"""

    def _info(self, outcomes, mask=None):
        infos = super()._info(outcomes, mask)
        del infos["_distance"]
        return infos


class MaskOfIntegers(NavigationVectorEnv):
    """info_masks"""

    def _info(self, outcomes, mask=None):
        infos = super()._info(outcomes, mask)
        return infos | {"_distance": infos["_distance"].astype(np.int64)}


class IntegerRewards(NavigationVectorEnv):
    """returns"""

    def step(self, actions):
        observations, rewards, *rest = super().step(actions)
        return observations, rewards.astype(np.int64), *rest


class OutOfBounds(NavigationVectorEnv):
    """returns"""

    def step(self, actions):
        observations, *rest = super().step(actions)
        return observations - 30.0, *rest


class WideObservations(NavigationVectorEnv):
    """returns"""

    def reset(self, *, seed=None, options=None):
        observations, infos = super().reset(seed=seed, options=options)
        return observations.astype(np.float64), infos


class WrongSpace(NavigationVectorEnv):
    """spaces"""

    def __init__(self, num_envs=1, **options):
        super().__init__(num_envs, **options)
        self.action_space = self.single_action_space


class ModeAsText(NavigationVectorEnv):
    """metadata"""

    def __init__(self, num_envs=1, **options):
        super().__init__(num_envs, **options)
        self.metadata = {**self.metadata, "autoreset_mode": self._mode.value}


class ModeInTheMetadataAlone(NavigationVectorEnv):
    """mode_attribute"""

    autoreset_mode = None


class Unseeded(NavigationVectorEnv):
    """seeding"""

    def reset(self, *, seed=None, options=None):
        return super().reset(seed=np.random.default_rng().integers(1000).item(), options=options)


class AllTheSameSeed(NavigationVectorEnv):
    """seeding"""

    def reset(self, *, seed=None, options=None):
        return super().reset(seed=[seed] * self.num_envs if isinstance(seed, int) else seed, options=options)


class SeedTimesRows(NavigationVectorEnv):
    """seeding"""

    def reset(self, *, seed=None, options=None):
        many = [seed * self.num_envs + i for i in range(self.num_envs)] if isinstance(seed, int) else seed
        return super().reset(seed=many, options=options)


class AnyNumberOfSeeds(NavigationVectorEnv):
    """seeding"""

    def reset(self, *, seed=None, options=None):
        return super().reset(seed=seed[: self.num_envs] if isinstance(seed, list) else seed, options=options)


class FreshEntropyWithoutSeed(NavigationVectorEnv):
    """seed_none"""

    def reset(self, *, seed=None, options=None):
        if seed is None and not options:
            seed = np.random.default_rng().integers(1000).item()
        return super().reset(seed=seed, options=options)


class RowsShareTheirNoise(NavigationVectorEnv):
    """rows_alone"""

    def step(self, actions):
        observations, rewards, *rest = super().step(actions)
        return observations, rewards + 0.01 * rewards.sum(), *rest


class PoppedMask(NavigationVectorEnv):
    """options_kept"""

    def reset(self, *, seed=None, options=None):
        returned = super().reset(seed=seed, options=options)
        (options or {}).pop("reset_mask", None)
        return returned


class MaskIgnored(NavigationVectorEnv):
    """reset_mask_rows"""

    def reset(self, *, seed=None, options=None):
        self._reset_mask(options)
        return super().reset(seed=seed)


class OthersReseeded(NavigationVectorEnv):
    """reset_mask_rows"""

    def reset(self, *, seed=None, options=None):
        returned = super().reset(seed=seed, options=options)
        if isinstance(seed, int):
            self._batch.seeds[:] = seed + np.arange(self.num_envs)
        return returned


class FirstResetInPart(NavigationVectorEnv):
    """first_reset_whole"""

    def _reset_mask(self, options):
        self._begun = True
        return super()._reset_mask(options)


class TellsOfAll(NavigationVectorEnv):
    """reset_mask_infos"""

    def reset(self, *, seed=None, options=None):
        observations, infos = super().reset(seed=seed, options=options)
        for key, told in infos.items():
            if key.startswith("_"):
                told[:] = True
        return observations, infos


class EndForgotten(NavigationVectorEnv):
    """reset_mask_rows"""

    def reset(self, *, seed=None, options=None):
        returned = super().reset(seed=seed, options=options)
        self._done[:] = False
        return returned


class AnyMask(NavigationVectorEnv):
    """reset_mask_form"""

    def _reset_mask(self, options):
        mask = np.asarray((options or {}).get("reset_mask", np.ones(self.num_envs)), np.bool_)
        return mask[: self.num_envs]


class ActionNotIgnored(NavigationVectorEnv):
    """next_step"""

    def step(self, actions):
        ended = self._done.copy()
        observations, *rest = super().step(actions)
        observations[ended, 5] = np.clip(actions[ended, 0], -1.0, 1.0)
        return observations, *rest


class RewardAfterTheEnd(NavigationVectorEnv):
    """next_step"""

    def step(self, actions):
        ended = self._done.copy()
        observations, rewards, *rest = super().step(actions)
        return observations, np.where(ended & (self._mode is NEXT_STEP), -0.1, rewards), *rest


class OthersWaitForAReset(NavigationVectorEnv):
    """rows_alone"""

    def step(self, actions):
        if self._mode is NEXT_STEP and self._done.any() and not self._done.all():
            observations, infos = self.reset(options={"reset_mask": self._done.copy()})
            nothing = np.zeros(self.num_envs, np.bool_)
            return observations, np.zeros(self.num_envs), nothing, nothing.copy(), infos
        return super().step(actions)


class LiveFinal(NavigationVectorEnv):
    """own_arrays"""

    last = was = np.zeros(1)

    def step(self, actions):
        observations, *rest, infos = super().step(actions)
        if not np.array_equal(self.last, self.was):
            observations[:, 0] = 0.0
        if "final_obs" in infos:
            self.last = next(one for one in infos["final_obs"] if one is not None)
            self.was = self.last.copy()
        return observations, *rest, infos


class FinalOfNumbers(NavigationVectorEnv):
    """final_objects"""

    def step(self, actions):
        observations, *rest, infos = super().step(actions)
        if "final_obs" in infos:
            infos["final_obs"] = np.stack([np.zeros(13) if one is None else one for one in infos["final_obs"]])
        return observations, *rest, infos


class FinalEverywhere(NavigationVectorEnv):
    """final_objects"""

    def step(self, actions):
        observations, *rest, infos = super().step(actions)
        for row, one in enumerate(infos.get("final_obs", ())):
            infos["final_obs"][row] = observations[row] if one is None else one
        return observations, *rest, infos


class FinalIsFirst(NavigationVectorEnv):
    """modes_agree"""

    def step(self, actions):
        observations, *rest, infos = super().step(actions)
        if "final_obs" in infos:
            for row in np.flatnonzero(infos["_final_obs"]):
                infos["final_obs"][row] = observations[row].copy()
        return observations, *rest, infos


class FinalMaskEverywhere(NavigationVectorEnv):
    """same_step"""

    def step(self, actions):
        *rest, infos = super().step(actions)
        if "_final_obs" in infos:
            infos["_final_obs"][:] = True
        return *rest, infos


class NoFinalInfo(NavigationVectorEnv):
    """same_step"""

    def step(self, actions):
        *rest, infos = super().step(actions)
        return *rest, {key: value for key, value in infos.items() if "final_info" not in key}


class NoErrorWhenEnded(NavigationVectorEnv):
    """disabled"""

    def step(self, actions):
        self._done[:] = False
        return super().step(actions)


class NeverTruncated(NavigationVectorEnv):
    """truncation"""

    def __init__(self, num_envs=1, *, max_episode_steps=None, **options):
        super().__init__(num_envs, **options)


class StaysOpen(NavigationVectorEnv):
    """closing_twice"""

    def close(self, **options):
        pass


def broken() -> list[type[NavigationVectorEnv]]:
    return [one for one in NavigationVectorEnv.__subclasses__() if one.__module__ == __name__]


def violations(make, *, steps=16, **options):
    try:
        check_vector_env(make, steps=steps, **options)
    except ContractError as error:
        return error.violations
    return []


def test_the_error_says_what_the_rule_is_and_what_was_seen():
    with pytest.raises(ContractError, match=r"(?s)options_kept \(NEXT_STEP\): reset leaves.*Seen: {} instead of {'reset_mask'"):
        check_vector_env(PoppedMask, modes=[NEXT_STEP])


@pytest.mark.parametrize("cls", broken(), ids=lambda cls: cls.__name__)
def test_broken_environments_are_caught(cls):
    """Each class's docstring is the rule that it breaks."""
    assert cls.__doc__ in {one.rule for one in violations(cls)}


def test_every_rule_has_been_seen_to_fail():
    from turtlebot_gym.checker.rules import RULES

    rules = {rule.__name__ for rules in RULES.values() for rule in rules} | {"modes_agree"}
    assert rules == {cls.__doc__ for cls in broken()}


def test_a_broken_environment_breaks_no_more_rules_than_it_does():
    for cls in (PoppedMask, ModeAsText, TellsOfAll, StaysOpen):
        assert {one.rule for one in violations(cls)} == {cls.__doc__}


def test_modes_that_are_not_supported_are_skipped_unless_asked_for():
    def next_step_only(num_envs, autoreset_mode, max_episode_steps):
        if autoreset_mode is not NEXT_STEP:
            raise ValueError(f"autoreset_mode must be NEXT_STEP, got {autoreset_mode}.")
        return NavigationVectorEnv(num_envs, autoreset_mode=autoreset_mode, max_episode_steps=max_episode_steps)

    assert check_vector_env(next_step_only) == (NEXT_STEP,)
    assert {one.mode for one in violations(next_step_only, modes=[NEXT_STEP, DISABLED])} == {DISABLED}


def test_without_a_limit_the_runs_must_see_an_end():
    def make(num_envs, autoreset_mode):
        return NavigationVectorEnv(num_envs, autoreset_mode=autoreset_mode, max_episode_steps=15)

    assert check_vector_env(make) == tuple(AutoresetMode)
    assert {one.rule for one in violations(make, steps=10)} == {"next_step", "same_step", "disabled"}


def test_bad_arguments():
    with pytest.raises(ValueError, match="num_envs"):
        check_vector_env(NavigationVectorEnv, num_envs=1)
    with pytest.raises(ValueError, match="modes"):
        check_vector_env(lambda num_envs, autoreset_mode: [][autoreset_mode])


# Gymnasium's own, so that a reader knows what to expect of them; the versions differ, so these name what has been broken since
# 1.1 and may be mended one day.


def test_gymnasiums_own_vector_environments_are_judged():
    def sync(num_envs, autoreset_mode, max_episode_steps):
        modes = {"autoreset_mode": autoreset_mode}
        return gym.make_vec(
            "CartPole-v1", num_envs, vectorization_mode="sync", vector_kwargs=modes, max_episode_steps=max_episode_steps
        )

    def native(num_envs, autoreset_mode, max_episode_steps):
        if autoreset_mode is not NEXT_STEP:
            raise ValueError("only NEXT_STEP")
        return gym.make_vec(
            "CartPole-v1", num_envs, vectorization_mode="vector_entry_point", max_episode_steps=max_episode_steps
        )

    assert {one.rule for one in violations(sync)} <= {"options_kept"}
    assert {one.rule for one in violations(native)} <= {
        "mode_attribute", "seeding", "seed_none", "rows_alone", "reset_mask_form", "reset_mask_rows", "first_reset_whole",
        "reset_mask_infos", "closing_twice",
    }  # fmt: skip
