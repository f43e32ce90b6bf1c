"""The closed loop as a live graph: from any order of launching, in processes and in one, driven by a policy or by hand."""

import functools
import itertools

import numpy as np
import pytest
from geometry_msgs.msg import PoseStamped, Twist, TwistStamped
from nav_msgs.msg import Odometry
from std_msgs.msg import String
from std_srvs.srv import Trigger

from turtlebot_gym.tasks import SQUARE_WAYPOINTS
from turtlebot_gym_ros import Graph
from turtlebot_gym_ros.base.qos import LATCHED
from turtlebot_gym_ros.graph.bringup import main, metrics
from turtlebot_gym_ros.graph.status import main as status

NODES = ("turtlebot_simulator", "kalman_filter", "velocity_controller", "waypoint_generator")
# Each node is first, second, third and last in some of these, and before and after every other.
ORDERS = [NODES, NODES[::-1], *itertools.islice(itertools.permutations(NODES), 7, 23, 4)]
ENDLESS = "laps:=1000"
"""Simulated time runs fast: a late listener would find a drive of one lap at its end, where it began."""
FAST = dict.fromkeys(NODES, ("lock_step:=true",)) | {
    "turtlebot_simulator": ("lock_step:=true", "speed:=10"),
    "velocity_controller": ("lock_step:=true", "start_enabled:=true"),
    "waypoint_generator": ("lock_step:=true", ENDLESS),
}
LEAST = 0.0
"""Largest difference from the environment."""
CLOSE = 0.4
"""A waypoint counts for the nodes within 0.3 m of the believed position, which errs by 3 cm on average."""
TOPICS = {
    "odom": Odometry,
    "true_state": Odometry,
    "estimate": Odometry,
    "reference": PoseStamped,
    "next_reference": PoseStamped,
    "cmd_vel": TwistStamped,
}


def node(name, *parameters):
    return ["-m", "turtlebot_gym_ros", name, "--ros-args", *(word for each in parameters for word in ("-p", each))]


@pytest.mark.nightly
@pytest.mark.parametrize("order", ORDERS, ids=lambda order: "-".join(name.split("_")[-1] for name in order))
def test_it_starts_from_any_order_and_the_bag_holds_all_that_was_heard(launch, peer, wait_for, read_bag, tmp_path, order):
    heard = {topic: peer.hear(topic, kind, 1000) for topic, kind in TOPICS.items()}
    logger = launch(*node("data_logger", "output:=run"))
    processes = {}
    for name in order:
        if processes:  # not all at once: the node before is up, and has nobody to talk to
            wait_for(lambda before=list(processes)[-1]: before in peer.node.get_node_names())
        processes[name] = launch(*node(name, *FAST[name]))
    wait_for(lambda: all(heard.values()))
    wait_for(lambda: any(message.pose.pose.position.x > 0.5 for message in heard["true_state"]))
    for topic in heard:
        subscriptions = functools.partial(peer.node.get_subscriptions_info_by_topic, topic)
        wait_for(lambda listen=subscriptions: "data_logger" in {each.node_name for each in listen()})
    before = {topic: len(messages) for topic, messages in heard.items()}
    wait_for(lambda: all(len(messages) > before[topic] + 20 for topic, messages in heard.items()))
    assert all(process.poll() is None for process in processes.values())
    for process in [*processes.values(), logger]:  # the logger last, after all that the others say at their end
        process.terminate()
        process.wait(timeout=20.0)
    held = read_bag(tmp_path / "run")
    for topic, messages in heard.items():
        recorded = held[f"/{topic}"]
        both = min(len(recorded), len(messages))  # from when both were matched: before, a step may have been sent many times
        assert messages[-both:] == recorded[-both:], topic
        assert both > 20, topic


@pytest.mark.nightly
def test_it_drives_the_square_in_processes():
    with Graph(processes=True, policy="bearing") as graph:
        graph.wait_until(lambda graph: graph.state == "silent: done")
        trajectory = graph.trajectory()
    figures = metrics(trajectory)
    assert figures["worst closest distance"] < CLOSE
    assert figures["estimate position error"] < 0.5 * figures["odometry position error"]
    assert np.hypot(*trajectory.true_state[-1, :2]) < 0.4
    visited = np.array(list(dict.fromkeys(map(tuple, trajectory.reference))))
    np.testing.assert_allclose(visited, SQUARE_WAYPOINTS, atol=1e-12)


@pytest.mark.nightly
def test_the_tutorials_figures_are_the_environments(compare):
    """In four processes, over 60 s, in every number."""
    drive = compare.SquareDrive("proportional", "tutorial", "time", "tutorial", 4)
    trajectory = compare.live(drive, 600, processes=True)
    differ = compare.differences(compare.episode(drive, 600), trajectory)
    assert max(differ.values()) <= LEAST, differ
    assert metrics(trajectory)["worst closest distance"] > 1.0  # it steers to headings, not to points


@pytest.mark.slow
def test_it_drives_for_a_minute_in_real_time():
    with Graph(processes=True) as graph:
        graph.wait_until(lambda graph: graph.time >= 60.0, timeout=120.0)
        assert len(np.unique(graph.trajectory().reference, axis=0)) == len(SQUARE_WAYPOINTS)
        assert metrics(graph.trajectory())["worst closest distance"] < CLOSE


def test_it_drives_the_square_in_one_process():
    with Graph(policy="bearing", noise="clean") as graph:
        graph.wait_until(lambda graph: graph.state == "silent: done")
        trajectory = graph.trajectory()
        assert graph.reports.keys() >= set(NODES)
        assert max(level for level, _ in graph.reports.values()) == 0, graph.reports
    assert metrics(trajectory)["waypoints reached"] == len(SQUARE_WAYPOINTS)  # without noise belief and truth agree
    np.testing.assert_allclose(np.diff(trajectory.time), 0.1, atol=1e-9)
    assert np.isfinite(trajectory.true_state).all()


def test_graphs_in_one_process_do_not_disturb_each_other():
    with Graph(domain=101, seed=1, laps=1000) as one, Graph(domain=102, speed=10.0, mode="teleoperation") as other:
        one.wait_until(lambda graph: graph.latest["true_state"].x > 1.0)
        assert other.latest["true_state"][:3] == (0.0, 0.0, 0.0)
        assert "reference" not in other.latest


@pytest.mark.nightly
def test_a_reset_of_the_plant_begins_again(peer):
    with Graph(speed=1.0) as graph:
        graph.wait_until(lambda graph: graph.latest["true_state"].x > 0.3)
        assert peer.ask("turtlebot_simulator/reset", Trigger, Trigger.Request()).success
        graph.wait_until(lambda graph: abs(graph.latest["true_state"].x) < 0.2)
        graph.wait_until(lambda graph: abs(graph.latest["estimate"].belief.mean.x) < 0.5)
        graph.wait_until(lambda graph: graph.latest["true_state"].x > 0.3)  # it drives on, still enabled


@pytest.mark.parametrize(("stamped", "kind"), [(True, TwistStamped), (False, Twist)])
def test_a_person_drives_with_the_type_of_velocity_that_is_configured(peer, wait_for, stamped, kind):
    with Graph(mode="teleoperation", noise="clean", speed=10.0, enable_stamped_cmd_vel=stamped) as graph:
        command = kind()
        (command.twist if stamped else command).linear.x = 0.15
        publisher = peer.speak("cmd_vel", kind)
        wait_for(lambda: publisher.get_subscription_count() >= 2)  # the plant and the recorder
        publisher.publish(command)  # once: the plant holds it for ever
        graph.wait_until(lambda graph: graph.latest["true_state"].x > 1.0)
        assert graph.latest["estimate"].belief.mean.x == pytest.approx(graph.latest["true_state"].x, abs=0.1)


@pytest.mark.nightly
def test_the_scripted_person_drives(launch, peer, wait_for):
    with Graph(mode="teleoperation", noise="clean", speed=10.0) as graph:
        states = peer.hear("simulated_teleop/state", String, LATCHED)
        launch(*node("simulated_teleop", "use_sim_time:=true"))
        wait_for(lambda: states and states[-1].data == "silent: done")
        commands = graph.trajectory().command
        commands = commands[np.isfinite(commands).all(axis=1)]  # in real time, a busy machine may lose a message
        # 0.15 m/s with 0.8 rad/s is beyond a wheel's limit: 0.15 + 0.8 * 0.08 = 0.214 m/s, of 0.2097.
        executed = {(0.15, 0.0), (0.147, 0.7839), (0.147, -0.7839), (0.0, 1.5), (0.0, 0.0)}
        assert executed == set(map(tuple, np.round(commands, 4).tolist()))
        graph.wait_until(lambda graph: graph.latest["true_state"].v == 0.0)


@pytest.mark.nightly
def test_wrong_parameters_are_refused():
    with pytest.raises(ValueError, match="policy"), Graph(policy="clever"):
        pass
    with pytest.raises(ValueError, match="has a parameter polcy"):
        Graph(polcy="bearing")
    with pytest.raises(ValueError, match="an unstamped Twist cannot be tied to a step"):
        Graph(enable_stamped_cmd_vel=False)
    with pytest.raises(ValueError, match="speed must be positive"):
        Graph(speed=0.0)
    with pytest.raises(ValueError, match="mode must be one of"):
        Graph(mode="manual")
    with pytest.raises(ValueError, match="policy"):  # before a process is started
        Graph(processes=True, policy="clever")
    with pytest.raises(RuntimeError, match="ended with exit code 2"), Graph(processes=True, noise="thunder"):
        pass


def test_bringup_prints_the_metrics_and_writes_the_figure(capfd, tmp_path):
    figure, report = tmp_path / "drive.png", tmp_path / "drive.json"
    assert main(["--speed", "20", "--duration", "5", "--figure", str(figure), "--json", str(report)]) == 0
    out = capfd.readouterr().out
    assert "estimate position error" in out
    assert figure.stat().st_size > 10_000
    assert '"speed": 20.0' in report.read_text()


@pytest.mark.parametrize("wrong", ["--policy clever", "--speed 0", "--duration 0", "--waypoints /nowhere.csv"])
def test_bringup_refuses_what_is_wrong_on_one_line(capsys, wrong):
    assert main(wrong.split()) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith("error: ")


@pytest.mark.nightly
def test_status_says_who_waits_for_what(capsys, launch, peer, wait_for):
    launch(*node("kalman_filter"))
    wait_for(lambda: "kalman_filter" in peer.node.get_node_names())
    assert status(["--seconds", "3", "--mode", "teleoperation"]) == 1
    out = " ".join(capsys.readouterr().out.split())
    assert "kalman_filter" in out
    assert "not there" in out
