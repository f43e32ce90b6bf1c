"""torch's Adam without slow imports, and a schedule; checkpoints refer to both by name."""

from __future__ import annotations

import inspect
from typing import Any

import torch

EPS = 1e-5
"""Default epsilon of Stable-Baselines3's on-policy algorithms: larger than torch's, against NaN."""


class Adam(torch.optim.Adam):
    """torch's Adam, bit-identical.

    torch's optimizers import ``torch._dynamo``, and with it sympy and more, to exclude themselves from ``torch.compile``. This
    class calls their methods without that, so a training step with it must not be compiled.
    """

    state_dict = inspect.unwrap(torch.optim.Adam.state_dict)
    load_state_dict = inspect.unwrap(torch.optim.Adam.load_state_dict)
    add_param_group = inspect.unwrap(torch.optim.Adam.add_param_group)
    zero_grad = inspect.unwrap(torch.optim.Adam.zero_grad)
    _step: Any = inspect.unwrap(torch.optim.Adam.step)

    def step(self, closure: Any = None) -> Any:
        """Make a step, see `torch.optim.Adam.step`."""
        with torch.no_grad():
            return self._step(closure)


class Linear:
    """A rate that falls linearly to zero."""

    def __init__(self, start: float) -> None:
        self.start = start

    def __call__(self, progress_remaining: float) -> float:
        # The last rollout goes beyond the total, and a negative rate would unlearn.
        return self.start * max(progress_remaining, 0.0)
