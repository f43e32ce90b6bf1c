"""The policy bundle: one ONNX file that knows what it was trained for, and refuses what it was not.

The file is an ONNX model, with the normalization of observations inside, followed by the same message's metadata: protocol
buffers merge what stands one after the other, so any ONNX tool reads it as one model, and the hash of the first part can be
checked without an ONNX library. onnxruntime runs it; a robot needs neither torch nor Stable-Baselines3. Loading one runs no code.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, fields
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from turtlebot_gym import OBSERVATION_LAYOUT, Robot, make_robot

FORMAT = "turtlebot-gym-policy/1"
ACTION = "forward speed and turning rate as shares of the robot's limits, in [-1, 1]"
_KEY = "turtlebot_gym"


@dataclass(frozen=True, kw_only=True)
class Card:
    """What a policy was trained for, and how."""

    env: str
    """Environment id."""
    robot: Mapping[str, Any]
    """The robot's limits, field by field, and under "name" the preset's name or "custom"."""
    dt: float
    """Control period, s."""
    noise: str
    """Noise preset, or "randomized" or "custom"."""
    filter: str
    """Filter preset."""
    observation: str
    """What the policy was shown: "ekf", "odometry" or "truth"."""
    training: Mapping[str, Any] = field(default_factory=dict)
    """Algorithm, steps, seed, versions, commit, wall time."""
    format: str = FORMAT
    layout: int = OBSERVATION_LAYOUT
    """Layout of the observation, `turtlebot_gym.OBSERVATION_LAYOUT`."""
    action: str = ACTION
    """What the outputs mean."""


def describe_robot(robot: str | Robot) -> dict[str, Any]:
    """Return a robot as a card has it."""
    return {"name": robot if isinstance(robot, str) else "custom", **asdict(make_robot(robot))}


def write_bundle(path: Path, graph: bytes, card: Card) -> None:
    """Write an ONNX model with its card.

    Args:
        path: The file; replaced in one step.
        graph: The serialized ONNX model, without metadata.
        card: What it is for.
    """
    import onnx

    tail = onnx.ModelProto()
    entry = tail.metadata_props.add()
    entry.key = _KEY
    content = {**asdict(card), "graph_bytes": len(graph), "sha256": hashlib.sha256(graph).hexdigest()}
    entry.value = json.dumps(content, sort_keys=True)
    beside = path.with_name(f".{path.name}.new")
    beside.write_bytes(graph + tail.SerializeToString())
    beside.replace(path)


class BundlePolicy:
    """A policy from a bundle: a callable from observations (..., 13) to actions (..., 2).

    Args:
        path: The file.
        robot: The robot that it is to drive; None skips the comparison.
        dt: The period that it is to run at, s; None skips the comparison.

    Raises:
        ValueError: If the file is no bundle, is damaged, or was trained for something else.
        ImportError: If onnxruntime is missing.
    """

    def __init__(self, path: str | Path, *, robot: str | Robot | None = None, dt: float | None = None) -> None:
        try:
            import onnxruntime
        except ImportError as error:
            raise ImportError("A policy bundle needs onnxruntime: pip install 'turtlebot-gym[deploy]'.") from error
        content = Path(path).read_bytes()
        options = onnxruntime.SessionOptions()
        options.intra_op_num_threads = options.inter_op_num_threads = 1
        options.log_severity_level = 4
        try:
            self._session = onnxruntime.InferenceSession(content, options, providers=["CPUExecutionProvider"])
            properties = json.loads(self._session.get_modelmeta().custom_metadata_map[_KEY])
        except Exception as error:  # onnxruntime has no common base class for its errors
            raise ValueError(f"{path} is not a policy bundle: make one with `turtlebot-gym export`.") from error
        if hashlib.sha256(content[: properties["graph_bytes"]]).hexdigest() != properties["sha256"]:
            raise ValueError(f"{path} is damaged: its hash is not the one it was written with.")
        self.sha256: str = properties["sha256"]
        """Hash of the network."""
        self.card = Card(**{item.name: properties[item.name] for item in fields(Card) if item.name in properties})
        """What it was trained for."""
        self._check(str(path), robot, dt)
        self._input = self._session.get_inputs()[0].name

    def _check(self, path: str, robot: str | Robot | None, dt: float | None) -> None:
        """Raise ValueError unless the policy may run here; the message names every difference."""
        card = self.card
        if (card.format, card.layout, card.action) != (FORMAT, OBSERVATION_LAYOUT, ACTION):
            raise ValueError(
                f"{path}: made as {card.format}, observation layout {card.layout}; this version reads {FORMAT}, layout "
                f"{OBSERVATION_LAYOUT}."
            )
        wanted = None if robot is None else describe_robot(robot)
        limits = ("max_linear", "max_angular", "wheel_separation", "max_wheel")
        other_robot = wanted is not None and any(wanted[name] != card.robot[name] for name in limits)
        other_rate = dt is not None and abs(dt - card.dt) > 1e-9
        if other_robot or other_rate:
            asked = f"{1.0 / (card.dt if dt is None else dt):g} Hz {(wanted or card.robot)['name']}"
            trained = f"{1.0 / card.dt:g} Hz for {card.robot['name']}"
            raise ValueError(f"{path}: trained at {trained}, asked for {asked}.")

    def __call__(self, observations: NDArray[np.float32]) -> NDArray[np.float32]:
        """Return actions (..., 2) for observations (..., 13)."""
        rows = np.asarray(observations, np.float32)
        actions = self._session.run(None, {self._input: rows.reshape(-1, rows.shape[-1])})[0]
        return np.asarray(actions).reshape(*rows.shape[:-1], 2)
