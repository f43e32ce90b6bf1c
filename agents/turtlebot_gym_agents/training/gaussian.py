"""The policy of Stable-Baselines3 for continuous actions, in fewer operations of torch.

Networks here are so small that a training's time goes into calls, not into numbers. `ActorCriticPolicy` builds a distribution
for each batch, fills a matrix with the standard deviation, and checks both. The formulas of a Gaussian need a third of it.
"""

from __future__ import annotations

from math import log, pi

import torch
from stable_baselines3.common.policies import ActorCriticPolicy

_LOG_2_PI = log(2.0 * pi)


class GaussianPolicy(ActorCriticPolicy):
    """Actor and critic of `ActorCriticPolicy` for a box of actions, with the same weights, samples and likelihoods.

    It shares the features extractor, and has no state-dependent exploration. Arguments are those of `ActorCriticPolicy`.
    """

    def mean_and_value(self, observations: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        """Return means (n, actions) and values (n, 1) for observations (n, size)."""
        features = self.features_extractor(observations)
        mean = self.action_net(self.mlp_extractor.policy_net(features))
        return mean, self.value_net(self.mlp_extractor.value_net(features))

    def forward(  # pyright: ignore[reportIncompatibleMethodOverride]
        self, obs: torch.Tensor, deterministic: bool = False
    ) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
        """Return actions (n, actions), values (n, 1) and the logarithms of the actions' likelihoods (n,)."""
        mean, value = self.mean_and_value(obs)
        std = self.log_std.exp().expand_as(mean)
        actions = mean if deterministic else torch.normal(mean, std)
        return actions, value, self._log_likelihood((actions - mean) / std)

    def evaluate_actions(  # pyright: ignore[reportIncompatibleMethodOverride]
        self, obs: torch.Tensor, actions: torch.Tensor
    ) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
        """Return values (n, 1), the logarithms of the actions' likelihoods (n,), and the entropy in each state (n,)."""
        mean, value = self.mean_and_value(obs)
        entropy = self.log_std.sum() + 0.5 * len(self.log_std) * (1.0 + _LOG_2_PI)
        return value, self._log_likelihood((actions - mean) * torch.exp(-self.log_std)), entropy.expand(len(mean))

    def _log_likelihood(self, deviations: torch.Tensor) -> torch.Tensor:
        """Return the logarithms of the likelihoods (n,) of deviations from the mean, in standard deviations."""
        return -0.5 * deviations.square().sum(1) - (self.log_std.sum() + 0.5 * len(self.log_std) * _LOG_2_PI)
