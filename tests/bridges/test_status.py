"""The state of the graph as a table."""

import pytest

from turtlebot_gym_ros import Graph
from turtlebot_gym_ros.graph.status import _expected, _table
from turtlebot_gym_ros.nodes import MODES

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


def test_a_localizer_takes_the_place_of_the_filter():
    assert _expected("autonomous", {}) == MODES["autonomous"]
    assert {*_expected("autonomous", {"localizer": (0, "runs")})} ^ {*MODES["autonomous"]} == {"localizer", "kalman_filter"}


@pytest.mark.sample(1)
@pytest.mark.parametrize("stamped", [True, False], ids=["TwistStamped", "Twist"])
def test_no_node_reports_a_fault_because_somebody_looks(launch, stamped):
    texts = set()
    with Graph(noise="clean", speed=1.0, enable_stamped_cmd_vel=stamped) as graph:
        process = launch("-m", "turtlebot_gym_ros", "status", "--seconds", "8")
        graph.wait_until(lambda graph: texts.update(graph.reports.values()) or process.poll() is not None)
        out, _ = process.communicate()
        end = graph.time + 1.5  # each node reports once more
        graph.wait_until(lambda graph: texts.update(graph.reports.values()) or graph.time > end)
    assert [line.split()[0] for line in out.splitlines()[1:5]] == [*MODES["autonomous"]]
    assert "not there" not in out
    assert not [text for _, text in texts if "status" in text or "cmd_vel" in text]
