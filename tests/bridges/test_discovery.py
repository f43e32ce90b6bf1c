"""How nodes find each other, on this machine unless asked, and quickly; and how they leave."""

import os
import re
import subprocess
import sys
from pathlib import Path
from xml.etree import ElementTree

import pytest
from std_msgs.msg import Empty

from turtlebot_gym_ros.base.discovery import PROFILE, _profiles_variable, prepare

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


@pytest.mark.parametrize("name", [pytest.param("waypoint_generator", marks=pytest.mark.nightly), "cmd_vel_guard"])
def test_who_leaves_is_gone_at_once_and_leaves_no_shared_memory(launch, peer, wait_for, name):
    """Far sooner than the 20 s after which DDS takes a silent process for dead."""
    process = launch("-m", "turtlebot_gym_ros", name)
    wait_for(lambda: name in peer.node.get_node_names())
    held = {os.path.realpath(link) for link in Path(f"/proc/{process.pid}/fd").iterdir()}
    (lock,) = [each for each in held if re.fullmatch(r"/dev/shm/fast(?:rtps|dds)_[0-9a-f]{16}_el", each)]
    assert Path(lock.removesuffix("_el")).stat().st_size > 100_000
    process.terminate()
    assert process.wait(30) == 0
    wait_for(lambda: name not in peer.node.get_node_names(), 10.0)
    assert not list(Path("/dev/shm").glob(f"{Path(lock).stem.removesuffix('_el')}*"))


LIBRARY_THREAD = """
import signal, threading, time
from turtlebot_gym_ros.base.process import _endings_wait
thread = threading.Thread(target=time.sleep, args=(60,), daemon=True)  # as those that linear algebra starts when it is imported
thread.start()
with _endings_wait() as wait_for_the_end:
    signal.pthread_kill(thread.ident, signal.SIGTERM)  # before anybody waits for it
    wait_for_the_end()
    signal.pthread_kill(thread.ident, signal.SIGINT)
    wait_for_the_end()
print("both noted", signal.getsignal(signal.SIGTERM) is signal.SIG_DFL)
"""


def test_an_ending_that_a_librarys_thread_takes_is_noted():
    run = subprocess.run([sys.executable, "-c", LIBRARY_THREAD], capture_output=True, text=True, timeout=60)
    assert (run.returncode, run.stdout) == (0, "both noted True\n")
