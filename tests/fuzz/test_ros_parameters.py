"""Whatever parameters a node is given, it is made, or refuses them with one line before it publishes anything."""

import atexit
from dataclasses import fields

import pytest
from fuzzing import FOLDER, answered, fuzzed
from hypothesis import strategies as st

try:
    import warnings

    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # rclpy's parser warns of a module of Python's own
        import rosidl_generator_py  # noqa: F401
        from rclpy.context import Context
        from rclpy.node import Node
        from rclpy.parameter import Parameter
except ImportError:
    pytest.skip("needs the extra [ros]", allow_module_level=True)

from turtlebot_gym_ros.base.discovery import prepare
from turtlebot_gym_ros.base.frames import Common
from turtlebot_gym_ros.base.parameters import declare
from turtlebot_gym_ros.nodes import BLOCKS, load
from turtlebot_gym_ros.recording.logger import Parameters as LoggerParameters

prepare()
(FOLDER / "waypoints.yaml").write_text("- [1.0, 0.0, 0.0]\n- {x: 1, y: [2]}\n")
WHOLE = st.one_of(st.integers(-(2**63), 2**63 - 1), st.sampled_from([0, 1, -1, 3, 1000]))
REAL = st.one_of(st.floats(), st.sampled_from([0.0, 0.1, 1.0, -1.0, 1e-9, 1e9, 1e308]))
TEXT = st.one_of(
    st.text(st.characters(codec="utf-8", exclude_characters="\0"), max_size=12),
    st.sampled_from(
        [
            "",
            "burger",
            "wheel",
            "matched",
            "bearing",
            "dense",
            "square",
            "time",
            "room",
            "base_link",
            "/a/b",
            "nope.onnx",
            "nope.yaml",
            "a:b",
            str(FOLDER / "waypoints.yaml"),
            str(FOLDER),
        ]
    ),
)
GIVEN = st.one_of(
    WHOLE,
    REAL,
    TEXT,
    st.booleans(),
    st.lists(REAL, min_size=1, max_size=3),
    st.lists(WHOLE, min_size=1, max_size=3),
    st.lists(TEXT, min_size=1, max_size=3),
    st.lists(st.booleans(), min_size=1, max_size=3),
    st.lists(st.integers(0, 255), min_size=1, max_size=3).map(lambda numbers: [bytes([byte]) for byte in numbers]),
)
OF_TYPE = {float: REAL, int: WHOLE, bool: st.booleans(), str: TEXT}


CLASSES = {name: load(name) for name in BLOCKS}


def some_parameters(draw, classes):
    """Return one or two parameters: mostly with values of their types."""
    known = {item.name: type(item.default) for declaration in classes for item in fields(declaration)}
    given = {}
    for _ in range(draw(st.integers(1, 2))):
        name = draw(st.sampled_from([*sorted(known), "rat", "policy.x"]))
        usual = OF_TYPE.get(known.get(name, str), TEXT)
        given[name] = draw(usual if draw(st.integers(0, 3)) else GIVEN)
    return given


CONTEXT = Context()
CONTEXT.init([])
atexit.register(CONTEXT.try_shutdown)


def node_with(given):
    return Node(
        "fuzzed",
        context=CONTEXT,
        parameter_overrides=[Parameter(name, value=value) for name, value in given.items()],
        automatically_declare_parameters_from_overrides=True,
        enable_rosout=False,
        start_parameter_services=False,
    )


KINDS = {
    **{name: ((Common, block.Params), lambda params, block=block: block(params)) for name, block in CLASSES.items()},
    "logger": ((LoggerParameters,), lambda params: params),
}
"""Of each block and node: the classes of its parameters, and what makes it of the last one."""


@pytest.mark.nightly
@fuzzed(120, 1700, name=st.sampled_from(sorted(KINDS)), data=st.data())
def test_parameters(name, data):
    classes, make = KINDS[name]
    node = node_with(some_parameters(data.draw, classes))
    try:
        answered("ROS parameters", lambda: make(declare(node, *classes)[-1]))
    finally:
        node.destroy_node()
