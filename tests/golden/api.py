"""What users hold on to: exported names, ids, info keys, commands with their flags, nodes with their topics and parameters.

python tests/golden/api.py > tests/golden/api.json
"""

import json
import sys
import tempfile
from typing import Any

import gymnasium as gym

import turtlebot_gym
import turtlebot_gym_agents
import turtlebot_gym_ros
from turtlebot_gym_agents.commands import fields
from turtlebot_gym_agents.commands.cli import COMMANDS, commands

ROS_OWN = ("/rosout", "/parameter_events", "/clock")


def ids_of() -> dict[str, list[str]]:
    """Return the keys of ``info`` by id, of the scalar and of the vector environment."""
    interface = {}
    for id in sorted(id for id, spec in gym.registry.items() if spec.namespace == "turtlebot_gym"):
        env = gym.make(id)
        interface[id] = sorted(env.reset(seed=0)[1])
        for info in ("default", "full"):
            envs = gym.make_vec(id, num_envs=1, vectorization_mode="vector_entry_point", info=info)
            interface[f"{id}, vector, {info}"] = sorted(envs.reset(seed=0)[1])
    return interface


def flags_of(command: str) -> list[str]:
    """Return the flags of a command."""
    flags = {flag.word: flag.kind for flag in fields.flags_of(commands()[command]) if not flag.is_positional}
    off = {f"--no-{word[2:]}" for word, kind in flags.items() if kind is bool}
    return sorted({*flags, *off, "--help", "--help-all"})


def nodes_of() -> dict[str, dict[str, Any]]:
    """Return topics, services and parameters of each node."""
    from rclpy.context import Context

    from turtlebot_gym_ros import Shell
    from turtlebot_gym_ros.nodes import BLOCKS, load
    from turtlebot_gym_ros.recording.logger import DataLogger

    interface = {}
    with tempfile.TemporaryDirectory() as folder:
        context = Context()
        context.init(["--ros-args", "--log-level", "warn", "-p", f"data_logger:output:={folder}/bag"])
        for name in (*BLOCKS, "data_logger"):
            if name in BLOCKS:
                block = load(name)
                shell = Shell(block, block.Params, name=name, context=context)
                node, end = shell.node, shell.close
            else:
                node = DataLogger(context)
                end = node.destroy_node
            ends = [*node.publishers, *node.subscriptions]
            parameters = node.get_parameters(sorted(node.list_parameters([], 0).names))
            interface[name] = {
                "topics": sorted(
                    {f"{end.topic_name} {end.msg_type.__name__}" for end in ends if end.topic_name not in ROS_OWN}
                ),
                "services": sorted(own for service in node.services if "parameter" not in (own := service.srv_name)),
                "parameters": {
                    parameter.name: str(parameter.value).replace(folder, "FOLDER")
                    for parameter in parameters
                    if "qos" not in parameter.name
                },
            }
            end()
        context.shutdown()
    return interface


def snapshot() -> dict[str, Any]:
    """Return all of it."""
    packages = (turtlebot_gym, turtlebot_gym_agents, turtlebot_gym_ros)
    return {
        "exports": {package.__name__: sorted(getattr(package, "__all__", ())) for package in packages},
        "info": ids_of(),
        "commands": {command: flags_of(command) for command in COMMANDS},
        "satellites": {command: flags_of(command) for command in commands() if command not in COMMANDS},
        "nodes": nodes_of(),
    }


if __name__ == "__main__":
    json.dump(snapshot(), sys.stdout)
    print()
