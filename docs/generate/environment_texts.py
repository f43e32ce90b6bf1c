"""What the environments' pages say beside the tables that are made from the environments themselves."""

from typing import NamedTuple


class Texts(NamedTuple):
    """Sections of an environment's page."""

    description: str
    start: str
    end: str
    arguments: tuple[str, ...]
    """Fields of `turtlebot_gym.Options` that matter most here."""


ACTION = """\
`Box(-1, 1, (2,), float32)`: forward speed and turning rate as shares of the robot's limits. Values beyond 1 are clipped.
The command is scaled into the limits of each axis and each wheel; the scaling keeps the curvature of the path.
"""

COLUMNS = {
    "goal": (
        (1, "m", "distance to the waypoint"),
        (2, "", "cosine and sine of its bearing in the body frame; (1, 0) at distance 0"),
        (2, "", "cosine and sine of the heading still to turn"),
    ),
    "twist": ((1, "", "speed / limit"), (1, "", "turning rate / limit")),
    "uncertainty": (
        (1, "m", "standard deviation of the position, as the filter states it"),
        (1, "rad", "standard deviation of the heading"),
        (1, "", "normalized innovation squared of the last measurement"),
    ),
    "next_goal": (
        (1, "m", "distance to the waypoint after this one; to this one again if there is none"),
        (2, "", "cosine and sine of its bearing"),
    ),
    "scan": ((36, "", "shortest range of the newest scan in 36 sectors, from ahead to the left, / 3.5 m"),),
    "scan_age": ((1, "s", "age of that scan, by its stamp"),),
}
"""For each term of an observation: how many numbers, their unit, and what they are."""

REWARDS = {
    "progress": "progress along the path through the waypoints, as a share of what full speed allows in a step",
    "time": "-1 at every step",
    "effort": "minus the sum of the squared speed and turning rate, as shares of their limits",
    "success": "1 when the episode ends in success",
    "collision": "-1 when the episode ends in a collision",
    "nearness": "minus the share of 0.15 m that the clearance lacks",
    "goal": "1 at each goal but the last",
}

ROOM_REWARD = "In rooms, progress is measured along the shortest path through the room."

OPEN = "The robot is at rest. The first estimate is the first measurement with its variances."
TIME_LIMIT = "Truncation: after {steps} steps of 0.1 s, by Gymnasium's `TimeLimit`."
SENSED = """\
The robot's odometry is noisy, with spikes. A Kalman filter estimates pose and velocity from it. The policy sees the estimate,
how uncertain it is, and where the goal lies from there."""
SEEN = """\
The robot knows its goal in the frame of its odometry. It knows the room by a LiDAR, which turns while the robot drives. A path
to the goal always exists."""

TEXTS = {
    "TurtleBotNav": Texts(
        f"""\
A robot with two driven wheels drives to a point on open ground. {SENSED}""",
        f"""\
Start pose and goal are drawn in a square of 4 m, at least 0.5 m apart. {OPEN}""",
        """\
Termination: the robot is within 0.15 m of the goal, by its true pose; with `arrival="belief"` by the estimated one.""",
        ("noise", "filter", "robot", "observation", "arrival", "fix", "imu", "reward", "plant"),
    ),
    "TurtleBotPose": Texts(
        f"""\
A robot with two driven wheels drives to a point on open ground and arrives there with a given heading. {SENSED}""",
        f"""\
Start pose and goal pose are drawn in a square of 4 m, at least 0.5 m apart. {OPEN}""",
        """\
Termination: the robot is within 0.15 m and 0.2 rad of the goal pose, and turns at no more than 0.5 rad/s.""",
        ("noise", "filter", "robot", "observation", "arrival", "fix", "imu", "reward", "plant"),
    ),
    "TurtleBotSquare": Texts(
        f"""\
A robot with two driven wheels visits the corners of a square of 2 m in turn, as in the tutorial. With `waypoints` the
course is your own. {SENSED}""",
        f"""\
The robot starts at the origin. {OPEN}""",
        """\
Termination: the last corner is reached, each within 0.3 m. With `switch="time"` the next corner becomes current every 15 s,
reached or not, and there is no termination.""",
        ("waypoints", "switch", "laps", "noise", "filter", "robot", "observation", "fix", "imu", "reward"),
    ),
    "TurtleBotRooms": Texts(
        f"""\
A robot with two driven wheels finds its way around walls and obstacles. Each episode has a new room. {SENSED} {SEEN}""",
        """\
Room, start and goal are drawn, start and goal at least 1.5 m apart. The robot is at rest, the first scan is complete, and the
first estimate is the first measurement with its variances. `reset(options=...)` takes `world`, `start` and `goal` for one
episode.""",
        """\
Termination: the robot is within 0.2 m of the goal, or its footprint touches something, which is a collision.""",
        ("world", "lidar", "localizer", "noise", "filter", "robot", "observation", "arrival", "reward"),
    ),
    "TurtleBotMissions": Texts(
        f"""\
A robot with two driven wheels drives to one goal after another in a room, for ten minutes. {SENSED} {SEEN} On wheel odometry
the estimate drifts, and a `localizer` corrects it by scans in a map of the room.""",
        """\
As in [Rooms](TurtleBotRooms.md). Each further goal is drawn when the one before is reached or given up.""",
        """\
Termination: the robot's footprint touches something, or the last of `goals` is reached. The estimate decides whether a goal is
reached, as on a robot. A goal that is not reached within a minute is given up for the next one.""",
        ("world", "localizer", "start", "goals", "noise", "filter", "lidar", "robot", "observation", "reward"),
    ),
}
