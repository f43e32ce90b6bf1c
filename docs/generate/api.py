"""The API reference: a page for each package, with all its public modules, from their docstrings."""

from importlib import import_module
from pkgutil import walk_packages

import mkdocs_gen_files

PACKAGES = {
    "turtlebot_gym": "The core: models, filters, tasks, the step as a system, the compiled loop and the environments.",
    "turtlebot_gym_agents": "Policies, evaluation, training and the command line.",
    "turtlebot_gym_ros": "The blocks of the loop, and the shell that makes ROS 2 nodes of them.",
}
ELSEWHERE = ("turtlebot_gym.envs.navigation",)
"""Modules that have a page of their own."""

for package, title in PACKAGES.items():
    root = import_module(package)
    names = [package, *(module.name for module in walk_packages(root.__path__, f"{package}."))]
    modules = [name for name in names if not name.endswith("__main__") and not name.startswith(ELSEWHERE)]
    with mkdocs_gen_files.open(f"reference/{package}.md", "w") as page:
        print(f"# API: {package}\n\n{title}\n", file=page)
        for name in modules:
            print(f"::: {name}\n", file=page)
            if hasattr(import_module(name), "__path__"):  # what a package re-exports stands where it is defined
                print("    options:\n      members: []\n", file=page)
