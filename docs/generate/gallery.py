"""The gallery's views: what ``turtlebot-gym watch --html`` writes for the commands on the page."""

import contextlib
import io
import re
import shlex
import tempfile
from pathlib import Path

import mkdocs_gen_files

from turtlebot_gym_agents.commands.cli import main

COMMAND = re.compile(r"^turtlebot-gym (watch .*--html (\w+\.html))$", re.MULTILINE)

with tempfile.TemporaryDirectory() as folder:
    for command, name in COMMAND.findall(Path("docs/gallery.md").read_text(encoding="utf-8")):
        path = Path(folder, name)
        with contextlib.redirect_stdout(io.StringIO()):
            main(shlex.split(command.replace(name, str(path))))
        with mkdocs_gen_files.open(f"gallery/{name}", "w") as view:
            view.write(path.read_text(encoding="utf-8"))
