"""Messages that PyPI lacks, as they are built."""

import sys

import pytest

from turtlebot_gym_ros import interfaces


def test_beside_a_ros_installation_it_names_the_packages(monkeypatch, capsys):
    monkeypatch.setattr(interfaces, "DISTRIBUTIONS", ())
    monkeypatch.setenv("ROS_DISTRO", "jazzy")
    monkeypatch.setattr(interfaces, "find_spec", lambda name: None)
    assert interfaces.main([]) == 2
    assert capsys.readouterr().err.endswith("sudo apt install ros-jazzy-nav2-msgs ros-jazzy-tf2-msgs.\n")


def test_without_its_tools_it_says_what_to_install(monkeypatch, tmp_path):
    monkeypatch.setenv("PATH", str(tmp_path))
    with pytest.raises(ValueError, match=r"^cmake, make, g\+\+ missing: sudo apt install cmake g\+\+ make python3-dev$"):
        interfaces.build()


def test_where_the_messages_are_there_is_nothing_to_do(monkeypatch, capsys):
    monkeypatch.setattr(interfaces, "find_spec", lambda name: name)
    assert interfaces.main([]) == 0
    assert capsys.readouterr().out == "nav2_msgs and tf2_msgs are installed.\n"


def test_a_step_that_fails_shows_its_last_lines():
    with pytest.raises(ValueError, match=r"failed: .*no such step"):
        interfaces._run(sys.executable, "-c", "raise SystemExit('no such step')")


FIELDS = """
from nav2_msgs.action import NavigateToPose
from tf2_msgs.msg import TFMessage
for kind in (TFMessage, NavigateToPose.Goal, NavigateToPose.Result, NavigateToPose.Feedback):
    print(*(f"{kind} {name}" for name, kind in kind.get_fields_and_field_types().items()), sep="\\n")
"""


@pytest.mark.nightly
def test_the_built_types_have_the_fields_of_the_definition(launch, interfaces):
    from turtlebot_gym_ros.interfaces import definitions, installed_distribution

    out, err = launch("-c", FIELDS, **interfaces).communicate(timeout=60.0)
    texts = (text for _, text in definitions(installed_distribution()).values())
    wanted = [line for text in texts for line in text.splitlines() if line != "---"]
    said = [
        line.replace("sequence<geometry_msgs/TransformStamped>", "geometry_msgs/TransformStamped[]") for line in out.split("\n")
    ]
    assert [line.replace("float ", "float32 ") for line in said if line] == wanted, err
