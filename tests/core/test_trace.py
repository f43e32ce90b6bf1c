"""The traced step: graphs compute what their kernels do, and parameters may change; that all systems are plain Python's to the
bit, whatever is folded, is the law of `test_equality`.
"""

import math
from dataclasses import replace

import numpy as np
import pytest
from graphs import computed

from turtlebot_gym import RewardTerm
from turtlebot_gym.compiled import graph, ground, regions, running
from turtlebot_gym.compiled.batch import Batch
from turtlebot_gym.compiled.graph import Graph, Node, Untraceable, live, load
from turtlebot_gym.compiled.packing import as_tuple, flatten, layout_of
from turtlebot_gym.compiled.trace import traced
from turtlebot_gym.heart import Episode
from turtlebot_gym.kernel import algebra, first_accepted, kernel
from turtlebot_gym.presets import NOISES
from turtlebot_gym.systems import Options, make_parameters, system_of
from turtlebot_gym.tasks import SQUARE
from turtlebot_gym.values import Pose

# Small kernels: their graphs, computed in Python, have the results of the kernels themselves.


@kernel
def returns_early(x, y):
    """Branch with returns, of which one lies in a loop."""
    if x > 1.0 and not y > 1.0:
        return x, 1.0
    for k in range(3):
        if y < k:
            return y, float(k)
    return 0.0, -1.0


@kernel
def assigns(x, y):
    a, b = x, 2.0
    if x < y:
        a = y
        if y > 1.0:
            b += a
        elif x > -1.0:
            c = 7.0
            b = c * x
    else:
        b = -b
    return a, b if -1.0 < x <= y < 2.0 else 3.0


@kernel
def bounded(x, y):
    return min(x, y, 0.5), max(x, -y), abs(x), float(math.floor(x)), float(int(y)), x**2, math.exp(x), math.floor(x) % 3 * 1.0


@kernel
def searched(x, y):
    return *first_accepted(5, lambda k: (x + k, x + k > y)), (x or y), float(x > 0.0 or y > 0.0)


one_line = kernel(lambda x, y: (x if x > y else y, kernel(lambda z: z * 2.0)(x)))
KERNELS = (returns_early, assigns, bounded, searched, one_line)


@pytest.mark.parametrize("function", KERNELS, ids=lambda function: function.__name__)
def test_a_graph_computes_what_its_kernel_computes(function):
    Graph.now = Graph()
    values = traced(function)(load("x"), load("y"))
    numbers = (-2.5, -1.0, -0.0, 0.0, 0.3, 1.0, 1.7, 4.0)
    for x in numbers:
        for y in numbers:
            assert computed(values, x=x, y=y) == [*function(x, y)], (x, y)


def test_a_product_with_zero_is_left_out_only_where_the_sign_of_zero_is_irrelevant():
    Graph.now = Graph()
    x = load("x")
    assert isinstance(traced(kernel(lambda x: x * 0.0))(x), Node)
    assert traced(algebra(lambda x: x * 0.0))(x) == 0.0
    assert traced(kernel(lambda x: x * 1.0 - 0.0))(x) is x


def test_what_no_graph_can_hold_is_said():
    Graph.now = Graph()
    with pytest.raises(Untraceable, match="an index or a range that is not known"):
        traced(kernel(lambda x: (1.0, 2.0)[x]))(load("x", "i"))
    with pytest.raises(Untraceable, match="more than 200 ways"):
        traced(count_down)(load("x"))


@kernel
def count_down(x):
    while x > 0.0:
        x = x - 1.0
    return x


# The law of `test_equality` can fail.

COURSE = [(0.3, 0.0, 0.0), (0.4, 0.1, 1.0), (0.0, 0.3, -2.0)]


def test_the_law_of_test_equality_notices_a_single_wrong_operation(in_step, monkeypatch, tmp_path):
    monkeypatch.setenv("TURTLEBOT_GYM_CACHE_DIR", str(tmp_path))
    ground.ground_of.cache_clear()
    step = ground.heart.step
    monkeypatch.setattr(ground, "make_graphs", _with_one_sum_for_a_difference(ground.make_graphs))
    p = make_parameters(noise="documented")
    batch = Batch(9, p, (Pose(0.0, 0.0, 0.0),))
    with pytest.raises(AssertionError):
        list(in_step(batch, {0: Episode(p, seed=0)}))
    ground.ground_of.cache_clear()
    assert ground.heart.step is step


def _with_one_sum_for_a_difference(make):
    def mutated(system, case):
        step, reset, classes = make(system, case)
        node = next(node for node in live([step["outcome.reward"]]) if node.op == "sub")
        node.op = "add"
        return step, reset, classes

    return mutated


# Parameters: what differs is loaded, and episodes go on when parameters change.

WORN = replace(NOISES["rough"], process=replace(NOISES["rough"].process, scale=0.97, turn_scale=1.1, veer=0.02))
ROWS = 11
DRAWN = [make_parameters(noise=("rough", WORN, "tutorial", "documented")[i % 4], delay=i % 4) for i in range(ROWS)]
LATER = {
    "others": [make_parameters(noise="rough", delay=3)] * ROWS,
    "one for each": DRAWN,
    "another robot": [make_parameters(noise="documented", robot="waffle")] * ROWS,
}


def assert_rows_equal(batch, plain, actions):
    for action in actions:
        observations, outcomes = batch.step(action)
        for row, episode in plain.items():
            assert outcomes[:, row].tolist() == [*flatten(episode.act(action[row].tolist()))]
            np.testing.assert_array_equal(observations[row], np.array(episode.observe(), np.float32))
            assert batch.world(row) == episode.world


@pytest.mark.parametrize("later", LATER)
def test_parameters_may_change_in_the_middle_of_an_episode(later):
    actions = np.random.default_rng(0).uniform(-1.3, 1.3, (90, ROWS, 2)).astype(np.float32)
    p = make_parameters()
    batch = Batch(ROWS, p, (Pose(0.0, 0.0, 0.0),), shares=True)
    batch.seeds[:] = np.arange(ROWS)
    batch.reset(np.ones(ROWS, np.bool_), *batch.empty())
    plain = {row: Episode(p, seed=row) for row in range(ROWS)}
    assert_rows_equal(batch, plain, actions[:30])
    for parameters in (LATER[later], [p] * ROWS):  # slip that has begun goes on
        batch.set_parameters(parameters)
        for row, episode in plain.items():
            episode.parameters = parameters[row]
        assert_rows_equal(batch, plain, actions[30:60])


def test_drawn_parameters_on_a_course(in_step):
    course = tuple(Pose(*pose) for pose in COURSE)
    parameters = [p._replace(task=SQUARE) for p in DRAWN]
    batch = Batch(ROWS, parameters, course, shares=True)
    assert batch._case.own
    plain = {row: Episode(parameters[row], course, seed=row) for row in range(ROWS)}
    for _ in in_step(batch, plain, [0.2, -0.6], [1.0, 0.6], 150):
        pass


def classes_of(**options):
    p = make_parameters(**options)
    names = layout_of(system_of(p)).parameters.names
    case = ground.Case(tuple(zip(names, flatten(as_tuple(p)), strict=True)), (), 1)
    return ground.make_graphs(system_of(p), case)[2]


def test_numbers_that_never_change_or_always_equal_another_are_found():
    quiet, rough = classes_of(), classes_of(noise="rough")
    assert quiet["world.body.slipping"] is False
    assert rough["world.body.slipping"] == "world.body.slipping"
    for classes in (quiet, rough):
        assert classes["world.body.wheels.x"] == "world.body.true_state.x"
        assert classes["world.course.following.theta"] == "world.course.reference.theta"
    assert quiet["world.body.command.v"] == "world.body.true_state.v"
    assert rough["world.body.command.v"] == "world.body.command.v"


def test_episodes_go_on_only_where_what_is_taken_for_granted_holds():
    before = {"a": 1.0, "b": "b", "c": "b", "d": "d"}
    for after, is_allowed in (({"a": "a", "b": "b", "c": "b"}, True), ({"b": "b", "d": "b"}, False), ({"a": 2.0}, False)):
        assert running._allows(before, after) is is_allowed


@kernel
def index_of(before, after, judgement, p):
    return (0.0, 1.0)[int(after.steps) % 2]


def test_a_kernel_that_cannot_be_traced_is_named_and_runs_as_plain_python(in_step):
    setup = Options(reward={RewardTerm("index", index_of, 1.0): 1.0}).setup()
    with pytest.warns(RuntimeWarning, match="run as plain Python, since .*an index or a range that is not known"):
        batch = Batch(3, setup.parameters, setup.waypoints, system=setup.system, shares=True)
    plain = {row: Episode(setup.parameters, setup.waypoints, seed=row, system=setup.system) for row in range(3)}
    for _ in in_step(batch, plain, steps=20):
        pass


def test_a_function_of_the_c_library_is_called_in_each_lane(in_step):
    setup = Options(reward={RewardTerm("swing", swing, 1.0): 1.0}).setup()
    batch = Batch(9, setup.parameters, setup.waypoints, system=setup.system, shares=True)
    plain = {row: Episode(setup.parameters, setup.waypoints, seed=row, system=setup.system) for row in range(9)}
    for _ in in_step(batch, plain, steps=30):
        pass


@kernel
def swing(before, after, judgement, p):
    if judgement.distance > 1.0:
        return math.sin(after.steps)
    return math.atan2(after.body.true_state.y, after.body.true_state.x)


def test_a_block_of_its_own_needs_some_operations():
    Graph.now = Graph()
    x = load("x")
    few, many = x + 1.0, x
    for k in range(regions.FEWEST + 3):
        many = many * 1.25 + float(k)
    values = [graph.make("if", x > 0.0, few, x, 1), graph.make("if", x > 0.0, many, x, 2)]
    homes = regions.homes_of(live(values), values)
    assert [homes[node.id].depth for node in (few, many)] == [0, 1]
