"""The view of the home page: what ``turtlebot-gym watch --html`` writes for a command of the page on watching."""

import contextlib
import io
import re
import shlex
import tempfile
from pathlib import Path

import mkdocs_gen_files

from turtlebot_gym_agents.commands.cli import main

COMMAND = re.compile(r"^turtlebot-gym (watch .*--html room\.html)$", re.MULTILINE)

(command,) = COMMAND.findall(Path("docs/howto/watch.md").read_text(encoding="utf-8"))
with tempfile.TemporaryDirectory() as folder:
    path = Path(folder, "room.html")
    with contextlib.redirect_stdout(io.StringIO()):
        main(shlex.split(command.replace("room.html", str(path))))
    with mkdocs_gen_files.open("gallery/room.html", "w") as view:
        view.write(path.read_text(encoding="utf-8"))
