"""Make the environments in which other people's libraries are run, one per file in requirements/.

Each has this package, what the file names, and the versions of constraints.txt, except where the file pins another one.

Usage:
    python environments.py FOLDER [NAME ...]
"""

import re
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).parents[2]
REQUIREMENTS = Path(__file__).parent / "requirements"
_NAME = re.compile(r"[A-Za-z0-9._-]+")


def constraints(requirements: str, pinned: str) -> str:
    """Return the pins of constraints.txt except those of packages that the requirements pin themselves."""
    own = {_key(line) for line in requirements.splitlines()}
    return "".join(line for line in pinned.splitlines(keepends=True) if _key(line) not in own or not _key(line))


def _key(line: str) -> str:
    name = _NAME.match(line)
    return re.sub(r"[-_.]+", "-", name[0]).lower() if name else ""


def make(folder: Path, name: str) -> None:
    """Make an environment in a folder, or bring the one there up to date."""
    file, pinned = REQUIREMENTS / f"{name}.txt", (ROOT / "constraints.txt").read_text(encoding="utf-8")
    place = folder / name
    subprocess.run([sys.executable, "-m", "venv", place], check=True)
    (place / "constraints.txt").write_text(constraints(file.read_text(encoding="utf-8"), pinned), encoding="utf-8")
    pip = [place / "bin" / "python", "-m", "pip", "install", "--quiet", "--disable-pip-version-check"]
    editable = ["--editable", f"{ROOT}[agents]"]
    subprocess.run([*pip, "--constraint", place / "constraints.txt", "--requirement", file, *editable], check=True)


def main(folder: str, *chosen: str) -> None:
    """Make environments, by default all of them."""
    for name in chosen or sorted(file.stem for file in REQUIREMENTS.glob("*.txt")):
        print(f"The environment {name} ...", flush=True)
        make(Path(folder), name)


if __name__ == "__main__":
    if len(sys.argv) < 2:
        sys.exit(__doc__)
    main(*sys.argv[1:])
