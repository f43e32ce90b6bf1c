"""The scan at live nodes: it moves who sees by it, and what does not fit is refused on one line."""

import itertools
import math
from functools import partial

import numpy as np
import pytest
from geometry_msgs.msg import TwistStamped
from nav_msgs.msg import Odometry
from rclpy.qos import QoSProfile, ReliabilityPolicy
from rclpy.time import Time
from sensor_msgs.msg import LaserScan, TimeReference
from std_msgs.msg import Header

from turtlebot_gym.estimation.ekf import Estimate
from turtlebot_gym.rooms.scan import Scan
from turtlebot_gym.values import Belief, Covariance, Pose, State
from turtlebot_gym_ros import Graph, Shell
from turtlebot_gym_ros.blocks import TurtlebotSimulator, VelocityController
from turtlebot_gym_ros.graph.bringup import main as bringup
from turtlebot_gym_ros.graph.bringup import room_metrics
from turtlebot_gym_ros.node.block import Input, On, Output
from turtlebot_gym_ros.node.convert import conversion

SENSOR = QoSProfile(depth=50, reliability=ReliabilityPolicy.BEST_EFFORT)
TENTH = 100_000_000
BELIEF = Belief(State(0.0, 0.0, 0.0, 0.0, 0.0), Covariance(**dict.fromkeys(Covariance._fields, 0.01)))


def a_scan(beams=360, length=3.0):
    return Scan(np.full(beams, length, np.float32), 0.0, 2.0 * math.pi / beams, 0.12, 3.5)


CONTACT = 9
"""Seed of a room in which the straight way to the goal is blocked, after 2.1 s."""


@pytest.mark.nightly
def test_the_simulators_scans_are_a_sensors(runner, peer, wait_for):
    """Best effort, five a second by their stamps, in a graph of real time."""
    overrides = {"world": "dense", "lidar": "lds01", "seed": 3}
    simulator = Shell(TurtlebotSimulator, TurtlebotSimulator.Params, context=runner.context, overrides=overrides)
    runner.add(simulator)
    scans = peer.hear("scan", LaserScan, SENSOR)
    wait_for(lambda: len(scans) > 5)
    (info,) = peer.node.get_publishers_info_by_topic("scan")
    assert info.qos_profile.reliability is ReliabilityPolicy.BEST_EFFORT
    assert peer.node.count_publishers("scan/newest") == 0
    assert {len(scan.ranges) for scan in scans} == {360}
    stamps = np.array([Time.from_msg(scan.header.stamp).nanoseconds for scan in scans])
    assert np.isin(np.diff(stamps), 2 * TENTH * np.arange(1, 50)).all()
    assert scans[0].header.frame_id == "base_scan"


@pytest.mark.nightly
def test_contact_is_reported_once_and_ends_the_episode(capfd):
    """A driver straight to the goal, in a room with an obstacle on the way."""
    with Graph(world="dense", policy="bearing", seed=CONTACT, goal_tolerance=0.0, speed=20.0) as graph:
        graph.wait_until(lambda graph: any("contact after 2.1 s" in text for _, text in graph.reports.values()))
        graph.wait_until(lambda graph: graph.time > 4.0)
        trajectory = graph.trajectory()
        ended = room_metrics(trajectory)
    assert (ended["collision"], ended["goal reached"], ended["end of the episode, s"]) == (True, False, pytest.approx(2.1))
    assert ended["least clearance, m"] < 0.0
    assert capfd.readouterr().err.count("contact after") == 1


BLIND = "def blind(observation):\n    return [0.0, 0.0]\n\nblind.{}\n"


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ({"policy": "vfh"}, "and needs a world"),
        ({"policy": "ppo-nav"}, "ppo-nav: made for turtlebot_gym/TurtleBotNav-v0 and observation 'ekf', asked for"),
        ({"policy": "ppo-nav", "world": "dense"}, "was made for open ground, not for a world"),
        ({"policy": "other:blind"}, "observation has no term 'scam'"),
    ],
)
def test_what_does_not_fit_is_refused_before_anything_starts(options, said, tmp_path, monkeypatch, capsys):
    (tmp_path / "other.py").write_text(BLIND.format("terms = ('goal', 'scam')"))
    monkeypatch.syspath_prepend(tmp_path)
    with pytest.raises(ValueError) as refused:  # noqa: PT011  # the message is compared below
        Graph(**options).start()
    assert said in str(refused.value)
    argv = [word for name, value in options.items() for word in (f"--{name}", str(value))]
    assert bringup([*argv, "--duration", "1"]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert said in line


@pytest.mark.nightly
def test_in_lock_step_a_scan_is_sent_again_until_its_step_and_the_next_are_answered(runner, peer, wait_for):
    """Who begins to listen late hears it all the same: lds01's second scan comes with the third step."""
    overrides = {"world": "dense", "lock_step": True, "speed": 0.0}
    runner.add(Shell(TurtlebotSimulator, TurtlebotSimulator.Params, context=runner.context, overrides=overrides))
    truths, commands = peer.hear("true_state", Odometry), peer.speak("cmd_vel", TwistStamped)
    wait_for(lambda: truths and commands.get_subscription_count())
    for k, scan_of in enumerate((0, 0, 2, 2)):
        step, expected = 10**9 + k * TENTH, 10**9 + scan_of * TENTH
        wait_for(lambda step=step: Time.from_msg(truths[-1].header.stamp).nanoseconds == step)
        scans, newest = peer.hear("scan", LaserScan), peer.hear("scan/newest", TimeReference)  # after the step began
        wait_for(lambda scans=scans, newest=newest: scans and newest)
        assert {Time.from_msg(scan.header.stamp).nanoseconds for scan in scans} == {expected}
        pairs = {
            tuple(Time.from_msg(stamp).nanoseconds for stamp in (reference.header.stamp, reference.time_ref))
            for reference in newest
        }
        assert pairs == {(step, expected)}
        commands.publish(TwistStamped(header=truths[-1].header))


class Watcher:
    """A block that remembers what it was given."""

    inputs = {
        "estimate": Input(topic="estimate", type=Estimate),
        "scan": Input(topic="scan", type=Scan, lock_step="newest", aged=True),
    }
    outputs = {"reference": Output(topic="reference", type=Pose)}
    trigger = On("estimate")

    def __init__(self, params):
        self.given = []

    def reset(self):
        pass

    def step(self, dt, estimate, scan):
        self.given.append((round(estimate.belief.mean.x), round(float(scan.value.ranges[0])), scan.age))
        return {"reference": Pose(0.0, 0.0, 0.0)}


class Careless(Watcher):
    """The defect: it takes the scan that is at hand."""

    inputs = {**Watcher.inputs, "scan": Input(topic="scan", type=Scan, aged=True)}


def given_and_expected(runner, make, order, *, again):
    """Tell a node of nine steps, message by message, and return what its block was given, and what it should be.

    Scans come in every other step, half a step old.

    Args:
        runner: Whose context the node lives in.
        make: The block.
        order: In which the messages of a step come.
        again: Whether each step's messages come twice, the newest scan in every step.
    """
    shell = Shell(make, VelocityController.Params, context=runner.context, overrides={"lock_step": True})
    runner.add(shell)
    feed, stamp_of = shell.inputs.feeds["scan"], lambda at: Time(nanoseconds=at).to_msg()
    expected, info = [], {"source_timestamp": 0, "publication_sequence_number": None}  # as DDS would state it
    for k in range(9):
        at, since = 10**9 + k * TENTH, k % 2
        scan_at = at - since * TENTH - TENTH // 2
        header = Header(stamp=stamp_of(at), frame_id="odom")
        belief = BELIEF._replace(mean=State(float(k), 0.0, 0.0, 0.0, 0.0))
        scan = a_scan(length=3.0 if (k // 2) % 2 else 1.0)
        expected.append((k, round(float(scan.ranges[0])), (TENTH // 2 + since * TENTH) / 1e9))
        estimate = conversion(Estimate).write(Estimate(belief, 0.0, 0.0), header)
        seen = conversion(Scan).write(scan, Header(stamp=stamp_of(scan_at)))
        newest = TimeReference(header=header, time_ref=stamp_of(scan_at))
        say = {
            "estimate": partial(shell.inputs.receive, "estimate", estimate, info),
            "scan": partial(shell.inputs.receive, "scan", seen, info),
            "newest": partial(feed._teller.callback, newest) if hasattr(feed, "_teller") else lambda: None,
        }
        if since and not again:
            del say["scan"]
        for name in [kind for kind in order if kind in say] * (2 if again else 1):
            say[name]()
    return shell.block.given, expected


ORDERS = list(itertools.permutations(("estimate", "scan", "newest")))


@pytest.mark.parametrize("order", ORDERS)
@pytest.mark.parametrize("again", [False, True])
def test_in_lock_step_a_step_has_its_newest_scan_whatever_comes_first(runner, order, again):
    given, expected = given_and_expected(runner, Watcher, order, again=again)
    assert given == expected


def test_a_node_that_takes_the_scan_at_hand_is_noticed(runner):
    given, expected = given_and_expected(runner, Careless, ("estimate", "scan", "newest"), again=False)
    assert given != expected
