"""The film of the README and of the home page: train, watch, deploy.

    python docs/generate/film.py docs  # writes film.gif and film-dark.gif: a minute, and a ROS graph of 20 s

The same code gives the same film: the training has a seed, the drives have, and the graph runs in lock-step.
"""

import subprocess
import sys
from pathlib import Path

import numpy as np
from driving import drawn_with, driven, save_gif, spread
from matplotlib import get_data_path
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.patches import Circle
from PIL import Image, ImageDraw, ImageFont
from stable_baselines3.common.callbacks import BaseCallback

from turtlebot_gym.envs.colours import DARK, LIGHT
from turtlebot_gym_agents.figures import plot_learning
from turtlebot_gym_agents.training.callbacks import EvaluationCallback, policy_of
from turtlebot_gym_agents.training.config import TrainingConfig
from turtlebot_gym_agents.training.model import make_model
from turtlebot_gym_agents.training.train import learn

WIDTH, HEIGHT, TOP, SIDE = 880, 540, 74, 420
"""Size of the film, height of its head, and side of a panel, pixels."""
RATE = 10
"""Pictures per second."""
SCREEN, PROMPT, WRITTEN = "#0d1117", "#7ee787", "#e6edf3"
"""Colours of the terminal."""
EVALUATIONS, ROBOTS = 24, 12
DRIVES = (
    ("office", "planner+safety", 53, {}),
    ("people", "vfh+yield", 0, {"noise": "wheel", "observation": "ekf,tracks"}),
)
"""World, policy, seed and options of the drives that are watched."""
SECONDS = {"Train": 4.0, "Watch": 6.5, "Deploy": 4.5}
SAID = {
    "Train": "A policy learns on what a Kalman filter believes: seconds on one core.",
    "Watch": "It steers by the estimate, made of noisy odometry (blue), and tracks people (orange rings).",
    "Deploy": "The same filter and the same policy as ROS 2 nodes, equal to the bit.",
}
GRAPH = (
    "turtlebot_simulator  --/odom-->",
    "  kalman_filter  --/estimate-->",
    "  velocity_controller  --/cmd_vel-->",
    "  turtlebot_simulator",
    "waypoint_generator  --/reference-->",
    "  velocity_controller",
)
PRINTED = ("estimate", "path length", "waypoints reached", "worst closest")
"""Beginnings of the lines of the command's output that are shown."""
COMMAND = ["python", "-m", "turtlebot_gym_ros", "bringup", "--policy", "ppo-square", "--duration", "40"]


def font(size, face="DejaVuSans"):
    """Return a font that comes with matplotlib."""
    return ImageFont.truetype(str(Path(get_data_path(), "fonts", "ttf", f"{face}.ttf")), size)


class Paths(BaseCallback):
    """Evaluates a policy as it learns, and keeps the true paths of some robots each time."""

    def __init__(self, config, judge):
        super().__init__()
        self.envs, self.judge, self.kept = config.make(ROBOTS, info="full"), judge, []

    def _on_rollout_start(self):
        if len(self.judge.history) > len(self.kept):
            self.kept.append(self.drive(policy_of(self.model)))

    def drive(self, policy):
        """Return paths (T, robots, 2), NaN where an episode has ended, and the goals."""
        observations, info = self.envs.reset(seed=7)
        running, goals, path = np.ones(ROBOTS, bool), info["reference"][:, :2], [info["true_state"][:, :2]]
        for _ in range(250):
            observations, _, terminated, truncated, info = self.envs.step(policy(observations))
            running &= ~(terminated | truncated)
            path.append(np.where(running[:, None], info["true_state"][:, :2], np.nan))
        return np.array(path), goals


def trained():
    """Return the evaluations of a short training, and the paths at each."""
    config = TrainingConfig(steps=120_000, evaluations=EVALUATIONS, episodes=200)
    judge = EvaluationCallback(config.make(config.episodes), every=config.between_evaluations)
    paths = Paths(config, judge)
    envs = config.make_training()
    learn(make_model(config, envs), config, [judge, paths])
    return judge.history[: len(paths.kept)], paths.kept


def panel(colours):
    """Return a square figure on the film's paper, and its axes."""
    figure = Figure(figsize=(SIDE / 100.0, SIDE / 100.0), dpi=100, layout="constrained", facecolor=colours.paper)
    axes = figure.subplots()
    axes.set_facecolor(colours.paper)
    axes.tick_params(color=colours.text, labelcolor=colours.text)
    axes.spines[:].set_color(colours.text)
    return figure, axes


def picture_of(figure, colours):
    """Return a figure as a picture."""
    for label in (figure.axes[0].xaxis.label, figure.axes[0].yaxis.label):
        label.set_color(colours.text)
    canvas = FigureCanvasAgg(figure)
    canvas.draw()
    return Image.fromarray(np.asarray(canvas.buffer_rgba())).convert("RGB")


def train_scene(colours, history, kept):
    """Yield pictures of a growing learning curve beside the paths of the policy at that time."""
    pairs = []
    for at, (path, goals) in enumerate(kept):
        left, axes = panel(colours)
        plot_learning(axes, [history[: at + 1]])
        axes.lines[0].set_color(colours.walker)
        axes.set(xlim=(0.0, history[-1]["steps"]))
        right, axes = panel(colours)
        for goal, track in zip(goals, np.moveaxis(path, 1, 0), strict=True):
            axes.plot(*track.T, color=colours.truth, linewidth=1.4)
            axes.plot(*track[0], "s", color=colours.truth, markersize=5.0)
            axes.add_patch(Circle(goal, 0.15, fill=False, edgecolor=colours.goal, linewidth=2.2))
        axes.set(aspect="equal", xlim=(-3.0, 3.0), ylim=(-3.0, 3.0), xticks=(), yticks=())
        axes.set_xlabel(f"{ROBOTS} drives after {history[at]['steps']:,.0f} steps")
        pairs.append((picture_of(left, colours), picture_of(right, colours)))
    for at in np.linspace(0, len(pairs) - 1, round(SECONDS["Train"] * RATE)).round().astype(int):
        yield pairs[at]


def drive(id, policy, seed, colours, number, **options):
    """Return pictures of a drive without their head, and the legend in it."""
    pictures = spread(
        driven(f"turtlebot_gym/TurtleBot{id}-v0", policy, seed, dark=colours is DARK, **options), number, hold=RATE // 2
    )
    maps = [one.crop((0, 64, 640, 704)).resize((SIDE, SIDE), Image.Resampling.LANCZOS) for one in pictures]
    return maps, pictures[0].crop((0, 30, 640, 62))


def film(colours, history, kept, output):
    """Yield the pictures of the film."""
    scenes = {"Train": (train_scene(colours, history, kept), None)}
    number = round(SECONDS["Watch"] * RATE)
    left, right = (
        drive("Rooms", policy, seed, colours, number, world=world, **options) for world, policy, seed, options in DRIVES
    )
    scenes["Watch"] = zip(left[0], right[0], strict=True), right[1]
    number = round(SECONDS["Deploy"] * RATE)
    square, _ = drive("Square", "ppo-square", 0, colours, number)
    scenes["Deploy"] = ((terminal(output, at / (0.8 * number), colours), square[at]) for at in range(number)), None
    for name, (pairs, legend) in scenes.items():
        for left, right in pairs:
            page = Image.new("RGB", (WIDTH, HEIGHT), colours.paper)
            pen = ImageDraw.Draw(page)
            column = 14.0
            for scene in scenes:
                colour = colours.estimate if scene == name else colours.solid
                pen.text((column, 8), scene, fill=colour, font=font(24, "DejaVuSans-Bold"))
                column += pen.textlength(scene, font(24, "DejaVuSans-Bold")) + 28.0
            pen.text((14, 44), SAID[name], fill=colours.text, font=font(16))
            page.paste(left, (13, TOP))
            page.paste(right, (WIDTH - SIDE - 13, TOP))
            if legend:
                page.paste(legend, ((WIDTH - legend.width) // 2, HEIGHT - legend.height - 4))
            yield page


def terminal(lines, share, colours):
    """Return a terminal in which a share of the lines has appeared."""
    page = Image.new("RGB", (SIDE, SIDE), SCREEN)
    pen, shown = ImageDraw.Draw(page), lines[: 2 + round(share * (len(lines) - 2))]
    for at, line in enumerate(shown):
        pen.text((12, 14 + 22 * at), line, fill=PROMPT if line.startswith("$") else WRITTEN, font=font(13, "DejaVuSansMono"))
    return page


def graph():
    """Return the command and what it prints, in lines that fit into the terminal."""
    done = subprocess.run([sys.executable, *COMMAND[1:]], capture_output=True, text=True, check=True)
    printed = [line for line in done.stdout.splitlines() if line.startswith(PRINTED)]
    return [f"$ {' '.join(COMMAND[:4])} \\", f"    {' '.join(COMMAND[4:])}", "", *GRAPH, "", *printed]


if __name__ == "__main__":
    folder, printed = Path(sys.argv[1]), graph()
    history, kept = trained()
    for name, colours in (("film", LIGHT), ("film-dark", DARK)):
        inks = {colours.paper: drawn_with(colours), SCREEN: (PROMPT, WRITTEN)}
        save_gif(folder / f"{name}.gif", list(film(colours, history, kept, printed)), inks, rate=RATE)
