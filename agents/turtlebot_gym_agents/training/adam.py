"""Adam without torch's compiler: `torch.optim.Adam` imports that at the first update, which takes as long as torch itself.

References:
    Kingma, Ba, "Adam: a method for stochastic optimization" (2015), arXiv:1412.6980, algorithm 1.
"""

# pyright: reportPrivateImportUsage=false
# Torch documents its functions of several tensors, "foreach functions", under these names.

from __future__ import annotations

from collections.abc import Iterable
from math import sqrt
from typing import Any

import torch


class Adam:
    """The same updates as `torch.optim.Adam` with its defaults, to the bit, and the same ``state_dict``.

    Args:
        parameters: Tensors to update; those without a gradient stay as they are.
        lr: Learning rate.
        betas: Decay of the mean of the gradients, and of their squares.
        eps: Added to the root of the squares' mean.
    """

    def __init__(
        self,
        parameters: Iterable[torch.Tensor],
        lr: float = 1e-3,
        betas: tuple[float, float] = (0.9, 0.999),
        eps: float = 1e-5,
    ) -> None:
        self.param_groups: list[dict[str, Any]] = [{"params": [*parameters], "lr": lr, "betas": betas, "eps": eps}]
        self._state: dict[int, dict[str, torch.Tensor]] = {}

    def zero_grad(self) -> None:
        for parameter in self.param_groups[0]["params"]:
            parameter.grad = None

    @torch.no_grad()
    def step(self) -> None:
        """Update the parameters by their gradients."""
        group = self.param_groups[0]
        rate, (first, second), eps = group["lr"], group["betas"], group["eps"]
        updated = [(number, one) for number, one in enumerate(group["params"]) if one.grad is not None]
        for number, parameter in updated:
            if number not in self._state:
                means = {name: torch.zeros_like(parameter) for name in ("exp_avg", "exp_avg_sq")}
                self._state[number] = {"step": torch.zeros(()), **means}
        states = [self._state[number] for number, _ in updated]
        torch._foreach_add_([state["step"] for state in states], 1.0)
        counts = [state["step"].item() for state in states]
        means, squares = ([state[name] for state in states] for name in ("exp_avg", "exp_avg_sq"))
        gradients = [parameter.grad for _, parameter in updated]
        torch._foreach_lerp_(means, gradients, 1 - first)
        torch._foreach_mul_(squares, second)
        torch._foreach_addcmul_(squares, gradients, gradients, 1 - second)
        spreads = torch._foreach_sqrt(squares)
        torch._foreach_div_(spreads, [sqrt(1 - second**count) for count in counts])
        torch._foreach_add_(spreads, eps)
        steps = [-rate / (1 - first**count) for count in counts]
        torch._foreach_addcdiv_([parameter for _, parameter in updated], means, spreads, steps)

    def state_dict(self) -> dict[str, Any]:
        """Return the state, in the form of torch's optimizers."""
        group = self.param_groups[0]
        return {"state": self._state, "param_groups": [group | {"params": [*range(len(group["params"]))]}]}

    def load_state_dict(self, state: dict[str, Any], *, strict: bool = True) -> None:
        """Take over the state of an optimizer.

        Args:
            state: What `state_dict` returns, here or of torch's Adam.
            strict: For Stable-Baselines3; a state of other parameters is refused always.

        Raises:
            ValueError: If it is of other parameters.
        """
        group, parameters = state["param_groups"][0], self.param_groups[0]["params"]
        shapes = {number: part["exp_avg"].shape for number, part in state["state"].items()}
        if len(group["params"]) != len(parameters) or any(parameters[at].shape != shape for at, shape in shapes.items()):
            raise ValueError("the optimizer's state is of other parameters.")
        self._state = {at: {name: value.clone() for name, value in part.items()} for at, part in state["state"].items()}
        self.param_groups[0] |= {name: group[name] for name in ("lr", "betas", "eps")}
