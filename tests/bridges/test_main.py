"""Nodes as processes: what they refuse, how they end, and that the last thing they say is zero."""

import pytest

from turtlebot_gym_ros.__main__ import main


@pytest.mark.parametrize(
    ("argv", "said"),
    [
        (["flight_controller"], "there is no node 'flight_controller'"),
        (["velocity_controller", "--ros-args", "-p", "polcy:=bearing"], "did you mean policy?"),
        (["turtlebot_simulator", "--ros-args", "-p", "speed:=0"], "speed must be 1"),
        (["simulated_teleop", "--ros-args", "-p", "lock_step:=true"], "lock_step must be false"),
        (["kalman_filter", "--ros-args", "-p", "lock_step:=true", "-p", "twist:=commanded"], "lock_step must be false"),
        (["kalman_filter", "filter:=matched"], "unknown argument 'filter:=matched'"),
        (["bringup", "--policy", "nope.onnx"], "No such file or directory: 'nope.onnx'"),
        (["bringup", "--seed", "-1"], "--seed must be a whole number from 0 to"),
        (["bringup", "--figure", "drive.jpg"], "drive.jpg: its name must end with .png or .pdf or .svg"),
    ],
)
def test_what_is_wrong_is_one_clear_line_and_exit_code_2(capsys, argv, said):
    assert main(argv) == 2
    captured = capsys.readouterr()
    (line,) = captured.err.splitlines()
    assert line.startswith("error: ")
    assert said in line
    assert not captured.out
