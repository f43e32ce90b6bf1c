"""The nodes by name: ``python -m cmd_vel_guard NODE --ros-args -p NAME:=VALUE``."""

from __future__ import annotations

import os
import signal
import sys
from importlib import import_module
from pathlib import Path

from cmd_vel_guard.explain import explain

NODES = {"cmd_vel_guard": "guard", "cmd_vel_standby": "standby"}
HELP = f"usage: python -m cmd_vel_guard NODE [--ros-args -p NAME:=VALUE ... -r FROM:=TO ...], NODE one of {', '.join(NODES)}"


def main() -> int:
    """Run a node, and return its exit code."""
    name, *rest = sys.argv[1:] or ["--help"]
    if name in NODES:
        return _run(name, rest)
    asked = name in ("-h", "--help")
    print(HELP if asked else f"error: there is no node {name!r}. {HELP}", file=sys.stdout if asked else sys.stderr)
    return 0 if asked else 2


def _run(name: str, rest: list[str]) -> int:
    signal.signal(signal.SIGINT, lambda *_: os._exit(128 + signal.SIGINT))  # imports take seconds
    if "-h" in rest or "--help" in rest:
        module = import_module(f"cmd_vel_guard.{NODES[name]}")
        print(explain(f"python -m cmd_vel_guard {name}", module.__doc__, module.Parameters))
        return 0
    return import_module(f"cmd_vel_guard.{NODES[name]}").main(rest)


def run_as_program() -> int:
    """Run the node with the name of this program: the entry point of ``ros2 run cmd_vel_guard NODE``."""
    return _run(Path(sys.argv[0]).name, sys.argv[1:])


if __name__ == "__main__":
    raise SystemExit(main())
