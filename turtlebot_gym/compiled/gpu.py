"""Environments on a GPU: the kernels of open ground as PTX, a thread for each environment, on tensors of torch.

LLVM makes PTX from the text from which it makes machine code, with the same rounding, and NVIDIA's driver compiles that for the
GPU. On the device "cpu" of torch the same loops run on this processor, which tests compare with the engine.
"""

from __future__ import annotations

import ctypes
import math
import os
import re
from collections.abc import Callable, Sequence
from functools import cache
from typing import Any, NamedTuple

import numpy as np

from turtlebot_gym.compiled import native
from turtlebot_gym.compiled.loop import parts_of
from turtlebot_gym.compiled.packing import TILE, as_tuple, flatten, layout_of
from turtlebot_gym.compiled.program import Call, Program
from turtlebot_gym.compiled.proof import Case, reduced
from turtlebot_gym.compiled.values import Untraceable
from turtlebot_gym.heart import step_of
from turtlebot_gym.kernel import kernel, thread, threads
from turtlebot_gym.models.random import episode_key
from turtlebot_gym.models.unicycle import command_of
from turtlebot_gym.observations.columns import size_of
from turtlebot_gym.systems import Parameters, System
from turtlebot_gym.values import Pose

NUMBERS = ("reward", "distance")
"""Rows of the numbers of a step."""
FLAGS = ("is_success", "terminated", "truncated", "ended")
"""Rows of the truths of a step; the last is that the episode was terminated or truncated."""
THREADS = 64
"""Threads of a block on a GPU: a step takes so many registers that larger blocks leave a multiprocessor half empty."""


@cache
def loops_of(system: System, case: Case) -> tuple[Callable[..., None], Callable[..., None]]:
    """Return the functions that step and that reset environments; all parameters are part of the case."""
    (begin, start_outcome, act, conclude, retarget), count = step_of(system), case.waypoints
    load_parameters, load_world, store_world, show, *_ = parts_of(system, case)
    lay_out = system.lay_out

    @kernel
    def write(row, world, outcome, p, observations, numbers, flags):
        show(observations[row], world, p)
        numbers[0, row], numbers[1, row] = outcome.reward, outcome.distance
        flags[0, row], flags[1, row], flags[2, row] = outcome.is_success, outcome.terminated, outcome.truncated
        flags[3, row] = outcome.terminated or outcome.truncated

    @kernel
    def start(row, keys, seeds, episodes, waypoints, p):
        key = episode_key(int(seeds[row]), int(episodes[row]))
        keys[row] = key
        pose, goal = lay_out(key, p, ())
        if p.task.random:
            waypoints[row, 0, 0], waypoints[row, 0, 1], waypoints[row, 0, 2] = goal.x, goal.y, goal.theta
        return begin(pose, key, waypoints[row], p, ())

    def step_rows(actions, mask, at_once, wrong, tiles, keys, seeds, episodes, waypoints, observations, numbers, flags):
        last = len(numbers) - 1
        for row in range(thread(), len(keys), threads()):
            tile, lane, key, p = tiles[row // TILE], row % TILE, int(keys[row]), load_parameters(tiles[0], 0)
            forward, turn = float(actions[row, 0]), float(actions[row, 1])
            if not (math.isfinite(forward) and math.isfinite(turn)):
                wrong[0] = row + 1
            world = load_world(tile, lane)
            world, outcome = conclude(world, act(world, command_of(forward, turn, p.robot), key, p), key, count, p, ())
            if outcome.reached:
                world, outcome = retarget(world, outcome, key, waypoints[row], p, ())
            write(row, world, outcome, p, observations[last], numbers[last], flags[last])
            begins = outcome.terminated or outcome.truncated if at_once else mask[row]
            if begins:
                episodes[row] += 1
                world = start(row, keys, seeds, episodes, waypoints, p)
                outcome = start_outcome(world)
            store_world(tile, lane, world)
            if begins or at_once:
                write(row, world, outcome, p, observations[0], numbers[0], flags[0])
            if at_once and not begins:  # nothing has ended
                numbers[last, 1, row], flags[last, 0, row] = 0.0, False

    def reset_rows(mask, begins, tiles, keys, seeds, episodes, waypoints, observations, numbers, flags):
        for row in range(thread(), len(keys), threads()):
            if mask[row]:
                tile, lane, p = tiles[row // TILE], row % TILE, load_parameters(tiles[0], 0)
                if begins:
                    store_world(tile, lane, start(row, keys, seeds, episodes, waypoints, p))
                world = load_world(tile, lane)
                write(row, world, start_outcome(world), p, observations[0], numbers[0], flags[0])

    return step_rows, reset_rows


class Results(NamedTuple):
    """Tensors of one or two copies of all environments; the second is that of the end of an episode."""

    observations: Any
    """Shape (c, N, K), float32."""
    numbers: Any
    """Shape (c, 2, N), float64, with a row for each of `NUMBERS`."""
    flags: Any
    """Shape (c, 4, N), boolean, with a row for each of `FLAGS`."""


class DeviceBatch:
    """Environments that are stepped together on a device; `batch.Batch` is the same without one.

    ``seeds`` and ``episodes``, shape (N,), are the numbers of the episodes, to be changed in place.

    Args:
        num_envs: Number of environments.
        parameters: For all environments; they are part of the kernels.
        waypoints: The poses to visit; a goal that the task draws replaces the first.
        system: The kernels of a step on open ground.
        device: Name of the device of torch.

    Raises:
        Untraceable: If a kernel of the system cannot run on a GPU; the message says why.
    """

    def __init__(
        self, num_envs: int, parameters: Parameters, waypoints: Sequence[Pose], *, system: System, device: str
    ) -> None:
        import torch

        numbers = zip(layout_of(system).parameters.names, flatten(as_tuple(parameters)), strict=True)
        case = Case(tuple(numbers), len(waypoints))
        world, _ = reduced(system, case)
        self.num_envs, self.device, self._width = num_envs, torch.device(device), size_of(system.terms)
        whole, tiles = {"dtype": torch.int64, "device": device}, -(-num_envs // TILE)
        self.seeds, self.episodes = torch.zeros(num_envs, **whole), torch.zeros(num_envs, **whole)
        self._nowhere = torch.zeros(num_envs, dtype=torch.bool, device=device)
        self._wrong = torch.zeros(1, dtype=torch.int32, device=device)
        state = torch.zeros((tiles, world.size * TILE), dtype=torch.float64, device=device)
        poses = torch.tensor(waypoints, dtype=torch.float64, device=device).repeat(num_envs, 1, 1)
        self._held = state, torch.zeros(num_envs, **whole), self.seeds, self.episodes, poses
        build = on_processor if self.device.type == "cpu" else Launcher(num_envs, self.device)
        step, reset = (Program(loop, f"{case}", build=build) for loop in loops_of(system, case))
        memory, actions = [*map(view_of, self._held)], torch.zeros((num_envs, 2), device=device)
        mask, wrong = view_of(self._nowhere), view_of(self._wrong)
        self._steps = [
            Call(step, (view_of(actions), mask, at_once, wrong, *memory, *map(view_of, self.empty(1 + at_once))))
            for at_once in (False, True)
        ]
        self._reset = Call(reset, (mask, True, *memory, *map(view_of, self.empty())))

    def step(self, actions: Any, mask: Any = None) -> Results:
        """Advance all environments by one step, and begin the next episode of some.

        Args:
            actions: Shape (N, 2), float32, contiguous, on the device; clipped to [-1, 1].
            mask: Where an episode begins, shape (N,), boolean; None for where one has ended.

        Returns:
            New tensors, without a mask two copies; last distances and successes are zero where no episode has ended.
        """
        at_once = mask is None
        call, results = self._steps[at_once], self.empty(1 + at_once)
        for at, tensor in zip((0, 1, 9, 10, 11), (actions, self._nowhere if at_once else mask, *results), strict=True):
            call.put(at, tensor.data_ptr())
        call()
        return results

    def reset(self, mask: Any, results: Results, *, begins: bool = True) -> None:
        """Start the episodes of ``seeds`` and ``episodes`` where a mask is true, and write their first observations.

        Args:
            mask: Shape (N,), boolean, on the device.
            results: One copy, to write to; what is outside the mask is left as it is.
            begins: Whether episodes start; otherwise those that go on are written again.
        """
        self._reset.put(1, begins)
        for at, tensor in zip((0, 7, 8, 9), (mask, *results), strict=True):
            self._reset.put(at, tensor.data_ptr())
        self._reset()

    def empty(self, copies: int = 1) -> Results:
        """Return uninitialized results."""
        import torch

        count, device = self.num_envs, self.device
        return Results(
            torch.empty((copies, count, self._width), dtype=torch.float32, device=device),
            torch.empty((copies, len(NUMBERS), count), dtype=torch.float64, device=device),
            torch.empty((copies, len(FLAGS), count), dtype=torch.bool, device=device),
        )

    def take_wrong(self) -> int | None:
        """Return an environment whose action was not finite since the last call, or None; wait for the device."""
        row = int(self._wrong)
        self._wrong.zero_()
        return row - 1 if row else None


def view_of(tensor: Any) -> Any:
    """Return a contiguous tensor as an array that knows its address: on a GPU nobody may read it here."""
    memory = (ctypes.c_char * tensor.nbytes).from_address(tensor.data_ptr())
    return np.frombuffer(memory, str(tensor.dtype).removeprefix("torch.")).reshape(tuple(tensor.shape))


def _checked(text: str) -> str:
    """Return LLVM's text of a kernel that has the same bits everywhere.

    Raises:
        Untraceable: If it calls what each processor rounds in its own way.
    """
    if found := re.search(r"declare double @(?!llvm)(\w+)|(frem)", text):
        what = f"math.{found[1]}" if found[1] else "the remainder of floats"
        raise Untraceable(f"a kernel calls {what}, whose last bits differ from one processor to another")
    return text


_ALONE = """
define i64 @thread() alwaysinline { ret i64 0 }
define i64 @threads() alwaysinline { ret i64 1 }
"""
_ON_GPU = """
declare i32 @llvm.nvvm.read.ptx.sreg.tid.x()
declare i32 @llvm.nvvm.read.ptx.sreg.ctaid.x()
define i64 @thread() alwaysinline {
  %block = call i32 @llvm.nvvm.read.ptx.sreg.ctaid.x()
  %first = mul i32 %block, BLOCK
  %own = call i32 @llvm.nvvm.read.ptx.sreg.tid.x()
  %row = add i32 %first, %own
  %whole = zext i32 %row to i64
  ret i64 %whole
}
define i64 @threads() alwaysinline { ret i64 4294967296 }  ; more than there are: each has one environment
""".replace("BLOCK", str(THREADS))


def on_processor(text: str) -> Callable[[int], None]:
    """Return what calls a kernel on this processor, for all environments in turn."""
    return native.entry_of(native.machine_code(_checked(text) + _ALONE, 1))


def ptx_of(text: str) -> bytes:
    """Return the PTX of LLVM's text: its entry is a kernel whose only parameter are the numbers of the block."""
    words = 1 + max(map(int, re.findall(r"getelementptr i64, ptr %block, i64 (\d+)", text)))
    entry = f"define ptx_kernel void @entry(ptr byval([{words} x i64]) align 8 %block)"
    text = re.sub(r"define void @entry\(.*?\)", entry, _checked(text))
    return native.ptx_of(text + _ON_GPU).encode()


class Launcher:
    """Runs kernels on a CUDA device, in torch's order of work, by NVIDIA's driver.

    Args:
        rows: Environments, each with a thread.
        device: torch's device.
    """

    def __init__(self, rows: int, device: Any) -> None:
        self._blocks, self._device = -(-rows // THREADS), device

    def __call__(self, text: str) -> Callable[[int], None]:
        """Return what calls a kernel with the numbers at an address, which become its only parameter."""
        import torch

        driver = ctypes.CDLL("nvcuda.dll" if os.name == "nt" else "libcuda.so.1")
        module, function = ctypes.c_void_p(), ctypes.c_void_p()
        with torch.cuda.device(self._device):
            torch.cuda.current_stream().synchronize()  # makes torch's context the current one
            _check(driver.cuModuleLoadData(ctypes.byref(module), ptx_of(text) + b"\0"), "load the kernels")
            _check(driver.cuModuleGetFunction(ctypes.byref(function), module, b"entry"), "find a kernel")

        def launch(address: int) -> None:
            with torch.cuda.device(self._device):
                stream = ctypes.c_void_p(torch.cuda.current_stream().cuda_stream)
                shape, given = (self._blocks, 1, 1, THREADS, 1, 1, 0), (ctypes.c_void_p * 1)(address)
                _check(driver.cuLaunchKernel(function, *shape, stream, given, None), "launch a kernel")

        return launch


def _check(code: int, what: str) -> None:
    if code:
        raise RuntimeError(f"The CUDA driver could not {what}: error {code} of cuda.h.")
