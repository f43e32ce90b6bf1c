"""What the studies share: tasks, tuned baselines, trainings, results that are kept, and jobs in processes of their own."""

from __future__ import annotations

import json
import os
import pickle
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import asdict, dataclass
from hashlib import sha256
from multiprocessing import get_context
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.progress import track

from turtlebot_gym import ROBOTS, Robot
from turtlebot_gym_agents.evaluation.evaluate import Evaluation, evaluate
from turtlebot_gym_agents.evaluation.tune_baseline import Try, best_of, tune_baseline
from turtlebot_gym_agents.files import replacing
from turtlebot_gym_agents.policies.named import SAFETY
from turtlebot_gym_agents.provenance import provenance
from turtlebot_gym_agents.training.train import TrainingConfig, train

NAV, POSE, SQUARE = (f"turtlebot_gym/TurtleBot{name}-v0" for name in ("Nav", "Pose", "Square"))
BASELINES = {NAV: ("bearing",), POSE: ("polar", "rotate-drive-rotate"), SQUARE: ("bearing", "corner")}
"""Baselines of each task; on Nav, where no waypoint follows, `corner` is `bearing`."""


@dataclass(frozen=True, kw_only=True)
class Budget:
    """How much a comparison costs."""

    episodes: int = 2000
    """Paired episodes of each evaluation, and of each try of a baseline."""
    tries: int = 40
    """Tries of each baseline's tuning."""
    processes: int = os.cpu_count() or 1
    """Processes at once, each on one core."""


def results_folder(name: str) -> Path:
    """Return where trainings and tunings of this commit are kept, so that others are not taken for them.

    All states that are not committed share one folder: remove it where that matters.
    """
    return Path("out") / name / short(provenance()["commit"])


def short(commit: str | None) -> str:
    """Return a commit as people write it, still marked where files differ from it."""
    digits, dash, mark = (commit or "unknown").partition("-")
    return f"{digits[:12]}{dash}{mark}"


def slug(**options: Any) -> str:
    """Return a file's name for a scenario; of a robot it has what is not the burger's."""
    burger = asdict(ROBOTS["burger"])
    words = []
    for value in options.values():
        changes = asdict(value).items() - burger.items() if isinstance(value, Robot) else ()
        words += [f"{name}-{number}" for name, number in sorted(changes)] or [str(value).removeprefix("turtlebot_gym/")]
    return "".join(letter if letter.isalnum() else "-" for letter in "-".join(words))


def name_of(policy: str) -> str:
    """Return a policy's name for files: a bundle is known by its training's folder and its bytes."""
    bundle = Path(policy.removesuffix(SAFETY))
    if not bundle.is_file():
        return policy
    protected = SAFETY if policy.endswith(SAFETY) else ""
    return f"{bundle.parent.name}-{sha256(bundle.read_bytes()).hexdigest()[:12]}{protected}"


def kept(path: Path, make: Callable[..., Any], *arguments: Any) -> Any:
    """Return what a function makes of its arguments, from a file, which is made where it is missing."""
    if not path.exists():
        path.parent.mkdir(parents=True, exist_ok=True)
        with replacing(path) as beside:
            beside.write_bytes(pickle.dumps(make(*arguments)))
    return pickle.loads(path.read_bytes())


def tuned(folder: Path, policy: str, budget: Budget, **options: Any) -> list[Try]:
    """Return the tries of a baseline in a scenario, which are made where they are missing; the file is that of `tuned_file`."""
    return tune_baseline(policy, tuned_file(folder, policy, **options), tries=budget.tries, episodes=budget.episodes, **options)


def tuned_file(folder: Path, policy: str, **options: Any) -> Path:
    """Return the file of a tuned baseline."""
    return folder / "tuned" / f"{policy}-{slug(**options)}.json"


def best_baseline(folder: Path, budget: Budget, **options: Any) -> str:
    """Return which of a task's tuned baselines was fastest in its tuning; the evaluation has no say in that."""
    times = {policy: best_of(tuned(folder, policy, budget, **options)).time for policy in BASELINES[options["env"]]}
    return min(times, key=lambda policy: times[policy])


def evaluate_baselines(folder: Path, budget: Budget, first_seed: int, **options: Any) -> dict[str, Evaluation]:
    """Return evaluations of a task's tuned baselines, the one that was fastest in its tuning first."""
    best = best_baseline(folder, budget, **options)
    names = (best, *(policy for policy in BASELINES[options["env"]] if policy != best))
    common = {**options, "episodes": budget.episodes, "seed": first_seed}
    return {policy: evaluate(str(tuned_file(folder, policy, **options)), **common) for policy in names}


def trained(folder: Path, seed: int, steps: int | None, **options: Any) -> Path:
    """Return the folder of a training, which is made where it is missing; the options are those of `TrainingConfig`."""
    run = folder / f"ppo-{slug(**options)}-{seed}"
    if not (run / "policy.onnx").exists():
        train(TrainingConfig(steps=steps, seed=seed, **options), run, resume=True, progress=False)
    return run


def best_of_trainings(runs: Sequence[Path]) -> Path:
    """Return the folder of the training that did best on the trainings' own evaluation seeds."""
    told = {run: json.loads((run / "result.json").read_text(encoding="utf-8"))["best"]["return"] for run in runs}
    return max(told, key=lambda run: told[run])


def run_all(jobs: Sequence[tuple[Callable[..., Any], tuple[Any, ...]]], label: str, processes: int) -> list[Any]:
    """Run jobs, functions with their arguments, in processes of their own; return their results in order."""
    for threads in ("NUMBA_NUM_THREADS", "OMP_NUM_THREADS"):
        os.environ[threads] = "1"  # for the processes: each has one core
    with ProcessPoolExecutor(processes, mp_context=get_context("spawn")) as pool:
        futures = [pool.submit(function, *arguments) for function, arguments in jobs]
        try:
            for done in track(as_completed(futures), label, total=len(futures), console=Console(stderr=True)):
                done.result()  # an error ends the run at once
        except BaseException:
            pool.shutdown(wait=False, cancel_futures=True)
            raise
    return [future.result() for future in futures]
