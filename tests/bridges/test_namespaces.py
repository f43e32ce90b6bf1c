"""Robots in one graph and discovery: below a namespace each, they share a ROS domain and nothing else."""

import os
import re
import signal
import subprocess
import sys
from pathlib import Path
from xml.etree import ElementTree

import pytest
from bench import guarded
from diagnostic_msgs.msg import DiagnosticArray
from nav_msgs.msg import Odometry
from rcl_interfaces.srv import GetParameters
from rclpy.node import Node
from std_msgs.msg import Empty, String

from cmd_vel_guard.discovery import PROFILE, _profiles_variable, prepare
from cmd_vel_guard.process import Runner
from turtlebot_gym_ros import Graph
from turtlebot_gym_ros.base.names import absolute, prefix_of, remapping
from turtlebot_gym_ros.graph import status

STEPS = 300
ROBOTS = ("robot1", "robot2")


@pytest.fixture
def drives(compare):
    """Another policy, noise and seed for each robot."""
    return {
        "robot1": compare.SquareDrive("bearing", "tutorial", "arrival", "burger", 3),
        "robot2": compare.SquareDrive("proportional", "rough", "arrival", "burger", 8),
    }


@pytest.fixture
def start():
    """Start graphs, and let none survive the test."""
    graphs = []

    def start_one(drive, namespace, **options):
        graph = Graph(**drive._asdict(), laps=drive.laps, goal_tolerance=0.0, namespace=namespace, **options)
        graphs.append(graph.start())
        return graph

    yield start_one
    for graph in graphs:
        graph.close()


def side_by_side(start, compare, drives, steps, **options):
    """Run a graph for each robot at the same time, and return their trajectories."""
    graphs = {name: start(drive, name, **options) for name, drive in drives.items()}
    for graph in graphs.values():
        graph.wait_until(lambda graph: graph.time >= (steps - 0.5) * compare.DT, timeout=max(120.0, 8.0 * steps * compare.DT))
    return {name: compare.first(graph.trajectory(), steps) for name, graph in graphs.items()}


def apart(compare, drives, driven, steps):
    """Return the largest difference of each robot's drive from the environment's episode of its own seed."""
    return {
        name: max(compare.differences(compare.episode(drive, steps), driven[name]).values()) for name, drive in drives.items()
    }


@pytest.mark.nightly
@pytest.mark.parametrize("processes", [False, True])
def test_each_of_two_robots_in_lock_step_drives_its_own_episode_to_the_bit(compare, drives, start, processes):
    driven = side_by_side(start, compare, drives, STEPS, processes=processes)
    assert apart(compare, drives, driven, STEPS) == {"robot1": 0.0, "robot2": 0.0}
    swapped = {"robot1": drives["robot2"], "robot2": drives["robot1"]}
    assert min(apart(compare, swapped, driven, STEPS).values()) > 0.01  # the comparison tells them apart


@pytest.mark.nightly
def test_frames_parameters_and_diagnostics_of_two_robots_are_told_apart(compare, drives, start, peer, wait_for):
    graphs = {name: start(drive, name) for name, drive in drives.items()}
    heard = {name: peer.hear(f"/{name}/estimate", Odometry) for name in ROBOTS}
    reports = peer.hear("/diagnostics", DiagnosticArray)
    for name in ROBOTS:
        message = wait_for(lambda name=name: heard[name])[-1]
        assert (message.header.frame_id, message.child_frame_id) == (f"{name}/odom", f"{name}/base_footprint")
        seed = GetParameters.Request(names=["seed"])
        response = peer.ask(f"/{name}/turtlebot_simulator/get_parameters", GetParameters, seed)
        assert response.values[0].integer_value == drives[name].seed
    nodes = ("kalman_filter", "turtlebot_simulator", "velocity_controller", "waypoint_generator")
    expected = {(f"/{name}/{node}", name) for name in ROBOTS for node in nodes}
    wait_for(lambda: {(status.name, status.hardware_id) for message in reports for status in message.status} >= expected)
    for graph in graphs.values():
        graph.wait_until(lambda graph: {*graph.reports} >= {*nodes})
        assert {*graph.reports} == {*nodes}  # its own, and not the other robot's


def test_an_odometry_of_another_robots_frame_is_refused(make_bench):
    bench = make_bench(frame_prefix="robot1/")
    for _ in range(3):
        bench.send(frame="robot2/odom")
    bench.report("its frame is 'robot2/odom' instead of 'robot1/odom' (the parameters frame_prefix and frame)")
    bench.wait_for(lambda: bench.send(frame="robot1/odom") or 0.1 in bench.speeds)
    assert bench.commands[-1].header.frame_id == "robot1/base_footprint"


@pytest.mark.nightly
def test_status_asks_one_robot(compare, drives, start, capsys):
    start(drives["robot1"], "robot1")
    status.main(["--namespace", "robot1", "--seconds", "30"])
    output = capsys.readouterr().out
    assert "not there" not in output
    status.main(["--namespace", "robot2", "--seconds", "0.5"])
    output = " ".join(capsys.readouterr().out.split())
    assert output.count("not there") == 4
    assert status.main(["--namespace", "robot 2"]) == 2
    assert "namespace must be names of letters, digits and _" in capsys.readouterr().err


@pytest.mark.nightly
def test_a_recorder_takes_its_own_robots_topics_and_those_that_all_share(
    launch, peer, wait_for, tmp_path, monkeypatch, read_bag
):
    monkeypatch.setenv("AMENT_PREFIX_PATH", sys.prefix)
    words = ("-r", "__ns:=/robot1")
    process = launch("-m", "turtlebot_gym_ros", "data_logger", "--ros-args", *words)
    own, shared, other = (peer.speak(topic, String) for topic in ("/robot1/note", "/all", "/robot2/note"))
    wait_for(lambda: own.get_subscription_count() and shared.get_subscription_count())
    for publisher in (own, shared, other):
        publisher.publish(String(data="a word"))
        assert publisher.wait_for_all_acked()
    process.send_signal(signal.SIGINT)
    process.communicate(timeout=30.0)
    (folder,) = (tmp_path / "bags" / "robot1").iterdir()
    held = read_bag(folder)
    assert {"/robot1/note", "/all"} <= held.keys()
    assert not any(topic.startswith("/robot2") for topic in held)


@pytest.mark.parametrize(
    ("given", "full", "prefix"),
    [("", "/", ""), ("/", "/", ""), ("robot1", "/robot1", "robot1/"), ("/lab/robot1/", "/lab/robot1", "lab/robot1/")],
)
def test_a_namespace_is_written_as_ros_writes_it(given, full, prefix):
    assert (absolute(given), prefix_of(given)) == (full, prefix)
    assert remapping(given) == ([] if full == "/" else ["--ros-args", "-r", f"__ns:={full}"])


@pytest.mark.parametrize("wrong", ["1robot", "robot 1", "a//b", "a__b", "robot-1", "~robot", "röbot"])
def test_a_namespace_that_ros_would_refuse_is_refused(wrong):
    with pytest.raises(ValueError, match="namespace must be names of letters"):
        Graph(namespace=wrong)


RANGE = "ROS_AUTOMATIC_DISCOVERY_RANGE"
TRANSPORTS = "FASTDDS_BUILTIN_TRANSPORTS"
SHARED = """
import time
import rclpy
rclpy.init()
node = rclpy.create_node("node")
time.sleep(0.5)
raise SystemExit("/dev/shm/fastrtps_" in open("/proc/self/maps").read())  # its own: killed processes leave files
"""


@pytest.fixture
def environment(monkeypatch):
    """An environment in which nothing is set; it is as it was afterwards."""
    bare = {name: value for name, value in os.environ.items() if "ROS_" not in name and "FAST" not in name}
    monkeypatch.setattr(os, "environ", bare)
    return bare


def test_it_stays_on_this_machine_unless_asked(environment):
    assert prepare()
    assert environment[RANGE] == "LOCALHOST"


@pytest.mark.parametrize("asked", [RANGE, "ROS_LOCALHOST_ONLY", "ROS_STATIC_PEERS", "ROS_DISCOVERY_SERVER"])
def test_what_was_asked_for_stays(environment, asked):
    environment[asked] = "SUBNET"
    assert not prepare()
    assert environment[asked] == "SUBNET"
    assert asked == RANGE or RANGE not in environment


def test_the_guard_serves_the_network(environment):
    assert not prepare(local=False)
    assert RANGE not in environment


def test_the_profile_announces_five_times_a_second(environment):
    prepare()
    assert environment[_profiles_variable()] == str(PROFILE)
    assert sum("DEFAULT_PROFILES_FILE" in name for name in environment) == 1  # Kilted complains of the old name
    root = ElementTree.parse(PROFILE).getroot()
    space = {"dds": root.tag.partition("}")[0].strip("{")}
    assert root.find(".//dds:initialAnnouncements/dds:period/dds:nanosec", space).text == "200000000"


def test_a_profile_of_ones_own_stays(environment):
    environment["FASTRTPS_DEFAULT_PROFILES_FILE"] = "mine.xml"
    prepare()
    assert "FASTDDS_DEFAULT_PROFILES_FILE" not in environment
    assert environment["FASTRTPS_DEFAULT_PROFILES_FILE"] == "mine.xml"


def test_no_memory_is_shared_unless_asked(environment):
    prepare()
    assert environment[TRANSPORTS] == "UDPv4"
    environment[TRANSPORTS] = "DEFAULT"
    prepare()
    assert environment[TRANSPORTS] == "DEFAULT"
    # Where discovery stays on this machine, rmw_fastrtps shares memory whatever one asks for.
    bare = {name: value for name, value in os.environ.items() if "FAST" not in name} | {RANGE: "SUBNET", "ROS_DOMAIN_ID": "77"}
    for transports, shares in (("UDPv4", False), ("DEFAULT", True)):
        done = subprocess.run([sys.executable, "-c", SHARED], env={**bare, TRANSPORTS: transports}, check=False)
        assert bool(done.returncode) == shares


def test_fast_dds_takes_the_profile():
    """It says nothing of a profile that it can read, and complains of one that it cannot: it reads this variable."""
    code = "import rclpy; rclpy.init(); rclpy.create_node('node').destroy_node(); rclpy.shutdown()"
    for profile, complains in ((str(PROFILE), False), (__file__, True)):
        bare = {name: value for name, value in os.environ.items() if "DEFAULT_PROFILES_FILE" not in name}
        environment = {**bare, _profiles_variable(): profile}
        done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, env=environment, check=False)
        assert ("Error" in done.stdout + done.stderr) == complains, done


TALK = """
import rclpy, sys
from std_msgs.msg import Empty
rclpy.init()
node = rclpy.create_node("remote")
publisher = node.create_publisher(Empty, "talk", 10)
node.create_timer(0.05, lambda: publisher.publish(Empty()))
rclpy.spin(node)
"""


def test_a_node_of_this_machine_that_serves_the_network_is_heard(launch, peer, wait_for):
    """The guard, or a robot's own driver, beside nodes that stay on this machine."""
    heard = peer.hear("talk", Empty)
    launch("-c", TALK, **{RANGE: "SUBNET"})
    wait_for(lambda: heard)


@pytest.mark.parametrize(
    "name",
    [pytest.param("waypoint_generator", marks=pytest.mark.nightly), pytest.param("cmd_vel_standby", marks=guarded)],
)
def test_who_leaves_is_gone_at_once_and_leaves_no_shared_memory(launch, peer, wait_for, name):
    """Far sooner than the 20 s after which DDS takes a silent process for dead."""
    process = launch("-m", "turtlebot_gym_ros", name)
    wait_for(lambda: name in peer.node.get_node_names())
    held = {os.path.realpath(link) for link in Path(f"/proc/{process.pid}/fd").iterdir()}
    (lock,) = [path for path in held if re.fullmatch(r"/dev/shm/fast(?:rtps|dds)_[0-9a-f]{16}_el", path)]
    assert Path(lock.removesuffix("_el")).stat().st_size > 100_000
    process.terminate()
    assert process.wait(30) == 0
    wait_for(lambda: name not in peer.node.get_node_names(), 10.0)
    assert not list(Path("/dev/shm").glob(f"{Path(lock).stem.removesuffix('_el')}*"))


LIBRARY_THREAD = """
import signal, threading, time
from cmd_vel_guard.session import listening
thread = threading.Thread(target=time.sleep, args=(60,), daemon=True)  # as those that linear algebra starts when it is imported
thread.start()
with listening() as wait_for_the_end:
    signal.pthread_kill(thread.ident, signal.SIGTERM)  # before anybody waits for it
    wait_for_the_end()
    signal.pthread_kill(thread.ident, signal.SIGINT)
    wait_for_the_end()
print("both noted", signal.getsignal(signal.SIGTERM) is signal.SIG_DFL)
"""


def test_an_ending_that_a_librarys_thread_takes_is_noted():
    run = subprocess.run([sys.executable, "-c", LIBRARY_THREAD], capture_output=True, text=True, timeout=60)
    assert (run.returncode, run.stdout) == (0, "both noted True\n")


def test_a_runner_beside_another_shares_its_context_and_leaves_it_open(runner):
    beside = Runner(beside=runner)
    beside.add(guest := Node("guest", context=beside.context))
    beside.start()
    assert guest.context is runner.context
    beside.close()
    assert runner.context.ok()


FROZEN = """
import gc, os, signal
from rclpy.node import Node
from cmd_vel_guard.process import run

def make(context):
    node = Node("node", context=context)
    node.create_timer(0.01, lambda: print(gc.get_freeze_count() > 10_000, flush=True) or os.kill(os.getpid(), signal.SIGTERM))
    return node

run([make], [])
"""


def test_what_a_process_has_when_its_node_begins_is_not_collected_again():
    done = subprocess.run([sys.executable, "-c", FROZEN], capture_output=True, text=True, timeout=60)
    assert (done.returncode, done.stdout.splitlines()[0]) == (0, "True")
