"""Models of Stable-Baselines3: made for the configuration of a training, saved and restored.

A saved model is a zip file. Besides the weights it holds pickled objects, which could run any code. A training makes its model
anew from its configuration, and reads only the weights, the optimizer's state and the counters from such a file.
"""

from __future__ import annotations

import json
import zipfile
from collections.abc import Iterator
from contextlib import contextmanager
from copy import deepcopy
from pathlib import Path
from pickle import UnpicklingError
from typing import Any

import numpy as np
import torch
from gymnasium.vector import VectorEnv
from numpy.typing import NDArray
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.buffers import ReplayBuffer
from stable_baselines3.common.off_policy_algorithm import OffPolicyAlgorithm
from stable_baselines3.common.on_policy_algorithm import OnPolicyAlgorithm
from stable_baselines3.common.save_util import load_from_zip_file, recursive_setattr

from turtlebot_gym.files import SMALL, in_bounds, read_arrays, replacing, require_small
from turtlebot_gym.observations import OPEN_GROUND, ObservationTerm
from turtlebot_gym_agents.policies import Policy, make_policy
from turtlebot_gym_agents.policies.fit import parameters_of
from turtlebot_gym_agents.policies.policy import shown
from turtlebot_gym_agents.training.arguments import ALGORITHMS, NETWORK, arguments
from turtlebot_gym_agents.training.config import TrainingConfig
from turtlebot_gym_agents.training.normalization import NormalizedObservation, measure, ranges_in
from turtlebot_gym_agents.training.sb3_vec_env import Sb3VecEnv
from turtlebot_gym_agents.training.staggering import Staggered

MEASURED = 76_800
"""Most steps of all environments together from which the observations' normalization is measured."""
STAGGER = 300
"""Steps within which the environments of a training begin."""
NORMALIZATION_SEED = 2**41
TRAINING_SEED = 2**42
"""A run's environments have seeds from (1 + its seed) times this, separate from others."""
_COUNTERS = ("num_timesteps", "_n_updates", "_episode_num")
_COLUMNS = ("observations", "next_observations", "actions", "rewards", "dones", "timeouts")


def _choose_device(device: str, algo: str) -> str:
    """Return "cpu" or "cuda".

    Args:
        device: Either of them, or "auto": the CPU for on-policy algorithms, whose rollouts pass each observation through a
            small network by itself; a GPU, if there is one, for off-policy ones, which spend their time on batches.
        algo: A name in `ALGORITHMS`.

    Raises:
        ValueError: If ``device`` is "cuda" and torch finds no GPU.

    References:
        Stable-Baselines3 2.9, documentation of PPO: "meant to be run primarily on the CPU" unless the policy is a CNN.
    """
    has_gpu = torch.cuda.is_available()
    if device == "cuda" and not has_gpu:
        raise ValueError(f"device 'cuda' is not available: torch {torch.__version__} finds no GPU; use --device cpu.")
    if device == "auto":
        return "cuda" if has_gpu and issubclass(ALGORITHMS[algo], OffPolicyAlgorithm) else "cpu"
    return device


def _stands(observations: NDArray[np.float32]) -> NDArray[np.float32]:
    return np.zeros((len(observations), 2), np.float32)


def make_model(
    config: TrainingConfig, envs: VectorEnv, *, tensorboard: Path | None = None, checkpoint: Path | None = None
) -> BaseAlgorithm:
    """Return a new model, or one that continues from a checkpoint.

    Args:
        config: Configuration of the training.
        envs: Environments to train in.
        tensorboard: Folder of the logs.
        checkpoint: A file by `save_checkpoint`.

    Raises:
        ValueError: If Stable-Baselines3 refuses the hyper-parameters, or the checkpoint is not one of this configuration.
    """
    parameters = parameters_of(envs)
    terms: tuple[ObservationTerm, ...] = envs.unwrapped.observation_terms  # pyright: ignore[reportAttributeAccessIssue]
    ranges = ranges_in(terms)
    driver: Policy = _stands
    if {term.name for term in OPEN_GROUND} <= {term.name for term in terms}:  # otherwise it cannot steer, and stands
        driver = shown(make_policy("bearing", robot=parameters.robot, dt=parameters.dt), "bearing", terms)
    steps = min(300, max(1, MEASURED // envs.num_envs))
    mean, std = measure(envs, driver, ranges, seed=NORMALIZATION_SEED + config.seed, steps=steps)
    normalization = {
        "features_extractor_class": NormalizedObservation,
        "features_extractor_kwargs": {"mean": mean, "std": std, "ranges": ranges},
    }
    keywords, device = arguments(config.algo, config.hyper), _choose_device(config.device, config.algo)
    adapter = Sb3VecEnv(Staggered(envs, driver, STAGGER), reward_scale=config.hyper.get("reward_scale", 1.0))
    try:
        model = ALGORITHMS[config.algo](
            config.hyper["policy"],
            adapter,
            seed=config.seed,
            device=device,
            tensorboard_log=None if tensorboard is None else str(tensorboard),
            **{**keywords, NETWORK: normalization | keywords[NETWORK]},
        )
    except (TypeError, ValueError, AssertionError) as error:
        reason = " ".join(str(error).split())
        raise ValueError(f"Stable-Baselines3 refuses the hyper-parameters of {config.algo}, see --config: {reason}") from error
    if checkpoint is not None:
        _restore(model, checkpoint)
    # Making the model has set the model's own seed there. A resumed training must not repeat its first episodes.
    adapter.seed((1 + config.seed) * TRAINING_SEED + model.num_timesteps)
    if isinstance(model, OnPolicyAlgorithm):
        adapter.bootstrap_with(model)
    return model


def save_model(model: BaseAlgorithm, path: Path) -> None:
    """Save a model; the file is replaced atomically."""
    with replacing(path) as beside, beside.open("wb") as file:
        model.save(file)


def save_checkpoint(model: BaseAlgorithm, path: Path) -> None:
    """Save a model with its replay buffer, if it has one, so that `make_model` continues from them."""
    if isinstance(model, OffPolicyAlgorithm):
        assert isinstance(model.replay_buffer, ReplayBuffer)
        _write_buffer(model.replay_buffer, _replay_path(path))
    save_model(model, path)


def _restore(model: BaseAlgorithm, path: Path) -> None:
    """Bring a new model into the state of a checkpoint by `save_checkpoint`; nothing pickled in it is run.

    Raises:
        ValueError: If the file is not a checkpoint of such a model, or its replay buffer is missing.
    """
    counters, parameters, variables = _read(path, model)
    try:
        model.set_parameters(parameters, device=model.device)
        for name, value in variables.items():
            recursive_setattr(model, f"{name}.data", value.data)
    except (ValueError, RuntimeError) as error:
        raise ValueError(f"{path} is the checkpoint of another network: {' '.join(str(error).split())}") from error
    vars(model).update(counters)
    if isinstance(model, OffPolicyAlgorithm):
        assert isinstance(model.replay_buffer, ReplayBuffer)
        _load_buffer(model.replay_buffer, _replay_path(path))


@contextmanager
def weights_of(model: BaseAlgorithm, path: Path) -> Iterator[None]:
    """Give a model's policy the weights of a saved model, and its number of steps, within this block.

    Raises:
        ValueError: If the file is not a saved model.
    """
    state, steps = deepcopy(model.policy.state_dict()), model.num_timesteps
    counters, parameters, _ = _read(path, model)
    model.policy.load_state_dict(parameters["policy"])
    model.num_timesteps = counters["num_timesteps"]
    try:
        yield
    finally:
        model.policy.load_state_dict(state)
        model.num_timesteps = steps


def _read(path: Path, model: BaseAlgorithm) -> tuple[dict[str, int], Any, Any]:
    """Return the counters, parameters and further tensors in a saved model."""
    try:
        data = data_of(path)
        counters = {name: int(data[name]) for name in _COUNTERS}
        _, parameters, variables = load_from_zip_file(path, load_data=False, device=model.device)
    except (zipfile.BadZipFile, UnpicklingError, KeyError, TypeError, ValueError, RuntimeError) as error:
        raise ValueError(f"{path} is not a model of Stable-Baselines3: {' '.join(str(error).split())}") from error
    return counters, parameters, variables or {}


@in_bounds
def data_of(path: Path) -> dict[str, Any]:
    """Return the settings in a saved model; nothing in it is run."""
    require_small(path)
    with zipfile.ZipFile(path) as archive:
        return dict(json.loads(archive.read("data")))


def _replay_path(checkpoint: Path) -> Path:
    """Return the path of a checkpoint's replay buffer, a ``.npz`` file."""
    return checkpoint.with_suffix(".replay.npz")


def _write_buffer(buffer: ReplayBuffer, path: Path) -> None:
    columns: dict[str, Any] = {name: getattr(buffer, name)[: buffer.size()] for name in _COLUMNS}
    with replacing(path) as beside, beside.open("wb") as file:
        np.savez(file, position=buffer.pos, full=buffer.full, **columns)


def _load_buffer(buffer: ReplayBuffer, path: Path) -> None:
    if not path.is_file():
        raise ValueError(f"{path} is missing, without which the run cannot be resumed: train again in another folder.")
    content = read_arrays(path, most=2 * sum(getattr(buffer, name).nbytes for name in _COLUMNS) + SMALL)
    for name in _COLUMNS:
        getattr(buffer, name)[: len(content[name])] = content[name]
    buffer.pos, buffer.full = int(content["position"]), bool(content["full"])
