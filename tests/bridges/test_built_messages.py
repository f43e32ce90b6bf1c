"""The messages that PyPI lacks, as the script in ``tools/`` builds them."""

import pytest

FIELDS = """
from nav2_msgs.action import NavigateToPose
from tf2_msgs.msg import TFMessage
for kind in (NavigateToPose.Goal, NavigateToPose.Result, NavigateToPose.Feedback, TFMessage):
    print(*(f"{kind} {name}" for name, kind in kind.get_fields_and_field_types().items()), sep="\\n")
"""
NAMED = {"sequence<geometry_msgs/TransformStamped>": "geometry_msgs/TransformStamped[]", "float": "float32"}


@pytest.mark.nightly
def test_the_built_types_have_the_fields_of_the_definition(launch, interfaces, builder):
    out, err = launch("-c", FIELDS, **interfaces).communicate(timeout=60.0)
    wanted = [line for _, text in builder.FILES.values() for line in text.splitlines() if line != "---"]
    fields = [line.partition(" ") for line in out.splitlines()]
    assert [f"{NAMED.get(kind, kind)} {name}" for kind, _, name in fields] == wanted, err


def test_beside_a_ros_installation_it_names_the_packages(builder, monkeypatch, tmp_path):
    monkeypatch.setattr(builder, "distributions", list)
    with pytest.raises(ValueError, match="sudo apt install ros-DISTRO-nav2-msgs"):
        builder.build(tmp_path)
