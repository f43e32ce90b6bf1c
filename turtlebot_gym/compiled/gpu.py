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
from typing import Any

import numpy as np

from turtlebot_gym.compiled import native
from turtlebot_gym.compiled.loop import parts_of
from turtlebot_gym.compiled.packing import TILE, as_tuple, layout_of
from turtlebot_gym.compiled.program import Call, Program
from turtlebot_gym.compiled.proof import Case, reduced
from turtlebot_gym.compiled.values import Untraceable, numbers_of
from turtlebot_gym.heart import step_of
from turtlebot_gym.kernel import thread, threads
from turtlebot_gym.models.unicycle import command_of
from turtlebot_gym.observations.columns import size_of
from turtlebot_gym.systems import Parameters, System
from turtlebot_gym.values import Pose

THREADS = 64
"""Threads of a block on a GPU: a step takes so many registers that larger blocks leave a multiprocessor half empty."""


@cache
def loops_of(system: System, case: Case) -> tuple[Callable[..., None], Callable[..., None]]:
    """Return the functions that step and that reset environments; all parameters are part of the case."""
    act = step_of(system).act
    (load_parameters, _), (load_world, _), _, finish, reset = parts_of(system, case)

    def step_rows(actions, wrong, tiles, keys, waypoints, observations, outcomes):
        for row in range(thread(), len(observations), threads()):
            tile, lane, p = tiles[row // TILE], row % TILE, load_parameters(tiles[0], 0)
            key, world, forward, turn = int(keys[row // TILE, lane]), load_world(tile, lane), actions[row, 0], actions[row, 1]
            if not (math.isfinite(forward) and math.isfinite(turn)):
                wrong[0] = row + 1
            moved = act(world, command_of(forward, turn, p.robot), key, p)
            finish(row, tile, lane, key, world, moved, p, waypoints, observations, outcomes, ())

    def reset_rows(mask, begins, seeds, episodes, tiles, keys, waypoints, observations, outcomes):
        for row in range(thread(), len(observations), threads()):
            if mask[row]:
                at, lane = row // TILE, row % TILE
                reset(row, begins, seeds, episodes, tiles[at], lane, keys[at], tiles[0], waypoints, observations, outcomes, ())

    return step_rows, reset_rows


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

        case = Case(tuple(map(float, numbers_of(as_tuple(parameters)))), len(waypoints))
        self.num_envs, self.device, tiles = num_envs, torch.device(device), -(-num_envs // TILE)
        self._shapes = size_of(system.terms), layout_of(system).outcome.size - len(system.rewards)

        def zeros(*shape: int, dtype: Any = torch.int64) -> Any:
            return torch.zeros(shape, dtype=dtype, device=device)

        self.seeds, self.episodes, self._wrong = zeros(num_envs), zeros(num_envs), zeros(1)
        poses = torch.tensor(waypoints, dtype=torch.float64, device=device).repeat(num_envs, 1, 1)
        state = zeros(tiles, reduced(system, case).size * TILE, dtype=torch.float64), zeros(tiles, TILE), poses
        self._held = state, self.empty(), zeros(num_envs, 2, dtype=torch.float32), zeros(num_envs, dtype=torch.bool)
        (memory, results), (actions, mask) = ([*map(view_of, part)] for part in self._held[:2]), map(view_of, self._held[2:])
        build = on_processor if self.device.type == "cpu" else launcher(num_envs, self.device)
        step, reset = (Program(loop, f"{case}", build=build) for loop in loops_of(system, case))
        self._step = Call(step, (actions, view_of(self._wrong), *memory, *results))
        self._reset = Call(reset, (mask, True, view_of(self.seeds), view_of(self.episodes), *memory, *results))

    def step(self, actions: Any) -> tuple[Any, Any]:
        """Advance all environments by one step.

        Args:
            actions: Shape (N, 2), float32, contiguous, on the device; clipped to [-1, 1].

        Returns:
            New tensors: observations, shape (N, K), float32, and outcomes, shape (m, N), float64; see `batch.Batch.step`.
        """
        results = self.empty()
        for at, tensor in zip((0, 5, 6), (actions, *results), strict=True):
            self._step.put(at, tensor.data_ptr())
        self._step()
        return results

    def reset(self, mask: Any, observations: Any, outcomes: Any, *, begins: bool = True) -> None:
        """Start the episodes of ``seeds`` and ``episodes`` where a mask is true, and write their first observations.

        Args:
            mask: Shape (N,), boolean, on the device.
            observations: Shape (N, K); rows outside the mask are left as they are.
            outcomes: Shape (m, N); columns outside the mask are left as they are.
            begins: Whether episodes start; otherwise those that go on are written again.
        """
        self._reset.put(1, begins)
        for at, tensor in zip((0, 7, 8), (mask, observations, outcomes), strict=True):
            self._reset.put(at, tensor.data_ptr())
        self._reset()

    def empty(self) -> tuple[Any, Any]:
        """Return uninitialized observations and outcomes."""
        import torch

        (width, rows), count, device = self._shapes, self.num_envs, self.device
        observations = torch.empty((count, width), dtype=torch.float32, device=device)
        return observations, torch.empty((rows, count), dtype=torch.float64, device=device)

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
    if found := re.search(r"declare double @(?!llvm)(\w+)", text):
        raise Untraceable(f"a kernel calls math.{found[1]}, whose last bits differ from one processor to another")
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


def launcher(rows: int, device: Any) -> Callable[[str], Callable[[int], None]]:
    """Return the maker of kernels on a CUDA device, with a thread for each row, which run in torch's order of work."""
    import torch

    def build(text: str) -> Callable[[int], None]:
        """Return a function that calls a kernel with the numbers at an address, which become its only parameter."""
        driver = ctypes.CDLL("nvcuda.dll" if os.name == "nt" else "libcuda.so.1")
        module, function = ctypes.c_void_p(), ctypes.c_void_p()
        with torch.cuda.device(device):
            torch.cuda.current_stream().synchronize()  # makes torch's context the current one
            _check(driver.cuModuleLoadData(ctypes.byref(module), ptx_of(text) + b"\0"), "load the kernels")
            _check(driver.cuModuleGetFunction(ctypes.byref(function), module, b"entry"), "find a kernel")

        def launch(address: int) -> None:
            with torch.cuda.device(device):
                stream = ctypes.c_void_p(torch.cuda.current_stream().cuda_stream)
                shape, given = (-(-rows // THREADS), 1, 1, THREADS, 1, 1, 0), (ctypes.c_void_p * 1)(address)
                _check(driver.cuLaunchKernel(function, *shape, stream, given, None), "launch a kernel")

        return launch

    return build


def _check(code: int, what: str) -> None:
    if code:
        raise RuntimeError(f"The CUDA driver could not {what}: error {code} of cuda.h.")
