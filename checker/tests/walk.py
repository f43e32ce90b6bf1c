"""A native vector environment that keeps the contract: a random walk in the plane, for the checker's own tests."""

from __future__ import annotations

import numpy as np
from gymnasium import spaces
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space


class Walk(VectorEnv):
    """Walk with a push and some noise; an episode ends outside a circle, or after ``max_episode_steps``."""

    def __init__(self, num_envs=1, *, autoreset_mode=AutoresetMode.NEXT_STEP, max_episode_steps=100, radius=1.0):
        self.num_envs = num_envs
        self.mode = autoreset_mode
        self.metadata = {"autoreset_mode": autoreset_mode}
        self.single_observation_space = spaces.Box(-2.0, 2.0, (2,), np.float32)
        self.single_action_space = spaces.Box(-1.0, 1.0, (2,), np.float32)
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self.action_space = batch_space(self.single_action_space, num_envs)
        self.generators = [np.random.default_rng() for _ in range(num_envs)]
        self.positions = np.zeros((num_envs, 2))
        self.ages = np.zeros(num_envs, np.int64)
        self.done = np.zeros(num_envs, np.bool_)
        self.begun = False
        self.limit, self.radius = max_episode_steps, radius

    @property
    def autoreset_mode(self):
        return self.mode

    def reset(self, *, seed=None, options=None):
        mask = self.reset_mask(options)
        seeds = [seed + i for i in range(self.num_envs)] if isinstance(seed, int) else seed or [None] * self.num_envs
        if len(seeds) != self.num_envs:
            raise ValueError(f"seed must have {self.num_envs} entries, got {len(seeds)}.")
        for i in np.flatnonzero(mask):
            if seeds[i] is not None:
                self.generators[i] = np.random.default_rng(seeds[i])
        self.begin(mask)
        return self.observations(), self.infos(mask)

    def step(self, actions):
        if self.mode is AutoresetMode.DISABLED and self.done.any():
            raise ValueError("An episode has ended.")
        ended = self.done.copy()
        self.begin(ended)
        for i in np.flatnonzero(~ended):
            self.positions[i] += 0.2 * actions[i] + self.generators[i].normal(0.0, 0.2, 2)
        self.positions.clip(-2.0, 2.0, out=self.positions)
        self.ages += ~ended
        distances = np.hypot(*self.positions.T)
        rewards = np.where(ended, 0.0, -distances)
        terminated, truncated = (distances > self.radius) & ~ended, (self.ages == self.limit) & ~ended
        self.done = terminated | truncated
        final = {}
        if self.mode is AutoresetMode.SAME_STEP and self.done.any():
            done, last = self.done.copy(), np.full(self.num_envs, None, np.object_)
            for i in np.flatnonzero(done):
                last[i] = self.observations()[i].copy()
            final = {"final_obs": last, "_final_obs": done, "final_info": self.infos(done), "_final_info": done.copy()}
            self.begin(done)
        return self.observations(), rewards, terminated, truncated, self.infos(np.ones(self.num_envs, np.bool_)) | final

    def begin(self, mask):
        """Begin episodes in the rows of the mask."""
        for i in np.flatnonzero(mask):
            self.positions[i] = self.generators[i].uniform(-0.5, 0.5, 2)
        self.ages[mask], self.done[mask] = 0, False

    def observations(self):
        return self.positions.astype(np.float32)

    def infos(self, mask):
        """Return infos of the rows in the mask."""
        return {"distance": np.hypot(*self.positions.T), "_distance": mask.copy()}

    def reset_mask(self, options):
        """Read the option ``reset_mask``."""
        mask = (options or {}).get("reset_mask", np.ones(self.num_envs, np.bool_))
        if not isinstance(mask, np.ndarray) or mask.dtype != np.bool_ or mask.shape != (self.num_envs,) or not mask.any():
            raise ValueError(f"reset_mask must be booleans of shape ({self.num_envs},), one of them true, got {mask!r}.")
        if not self.begun and not mask.all():
            raise ValueError("The first reset must reset all environments.")
        self.begun = True
        return mask
