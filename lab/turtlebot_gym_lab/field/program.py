"""Guide a person with a robot through the first afternoon, and write a report of it."""

from __future__ import annotations

import argparse
import gc
import json
import platform
import sys
import textwrap
import time
from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from dataclasses import fields
from pathlib import Path
from typing import Any

from turtlebot_gym import ROBOTS, __version__, make_robot
from turtlebot_gym.files import load, write_text
from turtlebot_gym.validation import NON_NEGATIVE, POSITIVE
from turtlebot_gym_lab.field.findings import REFUSED, Finding, passed
from turtlebot_gym_lab.field.rehearsal import Rehearsed, button, guards, simulated
from turtlebot_gym_lab.field.report import MARKS, page, shown
from turtlebot_gym_lab.field.session import TopicListener
from turtlebot_gym_lab.field.shared import QUIET, Field, Person
from turtlebot_gym_lab.field.steps import walk
from turtlebot_gym_ros.base.explain import descriptions
from turtlebot_gym_ros.base.options import parser_of
from turtlebot_gym_ros.base.process import Runner, be_interruptible, processes, refuse

WORDS = """It says before each motion what the robot will do, and waits for your word. Nothing moves before guard, standby and
emergency stop are alive and a press has stopped the guard. Ctrl-C stops the robot, and the report is written all the same."""


NUMBERS = {item.name: item.default for item in fields(Field) if isinstance(item.default, float)}
"""Options that are numbers, with their defaults: fields of `Field`."""


class Console:
    """A person at the terminal.

    Args:
        answers: Numbers by key, instead of questions.
        agrees: Whether to agree to everything without asking.
    """

    def __init__(self, answers: Mapping[str, Any], *, agrees: bool) -> None:
        self._answers, self._agrees = answers, agrees

    def confirm(self, key: str, text: str) -> bool:
        """Ask, unless it is answered."""
        answer = self._answers.get(key)
        if isinstance(answer, bool) or self._agrees:
            print(f"{text}.")
            return answer if isinstance(answer, bool) else True
        return input(f"{text}. Yes? [y/N] ").strip().lower() in ("y", "yes")

    def number(self, key: str, text: str) -> float | None:
        """Ask until the answer is a number or empty, unless it is answered."""
        if key in self._answers or self._agrees:
            return self._answers.get(key)
        while answer := input(f"{text}: ").strip():
            try:
                return POSITIVE.check("answer", float(answer))
            except ValueError as error:
                print(error)
        return None


def parser() -> argparse.ArgumentParser:
    """Return the parser of the command line."""
    options = parser_of("field_test", f"Guide you through the first afternoon with a robot, and write a report. {WORDS}")
    options.add_argument("--robot", default="burger", help=f"{', '.join(ROBOTS)} (default: burger), or FILE.yaml")
    options.add_argument("--out", type=Path, help="new folder of report, bag and noise file (default: field-test-TIME)")
    options.add_argument("--with-guard", action="store_true", help="start guard and standby here: run this on the robot then")
    options.add_argument("--twist", action="store_true", help="with --with-guard: the robot hears Twist, not TwistStamped")
    options.add_argument("--simulate", choices=["turtlebot3", "turtlebot4"], help="rehearse with a simulated robot")
    options.add_argument("--noise", default="wheel", help="with --simulate: noise of the robot, a preset or FILE.yaml")
    options.add_argument("--yes", action="store_true", help="agree to every motion without being asked")
    options.add_argument("--answers", type=Path, help="YAML or JSON file: a_straight, a_turn and square, as measured")
    texts = descriptions(Field)
    for name, default in NUMBERS.items():
        text = texts.get(name, "").replace("%", "%%")
        options.add_argument(f"--{name}", type=float, default=default, help=f"{text} (default: {default:g})")
    return options


def main(argv: Sequence[str] | None = None) -> int:
    """Run the test, write the report, and return 0 if nothing was refused, else 1."""
    options = parser().parse_args(argv)
    folder = options.out or Path(time.strftime("field-test-%Y-%m-%dT%H-%M-%S"))
    numbers = {name: getattr(options, name) for name in NUMBERS}
    try:
        make_robot(options.robot)
        answers: Any = load(options.answers) if options.answers else {}
        if not isinstance(answers, Mapping):
            raise ValueError(f"{options.answers} must hold answers by name.")
        for name, number in numbers.items():
            NON_NEGATIVE.check(f"--{name}", number)
        folder.mkdir(parents=True)
    except (ValueError, OSError) as error:
        return refuse(error)
    be_interruptible()
    seen: list[Finding] = []
    print(textwrap.fill(WORDS, 100))
    with ExitStack() as ending:
        field: Field | None = None
        try:
            field = _field(ending, options, folder, answers, numbers)
            walk(field, seen, report=_tell)
        except KeyboardInterrupt:
            seen.append(Finding("the end", REFUSED, "It was interrupted: the robot was stopped."))
        except (RuntimeError, OSError, ValueError) as error:
            seen.append(Finding("the end", REFUSED, f"It ended with an error: {' '.join(str(error).split())}"))
        finally:
            _write(folder, seen, field, options)
    print(f"report: {folder / 'report.html'}")
    return 0 if passed(seen) else 1


def _field(
    ending: ExitStack, options: argparse.Namespace, folder: Path, answers: Mapping[str, Any], numbers: Mapping[str, Any]
) -> Field:
    """Start what listens, and what is asked for: guard and standby, a simulated robot and its person."""
    nodes = guards(options.robot, stamped=not options.twist) if options.with_guard or options.simulate else []
    if options.simulate:
        nodes += simulated(options.robot, folder, noise=options.noise)
    ending.enter_context(processes(nodes, QUIET))
    runner = Runner(["--ros-args", *QUIET], local=bool(options.simulate))
    ending.callback(runner.close)
    listener = TopicListener(runner)
    person: Person = Console(answers, agrees=options.yes)
    if options.simulate:
        person = Rehearsed(runner, ending.enter_context(button()))
    gc.freeze()  # as in a node's process, since drives run in this one
    runner.start()
    field = Field(listener=listener, person=person, robot=options.robot, folder=folder, **numbers)
    ending.push(field.recording)
    return field


def _tell(finding: Finding) -> None:
    """Print a finding as it comes."""
    texts = ((figure.name, *shown(figure)) for figure in finding.figures)
    figures = ", ".join(f"{name} {value}" + (f" ({interval})" if interval else "") for name, value, interval in texts)
    lines = [f"{MARKS[finding.verdict]} {finding.name}: {finding.text} {figures}".rstrip()]
    lines += [f"  {finding.advice}"] if finding.advice else []
    print("\n".join(lines), flush=True)


def _write(folder: Path, seen: Sequence[Finding], field: Field | None, options: argparse.Namespace) -> None:
    """Write the report and its findings as JSON, with a bag that is complete."""
    if field:
        field.recording.close()
    robot = f"a simulated {options.simulate}" if options.simulate else options.robot
    about = {
        "Robot": robot,
        "Time": time.strftime("%Y-%m-%d %H:%M"),
        "turtlebot-gym": f"{__version__}, {platform.system()} {platform.machine()}, Python {platform.python_version()}",
        "Beside this page": ", ".join(sorted(path.name for path in folder.iterdir())) or "nothing",
    }
    pictures = {"paths": field.paths, "scan": field.scan} if field else {}
    write_text(folder / "report.html", page(seen, about=about, **pictures))
    content = [{**finding._asdict(), "figures": [figure._asdict() for figure in finding.figures]} for finding in seen]
    write_text(folder / "findings.json", json.dumps(content, indent=2) + "\n")


if __name__ == "__main__":
    sys.exit(main())
