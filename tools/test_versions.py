"""Run quick tests with the lowest and with the newest versions that pyproject.toml allows, each in an environment of its own.

    python tools/test_versions.py both --folder .venv-versions

The lowest versions are those of the bounds of `LIBRARIES`; everything else is what pip chooses for them.
"""

from __future__ import annotations

import argparse
import re
import subprocess
import sys
import venv
from collections.abc import Iterator, Sequence
from pathlib import Path

if sys.version_info >= (3, 11):
    import tomllib
else:
    raise SystemExit("test_versions.py needs Python 3.11 or newer.")

ROOT = Path(__file__).parents[1]
LIBRARIES = ("llvmlite", "gymnasium", "stable-baselines3", "torch", "numpy")
"""The libraries whose bounds are tested."""
TESTS = (
    "tests/core/test_cache.py",
    "tests/core/test_systems.py",
    "tests/core/test_observations.py",
    "tests/core/test_rewards.py",
    "tests/core/test_equality.py",
    "tests/core/test_envs.py",
    "tests/core/test_vector_contract.py",
    "tests/rooms/test_rooms.py",
    "tests/agents/test_sb3_vec_env.py",
    "tests/agents/test_training.py",
    "tests/agents/test_export.py",
)
"""Quick tests: compiled loops equal plain Python, Gymnasium's contracts, a training and its export."""
TOOLS = ("pytest", "hypothesis", "shapely")


def requirements() -> Iterator[tuple[str, str]]:
    """Yield name and specifiers of each of `LIBRARIES` as pyproject.toml declares them."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]
    declared = [*project["dependencies"], *(line for lines in project["optional-dependencies"].values() for line in lines)]
    for name in LIBRARIES:
        specifiers = {match[1] for line in declared if (match := re.fullmatch(rf"{name}([<>=!~].*)", line.partition(";")[0]))}
        if len(specifiers) != 1:
            raise SystemExit(f"pyproject.toml must declare one range of {name}, got {sorted(specifiers) or 'none'}.")
        yield name, specifiers.pop()


def wanted(which: str) -> list[str]:
    """Return what pip installs for the "lowest" or the "newest" versions."""
    if which == "newest":
        return [f"{name}{specifiers}" for name, specifiers in requirements()]
    lowest = []
    for name, specifiers in requirements():
        bound = re.search(r">=([\w.]+)", specifiers)
        if bound is None:
            raise SystemExit(f"pyproject.toml declares no lower bound of {name}: {specifiers}.")
        lowest.append(f"{name}=={bound[1]}")
    return lowest


def run(folder: Path, which: str) -> int:
    """Make the environment, and return the exit status of its tests."""
    home = folder / which
    venv.create(home, with_pip=True, clear=True)
    python = str(home / "bin" / "python")
    upgrade = ["--upgrade", "--upgrade-strategy", "eager"] if which == "newest" else []
    install = [python, "-m", "pip", "install", "--quiet", *upgrade, "--editable", ".[agents]", *wanted(which), *TOOLS]
    subprocess.run(install, cwd=ROOT, check=True)
    subprocess.run([python, "-m", "pip", "list", "--format", "freeze"], cwd=ROOT, check=True)
    command = [python, "-m", "pytest", "-q", "-p", "no:cacheprovider", "-m", "not slow and not nightly", *TESTS]
    return subprocess.run(command, cwd=ROOT, check=False).returncode


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the tests with the versions that are asked for, and exit with 1 if any fails."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("which", nargs="?", default="both", choices=["lowest", "newest", "both"])
    parser.add_argument("--folder", type=Path, default=ROOT / ".venv-versions", help="where the environments are made")
    options = parser.parse_args(arguments)
    chosen = ["lowest", "newest"] if options.which == "both" else [options.which]
    failed = [which for which in chosen if run(options.folder, which) != 0]
    if failed:
        raise SystemExit(f"Tests failed with the {' and the '.join(failed)} versions.")


if __name__ == "__main__":
    main()
