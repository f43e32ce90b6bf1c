"""The ROS package, for colcon; as part of the Python distribution the same modules are built by hatchling."""

import runpy
from glob import glob
from pathlib import Path
from xml.etree import ElementTree

from setuptools import find_packages, setup

NAME = "turtlebot_gym_ros"
HERE = Path(__file__).parent
LISTED = runpy.run_path(str(HERE / NAME / "nodes.py"))  # plain data, read without its imports

setup(
    name=NAME,
    version=ElementTree.parse(HERE / "package.xml").findtext("version"),
    description="The closed loop of turtlebot-gym as ROS 2 nodes, and any policy deployed on a TurtleBot.",
    license="MIT",
    packages=find_packages(include=[NAME, f"{NAME}.*"]),
    package_data={NAME: ["py.typed"]},
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{NAME}"]),
        (f"share/{NAME}", ["package.xml"]),
        (f"share/{NAME}/launch", sorted(glob("launch/*.launch.xml"))),
        (f"share/{NAME}/config", sorted(glob("config/*.yaml"))),
        (f"share/{NAME}/rviz", sorted(glob("rviz/*.rviz"))),
        (f"share/{NAME}/layouts", sorted(glob("layouts/*"))),
    ],
    install_requires=["setuptools"],
    zip_safe=False,
    entry_points={"console_scripts": [f"{node} = {NAME}.__main__:run_as_program" for node in LISTED["NODES"]]},
)
