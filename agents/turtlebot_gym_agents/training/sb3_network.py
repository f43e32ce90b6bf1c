"""The network of a model of Stable-Baselines3 or sb3-contrib, from an observation to its deterministic action."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import torch
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.policies import BasePolicy
from torch import nn
from torch.nn import functional


def network_of(model: BaseAlgorithm | BasePolicy) -> tuple[nn.Module, int]:
    """Return the network from an observation to the deterministic action, and the size of its memory.

    Raises:
        ValueError: If it is an LSTM of a kind that a bundle cannot hold.
    """
    policy: Any = getattr(model, "policy", model)
    policy.set_training_mode(False)
    squash: list[nn.Module] = [nn.Tanh()] * bool(getattr(policy, "squash_output", False))
    if hasattr(policy, "lstm_actor"):
        return (network := _Recurrent(policy, squash)), network.memory
    actor: Any = getattr(policy, "actor", None)
    if hasattr(getattr(policy, "mlp_extractor", None), "policy_net"):  # PPO, A2C, TRPO
        layers = [policy.pi_features_extractor, policy.mlp_extractor.policy_net, policy.action_net, *squash]
    elif hasattr(actor, "latent_pi"):  # SAC, TQC, CrossQ, whose actor is stochastic
        layers = [actor.features_extractor, actor.latent_pi, actor.mu, nn.Tanh()]
    elif hasattr(actor, "mu"):  # TD3, DDPG
        layers = [actor.features_extractor, actor.mu]
    else:
        return _Predicting(policy), 0
    return nn.Sequential(*layers), 0


class _Predicting(nn.Module):
    """The deterministic action of any policy of Stable-Baselines3."""

    def __init__(self, policy: BasePolicy) -> None:
        super().__init__()
        self.policy = policy

    def forward(self, observation: torch.Tensor) -> torch.Tensor:
        return self.policy._predict(observation, deterministic=True)


class _Recurrent(nn.Module):
    """One step of sb3-contrib's recurrent policy; its memory is the hidden and the cell state of each layer."""

    def __init__(self, policy: Any, squash: list[nn.Module]) -> None:
        super().__init__()
        lstm: nn.LSTM = policy.lstm_actor
        if lstm.bidirectional or lstm.proj_size:
            raise ValueError("model must have an LSTM of one direction without projection, got lstm_kwargs with more.")
        self.features, self.lstm = policy.pi_features_extractor, lstm
        self.head = nn.Sequential(policy.mlp_extractor.policy_net, policy.action_net, *squash)
        self.memory = 2 * lstm.num_layers * lstm.hidden_size

    def forward(self, observation: torch.Tensor, memory: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        lstm, seen = self.lstm, self.features(observation)
        states = memory.split(lstm.hidden_size, dim=-1)
        hidden, cells = list(states[: lstm.num_layers]), list(states[lstm.num_layers :])
        for layer, weights in enumerate(self._weights()):
            gates = functional.linear(seen, *weights[0]) + functional.linear(hidden[layer], *weights[1])
            enters, stays, new, shows = gates.chunk(4, dim=-1)
            cells[layer] = stays.sigmoid() * cells[layer] + enters.sigmoid() * new.tanh()
            seen = hidden[layer] = shows.sigmoid() * cells[layer].tanh()
        return self.head(seen), torch.cat((*hidden, *cells), dim=-1)

    def _weights(self) -> Iterator[list[list[torch.Tensor]]]:
        """Yield the weights and biases of each layer, for its input and for its hidden state."""
        for layer in range(self.lstm.num_layers):
            kinds = ("weight", "bias") if self.lstm.bias else ("weight",)
            yield [[getattr(self.lstm, f"{kind}_{part}_l{layer}") for kind in kinds] for part in ("ih", "hh")]
