"""Make the environments in which other people's libraries are run, one per file in requirements/.

Each has this package, what the file names, and the versions of constraints.txt, except where the file pins another one.

Usage:
    python environments.py FOLDER [NAME ...]
"""

import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).parents[2]
REQUIREMENTS = Path(__file__).parent / "requirements"


def make(folder: Path, name: str) -> None:
    """Make an environment in a folder, or bring the one there up to date."""
    file, place = REQUIREMENTS / f"{name}.txt", folder / name
    subprocess.run([sys.executable, "-m", "venv", place], check=True)
    own = {line.partition("==")[0] for line in file.read_text().splitlines()}
    pinned = (ROOT / "constraints.txt").read_text().splitlines()
    kept = [line for line in pinned if line.partition("==")[0] not in own]
    (place / "constraints.txt").write_text("\n".join(kept))
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
