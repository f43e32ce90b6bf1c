"""The ROS package, for colcon; as a Python distribution the same modules are built by hatchling."""

from glob import glob

from setuptools import setup

NAME = "cmd_vel_guard"
NODES = ("cmd_vel_guard", "cmd_vel_standby")

setup(
    name=NAME,
    version="0.2.0",
    description="Guard, standby, emergency stop and collision monitor for any robot that takes cmd_vel.",
    license="MIT",
    packages=[NAME],
    package_data={NAME: ["py.typed", "*.xml"]},
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{NAME}"]),
        (f"share/{NAME}", ["package.xml"]),
        (f"share/{NAME}/launch", [f"launch/{NAME}.launch.xml"]),
        (f"share/{NAME}/config", sorted(glob("config/*.yaml"))),
    ],
    install_requires=["setuptools"],
    zip_safe=False,
    entry_points={"console_scripts": [f"{node} = {NAME}.__main__:run_as_program" for node in NODES]},
)
