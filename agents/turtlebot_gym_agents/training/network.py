"""A torch network as ONNX, and the check that a bundle acts as what it was made from."""

from __future__ import annotations

import io
import warnings
from copy import deepcopy
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import torch
from gymnasium import spaces
from gymnasium.vector import VectorEnv
from numpy.typing import NDArray
from torch import nn

from turtlebot_gym.files import replacing
from turtlebot_gym_agents.policies import PolicyWithMemory
from turtlebot_gym_agents.policies.bundle import BundlePolicy, Card, write_bundle

if TYPE_CHECKING:
    from onnx import ModelProto

TOLERANCE = 1e-5
"""Largest accepted difference between an action of the original and of its bundle."""
STEPS, ROWS = 1000, 8
"""Steps of the check, and environments that it drives in."""
_SEED, _RESTARTS, _STRAY = 2**43, 0.01, 0.5
"""The check's first seed; share of the steps after which an episode is begun anew, and share of random actions."""


class Normalization(nn.Module):
    """Shift, scale and clip observations by statistics, in the precision of these, as their library does."""

    mean: torch.Tensor
    scale: torch.Tensor

    def __init__(self, mean: NDArray[Any], scale: NDArray[Any], clip: float) -> None:
        super().__init__()
        self.clip, self.size = clip, len(mean)
        self.register_buffer("mean", torch.from_numpy(mean))
        self.register_buffer("scale", torch.from_numpy(scale))

    def forward(self, observation: torch.Tensor) -> torch.Tensor:
        scaled = (observation.to(self.mean.dtype) - self.mean) / self.scale
        return (scaled.clamp(-self.clip, self.clip) if np.isfinite(self.clip) else scaled).float()

    def of_rows(self, observations: NDArray[np.float32]) -> NDArray[np.float32]:
        """Return normalized observations, arrays of shape (n, k)."""
        return self(torch.from_numpy(observations)).numpy()


def normalization_of(source: Any) -> Normalization | None:
    """Return the normalization by a `VecNormalize` or a `NormalizeObservation`; None if it only normalizes rewards.

    Raises:
        ValueError: If it holds no finite statistics of one-dimensional observations.
    """
    if not getattr(source, "norm_obs", True):
        return None
    statistics = getattr(source, "obs_rms", None)
    mean = np.asarray(getattr(statistics, "mean", None))
    if mean.ndim != 1 or mean.dtype.kind != "f":
        raise ValueError(
            "vec_normalize must hold statistics of one-dimensional observations, as VecNormalize of Stable-Baselines3 and "
            f"NormalizeObservation of Gymnasium do, got {type(source).__name__}."
        )
    scale = np.sqrt(np.asarray(statistics.var) + source.epsilon).astype(mean.dtype)  # pyright: ignore[reportOptionalMemberAccess]
    if not (np.isfinite(mean).all() and np.isfinite(scale).all() and (scale > 0.0).all()):
        raise ValueError(f"vec_normalize must hold finite statistics, got a {type(source).__name__} whose are not.")
    return Normalization(mean.copy(), scale, float(getattr(source, "clip_obs", np.inf)))


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


class Program(nn.Module):
    """A network behind its normalization, with actions clipped to [-1, 1]: what a bundle holds.

    Args:
        network: A map from observations (n, k) to actions (n, 2); with memory, from observations and memory (n, m) to both. It
            is left in evaluation mode.
        normalization: Normalization of observations before it; None for none.
        memory: Numbers of its memory.
    """

    def __init__(self, network: nn.Module, normalization: Normalization | None, memory: int) -> None:
        super().__init__()
        self.network, self.normalization, self.memory = network.eval(), normalization, memory

    def forward(self, observation: torch.Tensor, memory: torch.Tensor | None = None) -> Any:
        seen = observation if self.normalization is None else self.normalization(observation)
        if memory is None:
            return self.network(seen).clamp(-1.0, 1.0)
        action, after = self.network(seen, memory)
        return action.clamp(-1.0, 1.0), after


class TorchPolicy:
    """A program as a policy with memory, computed by torch itself."""

    def __init__(self, program: Program, memory: int) -> None:
        self._program, self._memory = program, torch.zeros(0, memory)

    def reset(self, mask: NDArray[np.bool_]) -> None:
        if len(self._memory) != len(mask):
            self._memory = torch.zeros(len(mask), self._memory.shape[1])
        self._memory[torch.from_numpy(mask)] = 0.0

    def __call__(self, observations: NDArray[np.float32]) -> NDArray[np.float32]:
        rows = torch.from_numpy(np.asarray(observations, np.float32))
        with torch.no_grad():
            if not self._program.memory:
                return self._program(rows).float().numpy()
            action, self._memory = self._program(rows, self._memory)
            return action.float().numpy()

    def try_on(self, space: spaces.Box) -> None:
        """Raise ValueError unless it gives reproducible actions (n, 2) for observations of a space."""
        rows, answers = np.stack([space.sample() for _ in range(3)]).astype(np.float32), list[NDArray[np.float32]]()
        for _ in range(2):
            self.reset(np.ones(len(rows), np.bool_))
            try:
                answers.append(self(rows))
            except Exception as error:  # it is somebody else's
                reason = " ".join(f"{type(error).__name__}: {error}".split())[:200]
                raise ValueError(
                    f"model must be a map from observations (n, {rows.shape[1]}) to actions (n, 2), but fails: {reason}: name "
                    "the part that acts, such as export(agent.actor_mean, ...); one with a state needs memory=..., its size."
                ) from error
        if answers[0].shape != (len(rows), 2):
            raise ValueError(f"network must give actions (n, 2), got {answers[0].shape} for {len(rows)} observations.")
        if not np.array_equal(answers[0], answers[1]):
            raise ValueError("model must act reproducibly, but gives two actions for one observation: export its mean action.")


def program_of(network: nn.Module, size: int, memory: int = 0) -> ModelProto:
    """Return a network as ONNX, by torch's exporter for traced modules: the newer one takes twenty times as long.

    Args:
        network: A map from observations (n, size), and from a memory (n, memory) if it has one, to actions and the next memory.
        size: Numbers of an observation.
        memory: Numbers of the memory.

    Raises:
        ValueError: If torch cannot export it.
    """
    import onnx

    inputs = (torch.zeros(2, size), *((torch.zeros(2, memory),) if memory else ()))
    names = ["observation", "memory", "action", "next_memory"][:: 1 if memory else 2]
    ends: Any = {"input_names": names[: len(inputs)], "output_names": names[len(inputs) :]}
    content: Any = io.BytesIO()
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # torch prefers its newer exporter
            axes = {name: {0: "n"} for name in names}
            torch.onnx.export(network.eval(), inputs, content, dynamic_axes=axes, dynamo=False, **ends)
    except Exception as error:  # torch's exporter has errors of its own, whose text is long
        reason = " ".join(str(error).split())[:200]
        raise ValueError(f"model cannot be exported by torch: {type(error).__name__}: {reason}") from error
    return onnx.load_from_string(content.getvalue())


def write_checked(
    model: ModelProto, path: str | Path, card: Card, original: PolicyWithMemory | None, envs: VectorEnv, *, steps: int = STEPS
) -> float:
    """Write a bundle, if it acts like its original.

    Args:
        model: The network as ONNX, see `OnnxNetwork`.
        path: The file, replaced atomically.
        card: Card of the bundle.
        original: The policy by its own library, with all that it was trained with; None if that is ONNX.
        envs: The environments of the training, in the mode SAME_STEP.
        steps: Number of steps to compare, with episodes that begin anew, before a sample of the whole observation space.

    Returns:
        The largest difference between the bundle's actions and the original's.

    Raises:
        RuntimeError: If it is larger than `TOLERANCE`; then nothing is written.
        ValueError: If an action depends on the other rows.
    """
    with replacing(path) as beside:
        write_bundle(beside, model, card)
        bundle = BundlePolicy(beside)
        _require_rows(bundle, envs.reset(seed=_SEED)[0])
        difference = 0.0 if original is None else _difference(bundle, original, envs, steps)
        if not difference <= TOLERANCE:
            raise RuntimeError(f"{path} is not written: its actions would differ from the network's by {difference:.2g}.")
    return difference


def _difference(bundle: BundlePolicy, original: PolicyWithMemory, envs: VectorEnv, steps: int) -> float:
    """Return the largest difference of two policies in an environment."""
    random, space = np.random.default_rng(0), envs.single_observation_space
    observations, _ = envs.reset(seed=_SEED)
    begins, largest = np.ones(envs.num_envs, np.bool_), 0.0
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
    _begin(bundle, every := np.ones(len(anywhere), np.bool_))
    original.reset(every)
    return max(largest, float(np.abs(original(anywhere) - bundle(anywhere)).max()))


def _begin(bundle: BundlePolicy, mask: NDArray[np.bool_]) -> None:
    if bundle.memory:
        bundle.reset(mask)


def _require_rows(bundle: BundlePolicy, observations: NDArray[np.float32]) -> None:
    """Refuse a policy whose actions depend on the other rows."""
    _begin(bundle, np.ones(len(observations), np.bool_))
    together, alone = bundle(observations), list[NDArray[np.float32]]()
    for row in observations:
        _begin(bundle, np.ones((), np.bool_))
        alone.append(bundle(row))
    if not np.abs(np.array(alone) - together).max() <= TOLERANCE:
        raise ValueError("model must act on each observation by itself, but its actions depend on the others of a batch.")
