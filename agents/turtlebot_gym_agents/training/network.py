"""Networks of torch as ONNX with all that a bundle needs, and the check that a bundle acts as what it was made from."""

from __future__ import annotations

import io
import warnings
from copy import deepcopy
from typing import TYPE_CHECKING, Any

import numpy as np
import torch
from gymnasium.vector import VectorEnv
from numpy.typing import NDArray
from torch import nn

from turtlebot_gym_agents.policies import Policy, PolicyWithMemory
from turtlebot_gym_agents.policies.bundle import BundlePolicy

if TYPE_CHECKING:
    from onnx import ModelProto

TOLERANCE = 1e-5
"""Largest accepted difference between an action of the original and of its bundle."""
_SEED, _RESTARTS, _STRAY = 2**43, 0.01, 0.5
"""The check's first seed; share of the steps after which an episode is begun anew, and share of random actions."""


class Normalization(nn.Module):
    """Shift, scale and clip observations by the statistics of a `VecNormalize` or `NormalizeObservation`, as these do."""

    mean: torch.Tensor
    scale: torch.Tensor

    def __init__(self, source: Any) -> None:
        super().__init__()
        statistics: Any = getattr(source, "obs_rms", None)
        mean = np.asarray(getattr(statistics, "mean", None))
        if mean.ndim != 1 or mean.dtype.kind != "f":
            raise ValueError(
                "vec_normalize must hold statistics of one-dimensional observations, as VecNormalize of Stable-Baselines3 and "
                f"NormalizeObservation of Gymnasium do, got {type(source).__name__}."
            )
        scale = np.sqrt(np.asarray(statistics.var) + source.epsilon).astype(mean.dtype)
        if not (np.isfinite(mean).all() and np.isfinite(scale).all() and (scale > 0.0).all()):
            raise ValueError(f"vec_normalize must hold finite statistics, got a {type(source).__name__} whose are not.")
        self.clip, self.size = float(getattr(source, "clip_obs", np.inf)), len(mean)
        self.register_buffer("mean", torch.from_numpy(mean.copy()))
        self.register_buffer("scale", torch.from_numpy(scale))

    def forward(self, observation: torch.Tensor) -> torch.Tensor:
        scaled = (observation.to(self.mean.dtype) - self.mean) / self.scale
        return (scaled.clamp(-self.clip, self.clip) if np.isfinite(self.clip) else scaled).float()


class Predicting(nn.Module):
    """The deterministic action of a policy of Stable-Baselines3."""

    def __init__(self, policy: Any) -> None:
        super().__init__()
        self.policy = policy if policy.device.type == "cpu" else deepcopy(policy).cpu()

    def forward(self, observation: torch.Tensor) -> torch.Tensor:
        return self.policy._predict(observation, deterministic=True)


class Recurrent(nn.Module):
    """One step of sb3-contrib's recurrent policy; its memory is the hidden and the cell state of each layer."""

    def __init__(self, policy: Any) -> None:
        super().__init__()
        lstm: nn.LSTM = policy.lstm_actor
        self.features, self.lstm = policy.pi_features_extractor, lstm
        squash = [nn.Tanh()] * bool(policy.squash_output)
        self.head = nn.Sequential(policy.mlp_extractor.policy_net, policy.action_net, *squash)
        self.memory = 2 * lstm.num_layers * lstm.hidden_size

    def forward(self, observation: torch.Tensor, memory: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        layers, width = self.lstm.num_layers, self.lstm.hidden_size
        hidden, cell = memory.reshape(-1, 2 * layers, width).transpose(0, 1).split(layers)
        seen, after = self.lstm(self.features(observation)[None], (hidden.contiguous(), cell.contiguous()))
        return self.head(seen[0]), torch.cat(after).transpose(0, 1).reshape(-1, self.memory)


class PolicyProgram(nn.Module):
    """A network behind its normalization, with actions clipped to [-1, 1]: what a bundle holds."""

    def __init__(self, network: nn.Module, normalization: Normalization | None) -> None:
        super().__init__()
        self.network, self.normalization = network, normalization

    def forward(self, observation: torch.Tensor, memory: torch.Tensor | None = None) -> Any:
        seen = observation if self.normalization is None else self.normalization(observation)
        if memory is None:
            return self.network(seen).clamp(-1.0, 1.0)
        action, after = self.network(seen, memory)
        return action.clamp(-1.0, 1.0), after


class TorchPolicy:
    """A module as a policy with memory, computed by torch itself."""

    def __init__(self, program: nn.Module, memory: int) -> None:
        self._program, self._memory = program, torch.zeros(0, memory)

    def reset(self, mask: NDArray[np.bool_]) -> None:
        if len(self._memory) != len(mask):
            self._memory = torch.zeros(len(mask), self._memory.shape[1])
        self._memory[torch.from_numpy(mask)] = 0.0

    def __call__(self, observations: NDArray[np.float32]) -> NDArray[np.float32]:
        with torch.no_grad():
            if self._memory.shape[1] == 0:
                return self._program(torch.from_numpy(observations)).float().numpy()
            action, self._memory = self._program(torch.from_numpy(observations), self._memory)
            return action.float().numpy()


class Sb3Policy:
    """A model as its library drives it: with its normalization, and the state that it carries."""

    def __init__(self, model: Any, statistics: Any, layer: Normalization | None) -> None:
        self._model, self._begins, self._state = model, np.ones(0, np.bool_), None
        by_torch = (lambda rows: rows) if layer is None else TorchPolicy(layer, 0)
        self._normalize = getattr(statistics, "normalize_obs", by_torch)

    def reset(self, mask: NDArray[np.bool_]) -> None:
        if len(self._begins) != len(mask):
            self._begins, self._state = np.ones(len(mask), np.bool_), None
        self._begins = self._begins | mask

    def __call__(self, observations: NDArray[np.float32]) -> NDArray[np.float32]:
        seen, begins = self._normalize(observations), self._begins
        actions, self._state = self._model.predict(seen, state=self._state, episode_start=begins, deterministic=True)
        self._begins = np.zeros(len(begins), np.bool_)
        return actions


def program_of(network: nn.Module, size: int, memory: int = 0) -> ModelProto:
    """Return a network as ONNX, by torch's exporter for traced modules: the newer one takes twenty times as long.

    It maps observations (n, size), and a memory (n, memory) if it has one, to actions and the next memory. What torch cannot
    export is refused.
    """
    import onnx

    inputs, names = (torch.zeros(2, size), torch.zeros(2, memory)), ["observation", "memory", "action", "next_memory"]
    if memory == 0:
        inputs, names = inputs[:1], names[::2]
    ends: Any = {"input_names": names[: len(inputs)], "output_names": names[len(inputs) :]}
    content: Any = io.BytesIO()
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # torch prefers its newer exporter
            axes = {name: {0: "n"} for name in names}
            torch.onnx.export(network.eval(), inputs, content, dynamic_axes=axes, dynamo=False, **ends)
    except Exception as error:  # it is somebody else's module, and torch's exporter has errors of its own
        reason = " ".join(f"{type(error).__name__}: {error}".split())[:200]
        raise ValueError(
            f"model must be a map from observations (n, {size}) to actions (n, 2) that torch traces, but fails: {reason}: name "
            "the part that acts, such as export(agent.actor_mean, ...); one with a state needs memory=..., its size."
        ) from error
    return onnx.load_from_string(content.getvalue())


def _begin(policy: Policy, mask: NDArray[np.bool_]) -> None:
    if isinstance(policy, PolicyWithMemory):
        policy.reset(mask)


def difference(bundle: BundlePolicy, original: PolicyWithMemory | None, envs: VectorEnv, steps: int) -> float:
    """Return the largest difference of the actions of two policies in environments; without an original, 0.

    A bundle is refused if an action depends on the other rows.
    """
    observations, _ = envs.reset(seed=_SEED)
    begins, alone = np.ones(envs.num_envs, np.bool_), list[NDArray[np.float32]]()
    for row in observations:
        _begin(bundle, np.ones((), np.bool_))
        alone.append(bundle(row))
    _begin(bundle, begins)
    if not np.abs(np.array(alone) - bundle(observations)).max() <= TOLERANCE:
        raise ValueError("model must act on each observation by itself, but its actions depend on the others of a batch.")
    if original is None:
        return 0.0
    random, largest, space = np.random.default_rng(0), 0.0, envs.single_observation_space
    for _ in range(steps):
        if begins.any():
            _begin(bundle, begins)
            original.reset(begins)
        expected, actions = original(observations), bundle(observations)
        largest = max(largest, float(np.abs(expected - actions).max()))
        stray = random.uniform(-1.0, 1.0, actions.shape)
        chosen = np.where(random.random((len(actions), 1)) < _STRAY, stray, actions).astype(np.float32)
        observations, _, terminated, truncated, _ = envs.step(chosen)
        begins, again = terminated | truncated, random.random(envs.num_envs) < _RESTARTS
        if again.any():
            observations, _ = envs.reset(options={"reset_mask": again})
            begins = begins | again
    anywhere = random.uniform(space.low, space.high, (1000, *space.shape)).astype(np.float32)  # pyright: ignore
    every = np.ones(len(anywhere), np.bool_)
    _begin(bundle, every)
    original.reset(every)
    return max(largest, float(np.abs(original(anywhere) - bundle(anywhere)).max()))
