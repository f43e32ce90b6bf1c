"""The ROS reference, read from the nodes themselves: each is made, asked for its topics and parameters, and ended.

Only what cannot be asked for is read from the source: what a parameter means, and how old an input may be.
"""

import re
import tempfile
from dataclasses import MISSING, fields
from inspect import cleandoc
from pathlib import Path
from xml.etree import ElementTree

import griffe
import mkdocs_gen_files
from rclpy.context import Context
from rclpy.qos import DurabilityPolicy, ReliabilityPolicy

from cmd_vel_guard import guard, standby
from cmd_vel_guard.discovery import prepare
from cmd_vel_guard.sources import type_name
from turtlebot_gym_ros.base.frames import Common
from turtlebot_gym_ros.node.block import Every
from turtlebot_gym_ros.node.shell import Shell
from turtlebot_gym_ros.nodes import BLOCKS, load
from turtlebot_gym_ros.recording import logger

DOMAIN = 101
"""A ROS domain where nobody listens: a guard's first messages are zeros."""
PACKAGE = Path("bridges/turtlebot_gym_ros")
ROS_PACKAGES = ("turtlebot_gym_ros", "cmd_vel_guard")
ROS_OWN = ("/rosout", "/parameter_events", "/clock", "parameter", "type_description")
"""What every ROS node has, and the page leaves out."""

FOLDERS = ("turtlebot_gym", "."), ("turtlebot_gym_agents", "agents"), *((name, f"bridges/{name}") for name in ROS_PACKAGES)
sources = {name: griffe.load(name, search_paths=[folder]) for name, folder in FOLDERS}


def told(item):
    """Return a docstring of the source for a cell of a table."""
    return " ".join(item.docstring.value.split()).replace("|", "\\|") if item.docstring else ""


def quality(profile):
    """Return a quality of service in words."""
    reliable = profile.reliability == ReliabilityPolicy.RELIABLE
    latched = profile.durability == DurabilityPolicy.TRANSIENT_LOCAL
    return f"{'reliable' if reliable else 'best effort'}{', transient local' if latched else ''}, depth {profile.depth}"


def freshness(item):
    """Return how a block takes an input."""
    age = "the last value holds" if item.max_age is None else f"up to {item.max_age} s old"
    return f"{'required' if item.required else 'optional'}, {'each value once' if item.once else age}"


def topics_of(node, inputs):
    """Yield the rows of a node's topics and services."""
    taken = {f"/{item.topic}": freshness(item) for item in inputs.values()}
    for verb, ends in (("publishes", node.publishers), ("subscribes", node.subscriptions)):
        for end in ends:
            note = taken.get(end.topic_name, "") if verb == "subscribes" else ""
            yield f"| {verb} | `{end.topic_name}` | `{type_name(end.msg_type)}` | {quality(end.qos_profile)} | {note} |"
    for service in node.services:
        yield f"| serves | `{node.resolve_service_name(service.srv_name)}` | `{type_name(service.srv_type)}` | | |"


def parameters_of(node, classes):
    """Yield the rows of a node's parameters, declared by classes of which the later ones count."""
    declared = {field.name: (field, owner) for owner in classes for field in fields(owner)}
    for name, (field, owner) in declared.items():
        assert node.has_parameter(name), name
        default = field.default if field.default_factory is MISSING else field.default_factory()
        package, _, place = f"{owner.__module__}.{owner.__qualname__}.{name}".partition(".")
        meaning = told(sources[package][place])
        yield f"| `{name}` | {type(default).__name__} | `{default!r}` | {meaning} |"


def write(page, node, description, classes, block=None):
    """Write a node's section."""
    print(f"## {node.get_name()}\n\n{re.split('Inputs:|Parameters:', cleandoc(description))[0].strip()}\n", file=page)
    inputs = block.inputs if block else {}
    if block:
        trigger = block.trigger
        timed = isinstance(trigger, Every)
        print(f"Runs {f'every {trigger.period} s' if timed else f'on `/{inputs[trigger.input].topic}`'}.\n", file=page)
    rows = [row for row in topics_of(node, inputs) if not any(own in row for own in ROS_OWN)]
    if rows:
        print(
            "| | topic or service | type | quality of service | as input |\n|---|---|---|---|---|",
            *rows,
            "",
            sep="\n",
            file=page,
        )
    rows = parameters_of(node, classes)
    print("| parameter | type | default | meaning |\n|---|---|---|---|", *rows, "", sep="\n", file=page)


prepare()
with mkdocs_gen_files.open("reference/ros.md", "w") as page, tempfile.TemporaryDirectory() as folder:
    print(
        "# ROS reference\n\nThis page is read from the running nodes. Names are relative, so namespaces and remappings work as "
        "usual. The parameters `qos_overrides.TOPIC...` override the quality of service of a block's topics. Parameters are "
        "fixed once a node runs; a wrong name, type or value is refused. `/cmd_vel` carries TwistStamped, or Twist where "
        "`enable_stamped_cmd_vel` is false.\n",
        file=page,
    )
    context = Context()
    words = ["-p", f"data_logger:output:={folder}/bag"]
    numbers = ("max_linear", "max_angular", "wheel_separation", "radius")
    words += [word for name in numbers for word in ("-p", f"cmd_vel_guard:{name}:=0.1")]
    context.init(["--ros-args", "--log-level", "warn", *words], domain_id=DOMAIN)
    for name in BLOCKS:
        block = load(name)
        shell = Shell(block, block.Params, name=name, context=context)
        write(page, shell.node, block.__doc__, (Common, block.Params), shell.block)
        shell.close()
    for module, make in ((guard, guard.CmdVelGuard), (standby, standby.CmdVelStandby), (logger, logger.DataLogger)):
        node = make(context)
        write(page, node, module.__doc__, (module.Parameters,))
        if isinstance(node, logger.DataLogger):
            node.close()  # its files
        node.destroy_node()
    context.shutdown()
    print("## Launch files\n", file=page)
    for path in sorted((PACKAGE / "launch").glob("*.launch.xml")):
        launch = ElementTree.parse(path).getroot()
        started = ", ".join(f"`{node.get('name')}`" for node in launch.iter("node"))
        print(f"### {path.name}\n\nStarts {started}.\n\n| argument | default | meaning |\n|---|---|---|", file=page)
        for argument in launch.iter("arg"):
            print(f"| `{argument.get('name')}` | `{argument.get('default')}` | {argument.get('description')} |", file=page)
        print(file=page)
