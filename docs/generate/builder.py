"""The choices of the page that builds commands, from the package's registries, and the commands' forms."""

import gymnasium as gym

import turtlebot_gym  # noqa: F401  # registers the ids
from turtlebot_gym.presets import FILTERS, NOISES, make_filter
from turtlebot_gym.rooms.rules import ROOMS
from turtlebot_gym_agents.policies import POLICIES, make_policy
from turtlebot_gym_agents.policies.fit import MISSIONS, OPEN, require_task, require_terms
from turtlebot_gym_agents.policies.named import pretrained_folder

SQUARE = "turtlebot_gym/TurtleBotSquare-v0"


def fits(policy, env):
    """Return whether a policy can drive in an environment."""
    try:
        require_task(made := make_policy(policy), policy, env, "ekf")
        require_terms(made, policy, env)
    except ValueError:
        return False
    return True


def alone(filter):
    """Return whether a filter needs no further sensor."""
    try:
        make_filter(filter, NOISES["tutorial"])
    except ValueError:
        return False
    return True


def choices():
    """Return the tasks with their policies, worlds and the forms of their commands, and what is common to all."""
    names = [*POLICIES, *sorted(path.stem for path in pretrained_folder().glob("ppo-*.onnx"))]
    tasks = {}
    for env in (name for name in gym.registry if name.startswith("turtlebot_gym/")):
        rooms, given = env not in OPEN, " --noise {noise} --filter {filter}"
        world = " \\\n  --world {world}" if rooms else ""
        where = f"\\\n  --env {env}{world} \\\n {given} \\\n "
        graph = f"\\\n {given}{world}{' --goals 5' if env == MISSIONS else ''} \\\n "
        tasks[env] = {
            "policy": [name for name in names if fits(name, env)],
            "world": list(ROOMS) if rooms else [],
            "forms": {
                "evaluate": f"turtlebot-gym evaluate {where} --policy {{policy}}",
                "train": f"turtlebot-gym train {where} --out runs/mine",
                "watch": f"turtlebot-gym watch {where} --policy {{policy}}",
                "bringup": f"python -m turtlebot_gym_ros bringup {graph} --policy {{policy}}" if rooms or env == SQUARE else "",
            },
        }
    return {"task": tasks, "noise": list(NOISES), "filter": [name for name in FILTERS if alone(name)]}
