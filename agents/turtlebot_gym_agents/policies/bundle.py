"""The policy bundle: one ONNX file that states what it was trained for and refuses everything else.

The file is an ONNX model that includes the normalization of observations and the memory of a frame stack or an LSTM, with a
card (a JSON description of its training) in its metadata. The card holds the hash of the whole file, computed with zeros in
place of the hash. onnxruntime runs it; a robot needs neither torch nor Stable-Baselines3. Loading a bundle runs no code.

A model without memory maps observations (n, k) to actions (n, 2). One with memory also takes m numbers per row and returns
those for the next step, both of shape (n, m). An episode begins with zeros.
"""

from __future__ import annotations

import hashlib
import json
import re
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, fields
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from turtlebot_gym import Options, Parameters, Robot
from turtlebot_gym.config import build, choose, refusal, short_repr
from turtlebot_gym.files import replacing
from turtlebot_gym.observations import OBSERVED, TERMS, ObservationTerm
from turtlebot_gym.observations.columns import size_of
from turtlebot_gym.observations.reading import read_items
from turtlebot_gym.systems import assemble
from turtlebot_gym.systems.parameters import DT
from turtlebot_gym_agents.policies.fit import describe_robot, require_fit
from turtlebot_gym_agents.provenance import plain

if TYPE_CHECKING:
    from onnx import ModelProto

FORMAT = "turtlebot-gym-policy/1"
ACTION = "forward speed and turning rate as shares of the robot's limits, in [-1, 1]"
KEY = "turtlebot_gym"
"""Key of the metadata in which an ONNX model has hash and card."""
_HASH = re.compile(rb'(?<="sha256": ")[0-9a-f]{64}(?=")')
_NO_HASH = "0" * 64


@dataclass(frozen=True, kw_only=True)
class Card:
    """Card of a policy: what it was trained for, and how."""

    env: str
    """Environment id."""
    robot: Mapping[str, Any]
    """The robot's limits, field by field (null for infinity), and under "name" the preset's name or "custom"."""
    dt: float
    """Control period, s."""
    noise: str
    """Noise preset, or "randomized" or "custom"."""
    filter: str
    """Filter preset."""
    observation: str
    """The robot's pose that the policy observed: "ekf", "odometry", "truth" or "located"."""
    terms: tuple[Mapping[str, Any], ...]
    """The terms of an observation in turn, each with name, unit, bounds of its numbers, how many values it shows and how many
    steps apart they are; a term of one's own also with its source, "module:name"."""
    training: Mapping[str, Any] = field(default_factory=dict)
    """Algorithm, steps, seed, versions, commit, wall time."""
    format: str = FORMAT
    action: str = ACTION
    """Meaning of the outputs."""

    def __post_init__(self) -> None:
        DT.check("dt", self.dt)
        choose("observation", self.observation, OBSERVED)
        kinds = {"env": str, "noise": str, "filter": str, "robot": Mapping, "training": Mapping, "terms": tuple}
        for name, kind in kinds.items():
            if not isinstance(getattr(self, name), kind):
                raise refusal(name, f"a {kind.__name__}", getattr(self, name))

    @classmethod
    def of(cls, env: str, options: Mapping[str, Any], parameters: Parameters, training: Mapping[str, Any]) -> Card:
        """Return the card of a policy that was trained in an environment of an id, with options as far as they differ from
        their defaults; ``training`` are entries about the training.
        """
        used = {item.name: options.get(item.name, item.default) for item in fields(Options)}
        names = {name: used[name] if isinstance(used[name], str) else "custom" for name in ("noise", "filter")}
        pose, items = read_items(used["observation"])
        system = assemble(parameters, used["system"], observation=() if items == (pose,) else items)
        terms, robot = described(system.terms), describe_robot(used["robot"])
        return cls(env=env, robot=robot, dt=parameters.dt, terms=terms, observation=pose, training=training, **names)


def described(terms: Sequence[ObservationTerm]) -> tuple[dict[str, Any], ...]:
    """Return terms as a card holds them."""
    parts = ("name", "unit", "low", "high", "length", "every", "source")
    return tuple(plain({part: getattr(term, part) for part in parts}) for term in terms)


def term_on(content: Any) -> ObservationTerm:
    """Return a term of a card; one of somebody's own has no kernel, since its module need not be here.

    An entry that is no term, or has other numbers than the term of its name here, is refused.
    """
    try:
        name, low, high = content["name"], tuple(content["low"]), tuple(content["high"])
        unit, source = str(content.get("unit", "")), str(content.get("source", ""))
        term = TERMS[name] if name in TERMS else ObservationTerm(name, _absent, low, high, unit, source=source)
        term = term.over(content.get("length", 1), every=content.get("every", 1))
    except (AttributeError, KeyError, TypeError, ValueError) as error:
        raise ValueError(f"a term must have name, low and high, got {short_repr(content)}: {error}") from error
    if (low, high) != term.bounds:
        raise ValueError(f"the term {name!r} has other bounds in this version than {short_repr(low)}, {short_repr(high)}.")
    return term


def _absent(world: Any, p: Any) -> Any:
    raise NotImplementedError("a term on a card has no kernel.")


def write_bundle(path: Path, model: ModelProto, card: Card) -> None:
    """Write an ONNX model, as this module describes it, with its card; the file and the model's metadata are replaced."""
    for part in (model, model.graph, *model.graph.node, *model.graph.value_info, *model.graph.input, *model.graph.output):
        del part.metadata_props[:]  # torch's exporter leaves paths of its machine there
        part.doc_string = ""
    content = {"sha256": _NO_HASH, "card": plain(asdict(card))}
    model.metadata_props.add(key=KEY, value=json.dumps(content, allow_nan=False))
    blank = model.SerializeToString()
    with replacing(path) as beside:
        beside.write_bytes(_with_hash(blank, hashlib.sha256(blank).hexdigest()))


def _session(path: object, content: bytes) -> Any:
    """Return the session of onnxruntime that runs a model."""
    try:
        import onnxruntime
    except ImportError as error:
        raise ImportError("A policy bundle needs onnxruntime: pip install 'turtlebot-gym[deploy]'.") from error
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = options.inter_op_num_threads = 1
    options.log_severity_level = 4
    try:
        return onnxruntime.InferenceSession(content, options, providers=["CPUExecutionProvider"])
    except Exception as error:  # onnxruntime has no common base class for its errors
        raise ValueError(f"{path} is not a policy bundle: {' '.join(str(error).split())}.") from error


class BundlePolicy:
    """A policy from a bundle: a callable from observations of the terms on its card to actions (..., 2).

    A file that is no bundle, is damaged, or was trained for another robot or control interval, s, is refused; None skips a
    comparison.
    """

    def __init__(self, path: str | Path, *, robot: str | Robot | None = None, dt: float | None = None) -> None:
        self._path, content = path, Path(path).read_bytes()
        self.sha256: str = _verified_hash(path, content)
        """Hash of the file."""
        self._session = _session(path, content)
        try:
            metadata = self._session.get_modelmeta().custom_metadata_map
            self.card = _read_card(json.loads(metadata[KEY])["card"])
            """Card of the policy."""
            self.terms = tuple(map(term_on, self.card.terms))
            """The terms of its observations."""
            if len({term.name for term in self.terms}) < len(self.terms):
                raise ValueError("a term is named twice.")
        except (KeyError, TypeError, ValueError, RecursionError) as error:
            raise ValueError(f"{path} is not a policy bundle: its card: {' '.join(str(error).split())}") from error
        inputs: Any = self._session.get_inputs()
        self._inputs = [item.name for item in inputs]
        self.memory: int = inputs[1].shape[-1] if len(inputs) == 2 and inputs[1].shape else 0
        """How many numbers it carries from a step to the next, such as a frame stack or the state of an LSTM; 0 for none."""
        self._require_shapes(size_of(self.terms))
        require_fit(path, self.card.robot, self.card.dt, robot, dt)
        self._memory: NDArray[np.float32] | None = None
        if self.memory:  # then it is a `PolicyWithMemory`
            self.reset = self._reset

    def __call__(self, observations: ArrayLike) -> NDArray[np.float32]:
        """Return actions (..., 2) for observations (..., n) of the card's terms; one with memory takes a step.

        Raises:
            ValueError: If the observations have another shape, or the actions are not finite.
        """
        rows = np.asarray(observations, np.float32)
        size, lead = size_of(self.terms), rows.shape[:-1]
        if rows.ndim == 0 or rows.shape[-1] != size:
            names = ",".join(term.spelled for term in self.terms)
            raise ValueError(f"{self._path}: made for observations (..., {size}), {names}, got {rows.shape}.")
        if self.memory and self._memory is None:
            self._reset(np.ones(lead, np.bool_))
        if self._memory is not None and self._memory.shape[:-1] != lead:
            raise ValueError(
                f"{self._path}: it remembers episodes of shape {self._memory.shape[:-1]}, got observations {rows.shape}: call "
                f"reset(mask) with a mask of shape {lead} where they begin."
            )
        memory = np.empty(0, np.float32) if self._memory is None else self._memory.reshape(-1, self.memory)
        actions, memory = self._run(rows.reshape(-1, size), memory)
        if not (np.isfinite(actions).all() and np.isfinite(memory).all()):
            raise ValueError(f"{self._path}: its model must give finite actions; for these observations it does not.")
        if self.memory:
            self._memory = memory.reshape(*lead, self.memory)
        return np.asarray(actions).reshape(*lead, 2)

    def _reset(self, mask: NDArray[np.bool_]) -> None:
        """Clear the memory where the mask (...) is true."""
        begins = np.asarray(mask, np.bool_)
        if self._memory is None or self._memory.shape[:-1] != begins.shape:
            self._memory = np.zeros((*begins.shape, self.memory), np.float32)
        self._memory = np.where(begins[..., None], np.float32(0.0), self._memory)

    def _require_shapes(self, size: int) -> None:
        """Refuse a model that does not return one action, and one memory, per observation of so many numbers."""
        inputs, outputs = self._session.get_inputs(), self._session.get_outputs()
        has_memory = isinstance(self.memory, int) and self.memory > 0
        wanted = ["tensor(float)", [size]], *([["tensor(float)", [self.memory]]] if has_memory else [])
        results = ["tensor(float)", [2]], *wanted[1:]
        ends = [[end.type, end.shape[1:]] for end in (*inputs, *outputs)]
        if ends != [*wanted, *results] or any(isinstance(end.shape[0], int) for end in inputs):
            memory = ", beside them from a memory (n, m) to the next one" if len(inputs) > 1 else ""
            raise ValueError(
                f"{self._path}: its model must be from float observations (n, {size}) to float actions (n, 2){memory}, it is "
                f"from {[(end.type, end.shape) for end in inputs]} to {[(end.type, end.shape) for end in outputs]}."
            )
        for rows in (1, 3):  # alone, and in a batch: a model may fix either size
            observations = np.full((rows, size), 0.5, np.float32)
            observations[-1], observations[0] = 1.0, 0.0
            memory = np.zeros((rows, self.memory), np.float32)
            for _ in range(2):  # the second time with its own memory
                try:
                    actions, memory = self._run(observations, memory)
                except Exception as error:  # onnxruntime has no common base class for its errors
                    raise ValueError(f"{self._path}: its model does not run: {' '.join(str(error).split())}") from error
                shapes = actions.shape, memory.shape
                if shapes != ((rows, 2), (rows, self.memory)) or not (np.isfinite(actions).all() and np.isfinite(memory).all()):
                    raise ValueError(f"{self._path}: its model must give {rows} finite actions for as many observations.")

    def _run(
        self, observations: NDArray[np.float32], memory: NDArray[np.float32]
    ) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """Return actions (n, 2), and the next memory (n, m) or what is given, for observations (n, k) and a memory (n, m)."""
        values = (observations, memory) if self.memory else (observations,)
        answers: Any = self._session.run(None, dict(zip(self._inputs, values, strict=True)))
        return answers[0], answers[1] if self.memory else memory


def _read_card(content: Mapping[str, Any]) -> Card:
    """Return the card in a bundle's metadata, without fields that this version does not know.

    A version that changes the meaning of other fields has another `FORMAT` or `ACTION`, and is refused.
    """
    made, read = (content["format"], content["action"]), (FORMAT, ACTION)
    if made != read:
        raise ValueError(f"made as {short_repr(made)}, but this version reads {read}.")
    known = {item.name: content[item.name] for item in fields(Card) if item.name in content}
    return build(Card, {**known, "terms": tuple(content["terms"])}, "card")


def _verified_hash(path: str | Path, content: bytes) -> str:
    """Return the hash in a bundle, or refuse it."""
    match = _HASH.search(content)
    if match is None:
        raise ValueError(f"{path} is not a policy bundle, or incomplete: make one with `turtlebot-gym export FILE`.")
    if hashlib.sha256(_with_hash(content, _NO_HASH)).hexdigest().encode() != match[0]:
        raise ValueError(f"{path} is damaged: its hash is not the one it was written with.")
    return match[0].decode()


def _with_hash(content: bytes, digest: str) -> bytes:
    return _HASH.sub(digest.encode(), content, count=1)
