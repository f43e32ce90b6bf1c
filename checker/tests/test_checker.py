"""The checker passes an environment that keeps the contract, and catches each of many broken ones."""

from __future__ import annotations

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.vector import AutoresetMode
from walk import Walk

from gymnasium_vector_checker import ContractError, check_vector_env

pytestmark = pytest.mark.touched("checker")

NEXT_STEP, SAME_STEP, DISABLED = AutoresetMode.NEXT_STEP, AutoresetMode.SAME_STEP, AutoresetMode.DISABLED


def test_an_environment_that_keeps_the_contract_passes():
    assert check_vector_env(Walk) == tuple(AutoresetMode)


class StaleBuffers(Walk):
    """fresh_arrays"""

    def step(self, actions):
        observations, *rest = super().step(actions)
        if not hasattr(self, "_buffer"):
            self._buffer = np.empty_like(observations)
        self._buffer[:] = observations
        return self._buffer, *rest


class ChangesActions(Walk):
    """fresh_arrays"""

    def step(self, actions):
        np.multiply(actions, 0.5, out=actions)
        return super().step(actions)


class LiveView(Walk):
    """own_arrays"""

    def infos(self, mask):
        infos = super().infos(mask)
        return infos | {"position": self.positions, "_position": mask.copy()}


class MissingMasks(Walk):
    """info_masks"""

    def infos(self, mask):
        infos = super().infos(mask)
        del infos["_distance"]
        return infos


class MaskOfIntegers(Walk):
    """info_masks"""

    def infos(self, mask):
        infos = super().infos(mask)
        return infos | {"_distance": infos["_distance"].astype(np.int64)}


class IntegerRewards(Walk):
    """returns"""

    def step(self, actions):
        observations, rewards, *rest = super().step(actions)
        return observations, rewards.astype(np.int64), *rest


class OutOfBounds(Walk):
    """returns"""

    def step(self, actions):
        observations, *rest = super().step(actions)
        return observations - 30.0, *rest


class WideObservations(Walk):
    """returns"""

    def reset(self, *, seed=None, options=None):
        observations, infos = super().reset(seed=seed, options=options)
        return observations.astype(np.float64), infos


class WrongSpace(Walk):
    """spaces"""

    def __init__(self, num_envs=1, **options):
        super().__init__(num_envs, **options)
        self.action_space = self.single_action_space


class ModeAsText(Walk):
    """metadata"""

    def __init__(self, num_envs=1, **options):
        super().__init__(num_envs, **options)
        self.metadata = {**self.metadata, "autoreset_mode": self.mode.value}


class ModeInTheMetadataAlone(Walk):
    """mode_attribute"""

    autoreset_mode = None


class Unseeded(Walk):
    """seeding"""

    def reset(self, *, seed=None, options=None):
        return super().reset(seed=np.random.default_rng().integers(1000).item(), options=options)


class AllTheSameSeed(Walk):
    """seeding"""

    def reset(self, *, seed=None, options=None):
        return super().reset(seed=[seed] * self.num_envs if isinstance(seed, int) else seed, options=options)


class SeedTimesRows(Walk):
    """seeding"""

    def reset(self, *, seed=None, options=None):
        many = [seed * self.num_envs + i for i in range(self.num_envs)] if isinstance(seed, int) else seed
        return super().reset(seed=many, options=options)


class AnyNumberOfSeeds(Walk):
    """seeding"""

    def reset(self, *, seed=None, options=None):
        return super().reset(seed=seed[: self.num_envs] if isinstance(seed, list) else seed, options=options)


class FreshEntropyWithoutSeed(Walk):
    """seed_none"""

    def reset(self, *, seed=None, options=None):
        if seed is None and not options:
            seed = np.random.default_rng().integers(1000).item()
        return super().reset(seed=seed, options=options)


class RowsShareTheirNoise(Walk):
    """rows_alone"""

    def step(self, actions):
        observations, rewards, *rest = super().step(actions)
        return observations, rewards + 0.01 * rewards.sum(), *rest


class PoppedMask(Walk):
    """options_kept"""

    def reset(self, *, seed=None, options=None):
        returned = super().reset(seed=seed, options=options)
        (options or {}).pop("reset_mask", None)
        return returned


class MaskIgnored(Walk):
    """reset_mask_rows"""

    def reset(self, *, seed=None, options=None):
        self.reset_mask(options)
        return super().reset(seed=seed)


class OthersReseeded(Walk):
    """reset_mask_rows"""

    def reset(self, *, seed=None, options=None):
        returned = super().reset(seed=seed, options=options)
        if isinstance(seed, int):
            self.generators = [np.random.default_rng(seed + i) for i in range(self.num_envs)]
        return returned


class FirstResetInPart(Walk):
    """first_reset_whole"""

    def reset_mask(self, options):
        self.begun = True
        return super().reset_mask(options)


class TellsOfAll(Walk):
    """reset_mask_infos"""

    def reset(self, *, seed=None, options=None):
        observations, infos = super().reset(seed=seed, options=options)
        for key, value in infos.items():
            if key.startswith("_"):
                value[:] = True
        return observations, infos


class EndForgotten(Walk):
    """reset_mask_rows"""

    def reset(self, *, seed=None, options=None):
        returned = super().reset(seed=seed, options=options)
        self.done[:] = False
        return returned


class AnyMask(Walk):
    """reset_mask_form"""

    def reset_mask(self, options):
        mask = np.asarray((options or {}).get("reset_mask", np.ones(self.num_envs)), np.bool_)
        return mask[: self.num_envs]


class ActionNotIgnored(Walk):
    """next_step"""

    def step(self, actions):
        ended = self.done.copy()
        observations, *rest = super().step(actions)
        observations[ended, 0] = actions[ended, 0]
        return observations, *rest


class RewardAfterTheEnd(Walk):
    """next_step"""

    def step(self, actions):
        ended = self.done.copy()
        observations, rewards, *rest = super().step(actions)
        return observations, np.where(ended & (self.mode is NEXT_STEP), -0.1, rewards), *rest


class OthersWaitForAReset(Walk):
    """rows_alone"""

    def step(self, actions):
        if self.mode is NEXT_STEP and self.done.any() and not self.done.all():
            observations, infos = self.reset(options={"reset_mask": self.done.copy()})
            nothing = np.zeros(self.num_envs, np.bool_)
            return observations, np.zeros(self.num_envs), nothing, nothing.copy(), infos
        return super().step(actions)


class LiveFinal(Walk):
    """own_arrays"""

    last = was = np.zeros(1)

    def step(self, actions):
        observations, *rest, infos = super().step(actions)
        if not np.array_equal(self.last, self.was):
            observations[:, 0] = 0.0
        if "final_obs" in infos:
            self.last = next(last for last in infos["final_obs"] if last is not None)
            self.was = self.last.copy()
        return observations, *rest, infos


class FinalOfNumbers(Walk):
    """final_objects"""

    def step(self, actions):
        observations, *rest, infos = super().step(actions)
        if "final_obs" in infos:
            infos["final_obs"] = np.stack([np.zeros(2) if last is None else last for last in infos["final_obs"]])
        return observations, *rest, infos


class FinalEverywhere(Walk):
    """final_objects"""

    def step(self, actions):
        observations, *rest, infos = super().step(actions)
        for row, last in enumerate(infos.get("final_obs", ())):
            infos["final_obs"][row] = observations[row] if last is None else last
        return observations, *rest, infos


class FinalIsFirst(Walk):
    """modes_agree"""

    def step(self, actions):
        observations, *rest, infos = super().step(actions)
        if "final_obs" in infos:
            for row in np.flatnonzero(infos["_final_obs"]):
                infos["final_obs"][row] = observations[row].copy()
        return observations, *rest, infos


class FinalMaskEverywhere(Walk):
    """same_step"""

    def step(self, actions):
        *rest, infos = super().step(actions)
        if "_final_obs" in infos:
            infos["_final_obs"][:] = True
        return *rest, infos


class NoFinalInfo(Walk):
    """same_step"""

    def step(self, actions):
        *rest, infos = super().step(actions)
        return *rest, {key: value for key, value in infos.items() if "final_info" not in key}


class NoErrorWhenEnded(Walk):
    """disabled"""

    def step(self, actions):
        self.done[:] = False
        return super().step(actions)


class NeverTruncated(Walk):
    """truncation"""

    def __init__(self, num_envs=1, *, max_episode_steps=None, **options):
        super().__init__(num_envs, **options)


class StaysOpen(Walk):
    """closing_twice"""

    def close(self, **options):
        pass


def broken() -> list[type[Walk]]:
    return Walk.__subclasses__()


def violations(make, *, steps=16, **options):
    try:
        check_vector_env(make, steps=steps, **options)
    except ContractError as error:
        return error.violations
    return []


def test_the_error_says_what_the_rule_is_and_what_was_seen():
    with pytest.raises(ContractError, match=r"(?s)options_kept \(NEXT_STEP\): reset leaves.*Seen: {} instead of {'reset_mask'"):
        check_vector_env(PoppedMask, modes=[NEXT_STEP])


@pytest.mark.sample(9)
@pytest.mark.parametrize("cls", broken(), ids=lambda cls: cls.__name__)
def test_broken_environments_are_caught(cls):
    """Each class's docstring is the rule that it breaks."""
    assert cls.__doc__ in {violation.rule for violation in violations(cls)}


def test_every_rule_has_been_seen_to_fail():
    from gymnasium_vector_checker.rules import RULES

    rules = {rule.__name__ for rules in RULES.values() for rule in rules} | {"modes_agree"}
    assert rules == {cls.__doc__ for cls in broken()}


def test_a_broken_environment_breaks_no_more_rules_than_it_does():
    for cls in (PoppedMask, ModeAsText, TellsOfAll, StaysOpen):
        assert {violation.rule for violation in violations(cls)} == {cls.__doc__}


def test_modes_that_are_not_supported_are_skipped_unless_asked_for():
    def next_step_only(num_envs, autoreset_mode, max_episode_steps):
        if autoreset_mode is not NEXT_STEP:
            raise ValueError(f"autoreset_mode must be NEXT_STEP, got {autoreset_mode}.")
        return Walk(num_envs, autoreset_mode=autoreset_mode, max_episode_steps=max_episode_steps)

    assert check_vector_env(next_step_only) == (NEXT_STEP,)
    assert {violation.mode for violation in violations(next_step_only, modes=[NEXT_STEP, DISABLED])} == {DISABLED}


def test_without_a_limit_the_runs_must_see_an_end():
    def make(num_envs, autoreset_mode):
        return Walk(num_envs, autoreset_mode=autoreset_mode, max_episode_steps=12, radius=9.0)

    assert check_vector_env(make) == tuple(AutoresetMode)
    assert {violation.rule for violation in violations(make, steps=10)} == {"next_step", "same_step", "disabled"}


def test_bad_arguments():
    with pytest.raises(ValueError, match="num_envs"):
        check_vector_env(Walk, num_envs=1)
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

    assert {violation.rule for violation in violations(sync)} <= {"options_kept"}
    assert {violation.rule for violation in violations(native)} <= {
        "mode_attribute",
        "seeding",
        "seed_none",
        "rows_alone",
        "reset_mask_form",
        "reset_mask_rows",
        "first_reset_whole",
        "reset_mask_infos",
        "closing_twice",
    }
