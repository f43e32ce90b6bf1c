"""A policy bundle's card as a page in Markdown, in the form of model hubs: purpose, training and results."""

from __future__ import annotations

import html
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from turtlebot_gym.observations import ObservationTerm
from turtlebot_gym_agents.policies.bundle import BundlePolicy

_PAGE = """---
library_name: turtlebot-gym
license: mit
pipeline_tag: reinforcement-learning
tags: [reinforcement-learning, robotics, navigation, ros2, onnx]
---

# {name}

A policy for a robot on wheels, by turtlebot-gym. It observes what a filter believes.

| | |
|---|---|
{rows}

## Use

```bash
turtlebot-gym evaluate --env {env} --policy {file}
```

It was trained in simulation, for the robot, the rate and the task above, and is refused elsewhere. It is not a safety
function: on a robot, run it behind `cmd_vel_guard`, and under supervision.
"""


def model_card(path: Path) -> str:
    """Return a bundle's card.

    A page with measured results, NAME.md beside NAME.onnx, as the policies of the package have it, becomes its last section.

    Args:
        path: The bundle.

    Raises:
        OSError: If the file cannot be read.
        ValueError: If the file is not a bundle, or is damaged.
        ImportError: If onnxruntime is missing.
    """
    policy, measured = BundlePolicy(path), path.with_suffix(".md")
    card = policy.card
    facts = {
        "task": f"`{_line(card.env)}`",
        "robot": _line(card.robot),
        "rate": f"{1.0 / card.dt:.3g} Hz",
        "observation": f"{_terms(policy.terms)}; pose: {card.observation}, filter: {_line(card.filter)}",
        "action": card.action,
        "noise": _line(card.noise),
        **{f"training: {_line(name)}": _line(value) for name, value in card.training.items()},
        "sha256": policy.sha256,
    }
    rows = "\n".join(f"| {name} | {value} |" for name, value in facts.items())
    page = _PAGE.format(name=path.stem, file=path.name, env=_line(card.env), rows=rows)
    return page + (f"\n## Measured\n{measured.read_text('utf-8').partition(chr(10))[2]}" if measured.is_file() else "")


def _terms(terms: Sequence[ObservationTerm]) -> str:
    """Return terms as a cell of a table, with how many numbers each is."""
    return ", ".join(f"{_line(term.spelled)} ({term.size}{f' {_line(term.unit)}' if term.unit else ''})" for term in terms)


def _line(value: Any) -> str:
    """Return a value of a card as a cell of a table."""
    if isinstance(value, Mapping):
        return ", ".join(f"{_line(name)} {_line(part)}" for name, part in value.items() if part is not None)
    text = f"{value:.4g}" if isinstance(value, float) else " ".join(str(value).split())
    return html.escape(text, quote=False).replace("|", "\\|")
