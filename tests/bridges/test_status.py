"""The state of the graph as a table."""

from turtlebot_gym_ros.graph.status import _table

LONG = "waits for /reference, for /estimate since 12.5 s, and for a listener on /cmd_vel: no step was answered since 3.25 s"
REPORTS = {"velocity_controller": (1, LONG), "kalman_filter": (0, "ok"), "turtlebot_simulator": (3, "")}


def test_a_pipe_has_a_line_for_each_node():
    lines = _table(REPORTS, width=None)
    assert lines == [
        "node                 level    says",
        f"velocity_controller  warning  {LONG}",
        "kalman_filter        ok       ok",
        "turtlebot_simulator  stale",
    ]


def test_a_narrow_terminal_wraps_between_words():
    lines = _table(REPORTS, width=80)
    assert max(map(len, lines)) <= 80
    assert len(lines) > 4
    assert " ".join(" ".join(lines[1:-2]).split()) == f"velocity_controller warning {LONG}"
    assert all(line.startswith(30 * " ") for line in lines[2:-2])
