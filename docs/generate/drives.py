"""Figures of drives, which are driven while the site is built."""

import gymnasium as gym
import numpy as np
from matplotlib.figure import Figure
from panels import WIDTH

from turtlebot_gym.drive import Drive, position_error
from turtlebot_gym.plotting import BLUE, SKY_BLUE, VERMILLION, draw_position_error, draw_trajectory
from turtlebot_gym_agents.policies import BearingPolicy

SQUARE = "turtlebot_gym/TurtleBotSquare-v0"
DT = 0.1  # s


def square(name):
    """Return a drive around the square with the tutorial's noise and a filter, by bearing."""
    env, policy = gym.make(SQUARE, robot="tutorial", noise="tutorial", filter=name), BearingPolicy()
    observation, info = env.reset(seed=0)
    infos, over = [info], False
    while not over:
        observation, _, terminated, truncated, info = env.step(policy(observation))
        infos.append(info)
        over = terminated or truncated
    env.close()
    return Drive.stack(infos, time=DT * np.arange(len(infos)))


def blocks():
    """Return a diagram of the loop."""
    figure = Figure(figsize=(WIDTH, 1.9), layout="constrained")
    axes = figure.subplots()
    places = {"waypoints": (0.0, 1.0), "controller": (1.5, 1.0), "robot": (3.0, 1.0), "filter": (1.5, 0.0)}
    for name, (x, y) in places.items():
        axes.text(
            x, y, name, ha="center", va="center", bbox={"boxstyle": "round,pad=0.5", "facecolor": "0.93", "edgecolor": "0.3"}
        )
    arrows = (
        ((0.45, 1.0), (1.05, 1.0), "waypoint", (0.75, 1.12)),
        ((1.95, 1.0), (2.65, 1.0), "command", (2.3, 1.12)),
        ((3.0, 0.75), (1.9, 0.0), "odometry", (2.75, 0.3)),
        ((1.5, 0.25), (1.5, 0.75), "estimate", (1.8, 0.5)),
        ((1.1, 0.0), (0.0, 0.75), "estimate", (0.25, 0.3)),
    )
    for begin, end, label, at in arrows:
        axes.annotate("", end, begin, arrowprops={"arrowstyle": "-|>", "color": "0.3", "shrinkA": 0, "shrinkB": 0})
        axes.text(*at, label, ha="center", va="center", fontsize=9, color=BLUE)
    axes.set(xlim=(-0.5, 3.4), ylim=(-0.3, 1.3))
    axes.axis("off")
    return figure


def loop():
    """Return a drive from above, and the errors of odometry and estimate over time."""
    drive = square("matched")
    figure = Figure(figsize=(WIDTH, 3.4), layout="constrained")
    above, errors = figure.subplots(1, 2)
    draw_trajectory(above, drive)
    draw_position_error(errors, drive)
    figure.legend(*above.get_legend_handles_labels(), loc="outside upper center", ncols=4, frameon=False)
    return figure


def two_filters():
    """Return the errors of two filters beside that of the odometry over time."""
    figure = Figure(figsize=(WIDTH, 2.8), layout="constrained")
    panels = figure.subplots(1, 2, sharey=True)
    for axes, name in zip(panels, ("tutorial", "matched"), strict=True):
        drive = square(name)
        axes.plot(
            drive.time, position_error(drive.odometry, drive.true_state), ".", color=SKY_BLUE, markersize=3, label="odometry"
        )
        axes.plot(drive.time, position_error(drive.estimate, drive.true_state), color=VERMILLION, label="estimate")
        axes.set(xlabel="time (s)", title=f"filter {name}", ylim=0.0)
    panels[0].set_ylabel("position error (m)")
    panels[1].legend()
    return figure
