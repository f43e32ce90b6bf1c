"""Entry point of the command line: says what to install if only the robot's part is installed."""

from __future__ import annotations

import sys
from collections.abc import Sequence

from turtlebot_gym_agents.process import ending_quietly, let_threads_sleep


@ending_quietly
def main(argv: Sequence[str] | None = None) -> int:
    """Run a subcommand, and return the exit status."""
    let_threads_sleep()  # the imports below load numpy
    from turtlebot_gym import __version__

    if [*(sys.argv[1:] if argv is None else argv)] == ["--version"]:
        print(f"turtlebot-gym {__version__}")
        return 0
    try:
        from turtlebot_gym_agents.commands.cli import main as run
    except ModuleNotFoundError as error:
        if str(error.name).startswith("turtlebot_gym"):
            raise
        print(f"turtlebot-gym: {error.name} is missing: pip install 'turtlebot-gym[gym]'.", file=sys.stderr)
        return 2
    return run(argv)


if __name__ == "__main__":
    raise SystemExit(main())
