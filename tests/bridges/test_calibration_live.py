"""The calibration drive on live nodes: it moves nothing before it is enabled, and speaks to the guard."""

import time

import pytest
from bench import node
from geometry_msgs.msg import TwistStamped
from std_msgs.msg import Bool, String
from std_srvs.srv import SetBool

from cmd_vel_guard.qos import LATCHED


@pytest.mark.nightly
def test_it_drives_through_the_guard_once_enabled_and_an_emergency_stop_ends_it(launch, peer, wait_for):
    launch(*node("turtlebot_simulator"))
    launch(*node("cmd_vel_guard", "robot:=burger", "collision_monitor:=false"))
    launch(*node("calibration_drive", "radius:=1.0", words=("-r", "cmd_vel:=cmd_vel_in")))
    wheels, wishes = peer.hear("cmd_vel", TwistStamped), peer.hear("cmd_vel_in", TwistStamped)
    states = peer.hear("calibration_drive/state", String, LATCHED)
    button, pressed = peer.speak("emergency_stop", Bool, 1), [False]
    peer.node.create_timer(0.05, lambda: button.publish(Bool(data=pressed[0])))
    wait_for(lambda: states and wheels and button.get_subscription_count() >= 4)
    assert states[-1].data.startswith("silent: not enabled")
    assert not wishes
    assert {velocity.twist.linear.x for velocity in wheels} == {0.0}
    wait_for(lambda: peer.ask("calibration_drive/enable", SetBool, SetBool.Request(data=True)).success)

    def drives():
        for name in ("cmd_vel_guard", "calibration_drive"):  # again, where a busy machine kept the button silent for too long
            peer.ask(f"{name}/enable", SetBool, SetBool.Request(data=True))
        time.sleep(0.5)  # an enabled guard has forgotten what was said before
        return any(velocity.twist.linear.x > 0.1 for velocity in list(wheels))

    wait_for(drives)
    wait_for(
        lambda: [publisher.node_name for publisher in peer.node.get_publishers_info_by_topic("cmd_vel")] == ["cmd_vel_guard"]
    )
    pressed[0] = True
    wait_for(lambda: states[-1].data == "silent: emergency stop")
    wheels.clear()
    wait_for(lambda: len(wheels) > 3)
    assert {velocity.twist.linear.x for velocity in list(wheels)} == {0.0}
