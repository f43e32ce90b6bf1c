"""Lock-step on live nodes: the graph is the environment, whatever the machine does meanwhile, and says whom it waits for."""

import signal
import time
from dataclasses import replace

import numpy as np
import pytest
from bench import node
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import TwistStamped
from nav_msgs.msg import Odometry
from std_srvs.srv import SetBool, Trigger

from turtlebot_gym import NOISES, values, write_parameters
from turtlebot_gym.estimation.ekf import Estimate
from turtlebot_gym.values import STOP, Belief, Command, Covariance, Pose, State
from turtlebot_gym_ros import Graph
from turtlebot_gym_ros.graph.recorder import Recorder

STEPS = 300
LEAST = 0.0
"""Largest difference from the environment. Headings survive their quaternion; a limit that is applied twice may round twice."""
CHAIN = ("turtlebot_simulator", "kalman_filter", "waypoint_generator", "velocity_controller")
LAZY = """
import time
from turtlebot_gym_agents.policies import make_policy

bearing = make_policy("bearing", robot="burger")

def lazy(observation, calls=[]):
    calls.append(1)
    if len(calls) % 20 == 10:
        time.sleep(0.7)  # in real time, a fault after 0.5 s
    return bearing(observation)
"""


def assert_same(compare, expected, live):
    """Check that a live drive is the environment's in every number."""
    differ = compare.differences(expected, live)
    assert max(differ.values()) <= LEAST, differ


DRIVES = [
    # policy, noise, switch, filter and fix; whether in processes; what must make a difference, so that the comparison can fail
    (("ppo-square", "rough", "time", "matched", "none"), False, {}),
    (("bearing", "wheel", "arrival", "matched", "late"), True, {"fix": "none"}),
    *(
        pytest.param(*case, marks=pytest.mark.nightly)
        for case in (
            (("proportional", "tutorial", "time", "matched", "none"), False, {}),
            (("proportional", "rough", "arrival", "matched", "none"), False, {}),
            (("bearing", "documented", "arrival", "matched", "none"), False, {}),
            (("bearing", "rough", "time", "matched", "none"), False, {}),
            (("ppo-square", "tutorial", "arrival", "matched", "none"), False, {}),
            (("bearing", "wheel", "arrival", "matched", "none"), False, {}),
            (("bearing", "rough.yaml", "arrival", "gated", "none"), False, {"filter": "matched"}),
            (("bearing", "wheel", "arrival", "matched", "late"), False, {"fix": "none"}),
            (("bearing", "wheel", "arrival", "matched", "markers"), False, {"fix": "none"}),
        )
    ),
]


@pytest.mark.sample(1)
@pytest.mark.parametrize(("parameters", "processes", "otherwise"), DRIVES)
def test_the_graph_is_the_environment(compare, tmp_path, parameters, processes, otherwise):
    policy, noise, switch, filter, fix = parameters
    if noise.endswith(".yaml"):
        noise = str(tmp_path / noise)
        write_parameters(NOISES["rough"], tmp_path / "rough.yaml")
    drive = compare.SquareDrive(policy, noise, switch, "burger", 3, filter, fix)
    expected = compare.episode(drive, STEPS)
    assert_same(compare, expected, compare.live(drive, STEPS, processes=processes))
    if otherwise:
        other = compare.episode(drive._replace(**otherwise), STEPS)
        assert max(compare.differences(expected, other).values()) > 0.01


@pytest.mark.nightly
@pytest.mark.parametrize(("noise", "policy"), [("tutorial", "bearing"), ("wheel", "ppo-square")])
def test_the_graph_is_the_environment_in_mujoco(compare, noise, policy):
    pytest.importorskip("mujoco", reason="needs the extra [mujoco]")
    drive = compare.SquareDrive(policy, noise, "arrival", "burger", 3, plant="mujoco")
    expected, live = compare.episode(drive, 150), compare.live(drive, 150)
    np.testing.assert_array_equal(live.command, live.estimate[:, 3:])  # as the wheels have told it, which is not what was asked
    assert_same(compare, expected, replace(live, command=expected.command))
    unicycle = compare.episode(compare.SquareDrive(policy, noise, "arrival", "burger", 3), 150)
    assert max(compare.differences(expected, unicycle).values()) > 0.01


@pytest.mark.nightly
def test_a_busy_machine_and_processes_change_no_byte(compare, busy):
    drive = compare.SquareDrive()
    alone = [compare.digest(compare.live(drive, STEPS, processes=processes)) for processes in (False, True)]
    with busy(4):
        loaded = [compare.digest(compare.live(drive, STEPS, processes=processes)) for processes in (False, True)]
    assert len({*alone, *loaded}) == 1
    assert compare.digest(compare.live(drive._replace(seed=1), STEPS)) not in alone  # the fingerprint tells drives apart


def test_a_command_of_no_step_is_not_obeyed(compare):
    drive = compare.SquareDrive()
    with Graph(**drive._asdict(), goal_tolerance=0.0, speed=20.0) as graph:
        publisher = graph._recorder.node.create_publisher(TwistStamped, "cmd_vel", 10)
        graph.wait_until(lambda graph: publisher.get_subscription_count())
        while graph.time < 0.1 * 100:
            publisher.publish(TwistStamped())
            time.sleep(0.01)
        trajectory = graph.trajectory()
    assert_same(compare, compare.episode(drive, 100), compare.first(trajectory, 100))


@pytest.mark.nightly
def test_a_policy_that_takes_its_time_is_waited_for(compare, monkeypatch, tmp_path):
    (tmp_path / "lazy_policy.py").write_text(LAZY)
    monkeypatch.syspath_prepend(tmp_path)
    drive = compare.SquareDrive("bearing", "tutorial", "time", "burger", 3)
    expected = compare.episode(drive, 60)
    assert_same(compare, expected, compare.live(drive._replace(policy="lazy_policy:lazy"), 60))


@pytest.mark.nightly
def test_time_goes_on_when_the_controller_is_done_and_the_robot_rests():
    with Graph(policy="bearing", noise="clean") as graph:
        graph.wait_until(lambda graph: graph.state == "silent: done")
        graph.wait_until(lambda graph, at=graph.time: graph.time > at + 5.0)
        trajectory = graph.trajectory()
    np.testing.assert_array_equal(trajectory.true_state[-20:, 3:], 0.0)
    np.testing.assert_array_equal(np.ptp(trajectory.true_state[-20:], axis=0), 0.0)


@pytest.mark.nightly
def test_a_reset_begins_the_next_episode(compare, peer):
    drive = compare.SquareDrive("bearing", "tutorial", "time", "burger", 3)
    with Graph(**drive._asdict(), goal_tolerance=0.0, speed=20.0) as graph:
        graph.wait_until(lambda graph: graph.time > 40.0)
        assert peer.ask("turtlebot_simulator/reset", Trigger, Trigger.Request()).success
        graph.wait_until(lambda graph: graph.time < 40.0)  # for two seconds: nobody looks away for so long
        graph.wait_until(lambda graph: graph.time >= 10.0)
        trajectory = graph.trajectory()
    assert_same(compare, compare.episode(drive, 100, number=1), compare.first(trajectory, 100))


@pytest.mark.nightly
def test_while_it_is_not_enabled_time_stands_still(compare, peer):
    drive = compare.SquareDrive("bearing", "tutorial", "time", "burger", 3)
    with Graph(**drive._asdict(), goal_tolerance=0.0, speed=20.0) as graph:
        graph.wait_until(lambda graph: graph.time > 5.0)
        assert peer.ask("velocity_controller/enable", SetBool, SetBool.Request(data=False)).success
        time.sleep(0.3)  # the last answer may have been on its way
        at = graph.time
        with pytest.raises(TimeoutError, match="waits for /cmd_vel of the step"):
            graph.wait_until(lambda graph: graph.time > at, timeout=5.0)
        assert peer.ask("velocity_controller/enable", SetBool, SetBool.Request(data=True)).success
        graph.wait_until(lambda graph: graph.time >= 10.0)
        trajectory = graph.trajectory()
    assert_same(compare, compare.episode(drive, 100), compare.first(trajectory, 100))


@pytest.mark.nightly
@pytest.mark.parametrize("name", CHAIN[1:])
def test_a_node_that_is_suspended_is_waited_for_and_costs_no_bit(compare, name):
    drive = compare.SquareDrive("bearing", "rough", "time", "burger", 3)
    with Graph(**drive._asdict(), goal_tolerance=0.0, processes=True, speed=20.0) as graph:
        graph.wait_until(lambda graph: graph.time > 3.0)
        (process,) = (process for process in graph._processes if name in process.args)
        process.send_signal(signal.SIGSTOP)
        graph.wait_until(lambda graph: any("waits for /cmd_vel of the step" in text for _, text in graph.reports.values()))
        with pytest.raises(TimeoutError, match="waits for /cmd_vel of the step"):
            graph.wait_until(lambda graph: graph.time > 60.0, timeout=0.5)
        process.send_signal(signal.SIGCONT)
        graph.wait_until(lambda graph: graph.time >= 10.0)
        trajectory = graph.trajectory()
    assert_same(compare, compare.episode(drive, 100), compare.first(trajectory, 100))


@pytest.mark.nightly
def test_nodes_that_come_late_or_again_are_waited_for(launch, peer, wait_for):
    """Time goes on by itself as soon as the chain is complete; the simulator says who is missing."""
    reports, truths = peer.hear("/diagnostics", DiagnosticArray), peer.hear("true_state", Odometry, 1000)

    def says(text):
        statuses = (status for message in reports for status in message.status if status.name == "/turtlebot_simulator")
        return any(text in status.message for status in statuses)

    def moves():
        at = len({message.header.stamp.nanosec + message.header.stamp.sec * 10**9 for message in truths})
        wait_for(lambda: len({truth.header.stamp.nanosec + truth.header.stamp.sec * 10**9 for truth in truths}) > at + 5)

    running = {"turtlebot_simulator": launch(*node("turtlebot_simulator", "lock_step:=true", "speed:=10.0"))}
    wait_for(lambda: says("waits for /cmd_vel of the step at 1.000 s"))
    running["kalman_filter"] = launch(*node("kalman_filter", "lock_step:=true"))
    running["waypoint_generator"] = launch(*node("waypoint_generator", "lock_step:=true"))
    wait_for(lambda: says("waits for /cmd_vel of the step at 1.000 s"))
    running["velocity_controller"] = launch(*node("velocity_controller", "lock_step:=true", "start_enabled:=true"))
    moves()
    for name in CHAIN[1:]:
        running[name].kill()
        running[name].wait()
        time.sleep(0.3)
        extra = ("start_enabled:=true",) if name == "velocity_controller" else ()
        running[name] = launch(*node(name, "lock_step:=true", *extra))
        moves()


def test_a_recorder_counts_from_the_first_step_whatever_it_hears_first(runner):
    """Topics come in any order: what is said of a step before its true state belongs to it all the same."""
    recorder = Recorder(runner.context, lock_step=True)
    try:
        said = {"true_state": State(0.0, 0.0, 0.0, 0.0, 0.0), "odom": values.Odometry(Pose(0.0, 0.0, 0.0), STOP, True)}
        belief = Belief(said["true_state"], Covariance(*[0.0] * 15))
        said |= {"estimate": Estimate(belief, 0.0, 0.0), "reference": Pose(1.0, 0.0, 0.0)}
        for first in said:
            start = {"true_state": 1, "odom": 62, "estimate": 123, "reference": 184}[first] * 10**9  # episodes, a minute apart
            for k in range(2):
                for topic in sorted(said, key=lambda topic, first=first: topic != first):
                    recorder._add(start + k * 10**9, topic, said[topic])
            assert recorder.time == 1.0
            np.testing.assert_array_equal(recorder.trajectory().time, [0.0, 1.0])
    finally:
        recorder.node.destroy_node()


@pytest.mark.parametrize("lost", ["true_state", "odom", "estimate", "reference"])
def test_what_a_recorder_did_not_hear_in_real_time_is_nan_in_its_row(runner, lost):
    recorder = Recorder(runner.context)
    try:
        state = State(1.0, 2.0, 0.3, 0.1, 0.2)
        said = {"true_state": state, "odom": values.Odometry(Pose(1.0, 2.0, 0.3), Command(0.1, 0.2), True)}
        said |= {"estimate": Estimate(Belief(state, Covariance(*[1.0] * 15)), 0.0, 0.0), "reference": Pose(1.0, 0.0, 0.0)}
        for k in range(3):
            recorder._rows[k * 10**8] = {topic: value for topic, value in said.items() if k != 1 or topic != lost}
        drive = recorder.trajectory()
    finally:
        recorder.node.destroy_node()
    parts = {"true_state": ("true_state",), "odom": ("odometry", "command"), "estimate": ("estimate", "covariance")}
    for name in ("true_state", "odometry", "command", "estimate", "covariance", "reference"):
        rows = np.isnan(getattr(drive, name)).reshape(3, -1)
        assert rows.any(axis=1).tolist() == [False, name in parts.get(lost, (lost,)), False]
        assert rows.all(axis=1).tolist() == rows.any(axis=1).tolist()
