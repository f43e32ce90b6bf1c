"""Shared by the studies: tasks, tuned baselines, trainings, stored results, and jobs in separate processes."""

from __future__ import annotations

import json
import os
import pickle
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import asdict, dataclass
from functools import partial
from hashlib import sha256
from multiprocessing import get_context
from pathlib import Path
from shutil import rmtree
from typing import Any
from unittest.mock import patch

from harness.study import each
from tune_baseline import Try, best_of, tune_baseline
from turtlebot_gym import ROBOTS, Robot
from turtlebot_gym.files import replacing
from turtlebot_gym_agents.evaluation.evaluate import evaluate
from turtlebot_gym_agents.evaluation.result import Evaluation
from turtlebot_gym_agents.policies.named import bare
from turtlebot_gym_agents.provenance import provenance
from turtlebot_gym_agents.training.config import TrainingConfig
from turtlebot_gym_agents.training.train import train

NAV, POSE, SQUARE = (f"turtlebot_gym/TurtleBot{name}-v0" for name in ("Nav", "Pose", "Square"))
BASELINES = {NAV: ("bearing",), POSE: ("bearing",), SQUARE: ("bearing", "corner")}
"""Baselines of each task; on Nav, without a following waypoint, `corner` equals `bearing`."""


@dataclass(frozen=True, kw_only=True)
class Budget:
    """Budget of a comparison."""

    episodes: int = 2000
    """Paired episodes per evaluation, and per try of a baseline."""
    tries: int = 40
    """Number of tries to tune each baseline."""
    processes: int = os.cpu_count() or 1
    """Number of parallel processes, each on one core; with 1 all runs in this one."""


def results_folder(name: str) -> Path:
    """Return the folder of trainings and tunings of this commit, so that they are not confused with others.

    All uncommitted states share one folder: remove it if that matters.
    """
    return Path("out") / name / short(provenance()["commit"])


def short(commit: str | None) -> str:
    """Return a commit's short form, still marked if files differ from it."""
    digits, dash, mark = (commit or "unknown").partition("-")
    return f"{digits[:12]}{dash}{mark}"


def slug(**options: Any) -> str:
    """Return a file name for a scenario; a robot is named by its differences from the burger."""
    burger = asdict(ROBOTS["burger"])
    words = []
    for value in options.values():
        limits = asdict(value) if isinstance(value, Robot) else {}
        changes = {name: limit for name, limit in limits.items() if limit != burger[name]}
        words += [f"{name}-{limit}" for name, limit in sorted(changes.items())] or [str(value).removeprefix("turtlebot_gym/")]
    return "".join(letter if letter.isalnum() else "-" for letter in "-".join(words))


def name_of(policy: str) -> str:
    """Return a policy's name for files; a bundle is identified by its training's folder and its bytes."""
    own = bare(policy)
    bundle, around = Path(own), policy[len(own) :]
    if not bundle.is_file():
        return policy
    return f"{bundle.parent.name}-{sha256(bundle.read_bytes()).hexdigest()[:12]}{around}"


def kept(path: Path, make: Callable[..., Any], *arguments: Any) -> Any:
    """Return a function's result from a file, computing and storing it if missing."""
    if not path.exists():
        path.parent.mkdir(parents=True, exist_ok=True)
        with replacing(path) as beside:
            beside.write_bytes(pickle.dumps(make(*arguments)))
    return pickle.loads(path.read_bytes())


def tuned(folder: Path, policy: str, budget: Budget, **options: Any) -> list[Try]:
    """Return the tries of a baseline in a scenario, which are run if missing; the file is that of `tuned_file`."""
    return tune_baseline(policy, tuned_file(folder, policy, **options), tries=budget.tries, episodes=budget.episodes, **options)


def tuned_file(folder: Path, policy: str, **options: Any) -> Path:
    """Return the file of a tuned baseline."""
    return folder / "tuned" / f"{policy}-{slug(**options)}.json"


def best_baseline(folder: Path, budget: Budget, **options: Any) -> str:
    """Return the tuned baseline of a task that was fastest in its tuning, independently of the evaluation."""
    times = {policy: best_of(tuned(folder, policy, budget, **options)).time for policy in BASELINES[options["env"]]}
    return min(times, key=lambda policy: times[policy])


def evaluate_baselines(folder: Path, budget: Budget, first_seed: int, **options: Any) -> dict[str, Evaluation]:
    """Return evaluations of a task's tuned baselines, with the fastest in tuning first."""
    best = best_baseline(folder, budget, **options)
    names = (best, *(policy for policy in BASELINES[options["env"]] if policy != best))
    common = {**options, "episodes": budget.episodes, "seed": first_seed}
    return {policy: evaluate(str(tuned_file(folder, policy, **options)), **common) for policy in names}


def trained(folder: Path, seed: int, steps: int | None, **options: Any) -> Path:
    """Return the folder of a training, which is run if missing; the options are those of `TrainingConfig`."""
    run = folder / f"ppo-{slug(**options)}-{seed}"
    if not (run / "policy.onnx").exists():
        rmtree(run, ignore_errors=True)  # of an interrupted training
        train(TrainingConfig(steps=steps, seed=seed, **options), run, progress=False)
    return run


def trainings(folder: Path, steps: int | None, seeds: int, **options: Any) -> list[Callable[[], Path]]:
    """Return the randomized trainings of a policy that is shipped; each returns its folder, and runs if that is missing."""
    return [partial(trained, folder, seed, steps, randomize=True, **options) for seed in range(seeds)]


def best_of_trainings(runs: Sequence[Path]) -> Path:
    """Return the folder of the best training on the trainings' own evaluation seeds."""
    returns = {run: json.loads((run / "result.json").read_text(encoding="utf-8"))["best"]["return"] for run in runs}
    return max(returns, key=lambda run: returns[run])


def run_all(jobs: Iterable[Callable[[], Any]], label: str, processes: int) -> list[Any]:
    """Call functions in separate processes, or here if it is to be one; return their results in order."""
    if processes == 1:
        return [job() for job in each(list(jobs), label)]
    one_thread = patch.dict(os.environ, TURTLEBOT_GYM_THREADS="1", OMP_NUM_THREADS="1")  # for the processes: each has one core
    with one_thread, ProcessPoolExecutor(processes, mp_context=get_context("spawn")) as pool:
        futures = list(map(pool.submit, jobs))
        try:
            for done in each(as_completed(futures), label, len(futures)):
                done.result()  # an error ends the run at once
        except BaseException:
            pool.shutdown(wait=False, cancel_futures=True)
            raise
    return [future.result() for future in futures]
