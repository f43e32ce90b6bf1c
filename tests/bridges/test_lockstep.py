"""The rules of lock-step, on stamps: a network that loses and delays changes no number."""

import numpy as np
import pytest

from turtlebot_gym.values import Pose
from turtlebot_gym_ros.node.block import Every, Input, On
from turtlebot_gym_ros.node.lockstep import Answers, Plant, Turn, trigger_of
from turtlebot_gym_ros.node.triggers import SECOND, Messages, StampGrid

S = 1_000_000_000
TENTH = 100_000_000


class Node:
    """A node of the loop as far as lock-step is concerned: it answers with its number of steps and what it was given."""

    def __init__(self, name, trigger, inputs, outputs):
        self.name, self.outputs = name, outputs
        self.rule = Answers(trigger, {key: Input(topic=key, type=Pose, lock_step=rule) for key, rule in inputs.items()})
        self.held = dict.fromkeys(inputs, (None, None))
        self.memory = ()
        self.steps = []
        self.answer = {}

    def hear(self, topic, stamp, value):
        """Return what it publishes: (topic, stamp, value)."""
        self.held[topic] = (stamp, value)
        turn, gap = self.rule.hear(topic, {key: held[0] for key, held in self.held.items()})
        if gap:
            self.memory = ()
        if turn is Turn.STEP:
            self.rule.answer(stamp)
            self.steps.append(stamp)
            self.memory = hash((self.name, self.memory, tuple(value for _, value in self.held.values())))
            self.answer = {topic: (stamp, (topic, self.memory)) for topic in self.outputs}
        elif turn is not Turn.REPEAT:
            return []
        return [(topic, *said) for topic, said in self.answer.items()]


def nodes():
    return {
        "filter": Node("filter", On("odom"), {"odom": "latest"}, ["estimate"]),
        "generator": Node("generator", On("estimate"), {"estimate": "latest"}, ["following", "reference"]),
        "controller": Node(
            "controller", On("estimate"), {"estimate": "latest", "reference": "same", "following": "same"}, ["command"]
        ),
    }


def drive(seed, steps, *, loss):
    """Drive the loop over a network that delivers in any order, loses, and lets nodes join late; return plant and nodes.

    What is lost of a repeated answer is repeated again: the plant sends its outputs as often as it takes.
    """
    rng, loop, state, states = np.random.default_rng(seed), nodes(), 0, []
    plant, now = Plant(0.1, now=0.0), 0.0
    joined = {name: int(rng.integers(0, 500)) if loss else 0 for name in loop}
    queues = {(topic, name): [] for name, node in loop.items() for topic in node.held} | {("command", "plant"): []}
    heard = None

    def publish(topic, stamp, value):
        for (heard_topic, name), queue in queues.items():
            if heard_topic == topic and joined.get(name, 0) <= 0 and rng.random() >= loss:
                queue.append((stamp, value))

    def step():
        nonlocal state
        state = hash((state, heard))
        states.append(state)
        publish("odom", plant.advance(now), ("odom", state))

    step()
    while len(states) < steps:
        now += 0.005
        joined = {name: wait - 1 for name, wait in joined.items()}
        waiting = [key for key, queue in queues.items() if queue]
        if plant.resend(now) or not waiting:
            publish("odom", plant.present, ("odom", state))
            continue
        topic, name = waiting[int(rng.integers(len(waiting)))]
        stamp, value = queues[topic, name].pop(0)
        if name != "plant":
            for said in loop[name].hear(topic, stamp, value):
                publish(*said)
        elif plant.answers([stamp]):
            heard = value
            step()
    return states, loop


def test_a_network_that_loses_delays_and_reorders_changes_no_number():
    perfect, _ = drive(0, 60, loss=0.0)
    for seed in range(50):
        states, loop = drive(seed, 60, loss=0.3)
        assert states == perfect, seed
        for node in loop.values():
            assert node.steps[:59] == [S + k * TENTH for k in range(59)], seed  # each step once, in order


def answers(trigger=None, **inputs):
    rules = {"estimate": "latest", **inputs}
    return Answers(trigger or On("estimate"), {key: Input(topic=key, type=Pose, lock_step=rule) for key, rule in rules.items()})


def test_a_step_waits_for_all_that_belongs_to_it_and_for_nothing_else():
    rule = answers(reference="same", goal="latest")
    stamps = {"estimate": 5 * S, "reference": None, "goal": None}
    assert rule.hear("estimate", stamps) == (Turn.WAIT, None)
    assert rule.hear("reference", stamps | {"reference": 4 * S}) == (Turn.WAIT, None)
    assert rule.hear("goal", stamps | {"goal": 5 * S}) == (Turn.WAIT, None)
    stamps["reference"] = 5 * S
    assert rule.hear("reference", stamps) == (Turn.STEP, None)
    assert rule.hear("estimate", stamps) == (Turn.STEP, None)  # it was not answered: the node was not enabled
    assert rule.hear("goal", stamps | {"goal": 6 * S}) == (Turn.WAIT, None)
    rule.answer(5 * S)
    assert rule.hear("estimate", stamps) == (Turn.REPEAT, None)
    assert rule.hear("reference", stamps) == (Turn.WAIT, None)  # one repetition is enough
    assert rule.hear("goal", stamps | {"goal": 9 * S}) == (Turn.WAIT, None)


def test_a_leap_of_the_stamps_is_a_new_episode_ahead_and_back():
    rule = answers()
    for stamp in (S, S + TENTH):
        assert rule.hear("estimate", {"estimate": stamp}) == (Turn.STEP, None)
        rule.answer(stamp)
    turn, gap = rule.hear("estimate", {"estimate": 61 * S})
    assert (turn, gap is not None) == (Turn.STEP, True)
    rule.answer(61 * S)
    turn, gap = rule.hear("estimate", {"estimate": S})  # the plant was started again
    assert (turn, gap is not None) == (Turn.STEP, True)


def test_the_stamps_of_a_robot_are_refused_where_they_would_count():
    rule = answers(goal="latest")
    rule.check("estimate", 61 * S)
    rule.check("goal", 1_700_000_000 * S)  # a goal is set by a person, in whatever time
    with pytest.raises(ValueError, match="wall clock"):
        rule.check("estimate", 1_700_000_000 * S)
    rule.check("estimate", 999_999_999_999_999_999)  # the last nanosecond before September 2001
    with pytest.raises(ValueError, match="wall clock"):
        rule.check("estimate", 1_000_000_000_000_000_000)


def test_the_plant_takes_each_step_once_and_only_when_all_inputs_answer_it():
    plant = Plant(0.1, now=7.0)
    assert not plant.has_begun
    assert plant.advance(7.0) == S
    assert not plant.answers([None])
    assert not plant.answers([S - TENTH])
    assert not plant.answers([S, S - TENTH])
    assert plant.answers([S])
    assert plant.advance(7.0) == S + TENTH
    assert not plant.answers([S])
    plant.begin_episode()
    assert plant.advance(7.0) == 61 * S + TENTH
    assert plant.advance(7.0) == 61 * S + 2 * TENTH  # one leap for an episode


def test_a_step_without_an_answer_is_resent_each_fifth_of_a_second_and_overdue_after_two():
    plant = Plant(0.1, now=7.0)
    plant.advance(8.0)
    assert [plant.resend(now) for now in (8.1875, 8.25, 8.375, 8.5)] == [False, True, False, True]
    assert [plant.is_overdue(now) for now in (10.0, 10.125)] == [False, True]
    plant.advance(10.25)
    assert (plant.resend(10.375), plant.is_overdue(12.25)) == (False, False)


def test_a_block_runs_as_the_plant_or_on_an_input_whose_messages_belong_to_steps():
    on = On("odometry")
    assert trigger_of(on, {}) is on
    assert trigger_of(Every(0.1, answers="estimate"), {}) == On("estimate")
    assert trigger_of(Every(0.1, plant=True), {}) is None
    for trigger, inputs in ((on, {"own": Input(topic="own", type=Pose, lock_step="refused")}), (Every(0.1), {})):
        with pytest.raises(ValueError, match="lock_step must be false"):
            trigger_of(trigger, inputs)


MS = SECOND // 1000


def steps(rule, stamps):
    """Return the stamps at which a rule lets a block run."""
    return [stamp for stamp in stamps if rule.due(stamp)[0]]


GRIDS = {
    "steps that are late are made up for": {0: [0], 350 * MS: [100 * MS, 200 * MS, 300 * MS]},
    "due from half a period before the stamp": {0: [0], 50 * MS: [], 50 * MS + 1: [100 * MS], 260 * MS: [200 * MS, 300 * MS]},
    # The next step is due 0.1 s later: a second ahead of that, or two periods back, is a leap; these are a nanosecond less.
    "less than a second ahead is no leap, nor are two periods back": (
        {10 * SECOND: [10 * SECOND], 9900 * MS + 1: [], 11100 * MS - 1: [10 * SECOND + k * 100 * MS for k in range(1, 12)]}
    ),
    **{
        f"a leap by {leap} ms makes one step": {at: [at] for at in (10 * SECOND, 10 * SECOND + leap * MS)}
        for leap in (5000, 1100, -100, -900, -5000)
    },
}


@pytest.mark.parametrize("due", GRIDS.values(), ids=GRIDS)
def test_a_grid_lets_a_block_run_at_these_stamps(due):
    grid = StampGrid(0.1)
    assert {now: list(grid.due_until(now)) for now in due} == due


def test_every_message_makes_a_step_whose_interval_is_exact_and_after_a_pause_0():
    rule = Messages(On("odometry"))
    stamps = [5, 5 + 100 * MS, 5 + 250 * MS]
    assert steps(rule, stamps) == stamps
    assert [rule.interval(stamp) for stamp in stamps] == [0.0, 0.1, 0.15]
    rule.pause()
    assert [rule.interval(5 + at * MS) for at in (350, 450)] == [0.0, 0.1]


@pytest.mark.parametrize("rate", [10, 20, 30, 50, 100])
@pytest.mark.parametrize("jitter", [0, 2])
def test_decimation_keeps_the_rate(rate, jitter):
    rule = Messages(On("odometry", period=0.1))
    noise = np.random.default_rng(rate).integers(-jitter * MS, jitter * MS + 1, 10 * rate)
    stamps = [SECOND + k * SECOND // rate + int(noise[k]) for k in range(10 * rate)]
    taken = np.array(steps(rule, stamps))
    assert len(taken) == 100
    assert np.abs(taken - SECOND - np.arange(100) * 100 * MS).max() <= SECOND // rate / 2 + jitter * MS


def test_what_comes_twice_or_late_is_refused():
    rule = Messages(On("odometry"))
    for stamp in (10_000_000_000, 10_100_000_000):
        rule.check(stamp)
        assert rule.due(stamp) == (True, None)
    for stamp, before in ((10_100_000_000, "0.000"), (10_050_000_000, "0.050"), (9_100_000_000, "1.000")):
        with pytest.raises(ValueError, match=f"its stamp is {before} s before the last one's, or the same"):
            rule.check(stamp)
    rule.check(10_100_000_001)
    rule.check(9_099_999_999)  # more than a second back: the clock was set


@pytest.mark.parametrize(("gap", "said"), [(1_500_000_000, "1.50"), (-1_500_000_000, "-1.50")])
def test_after_a_gap_in_time_it_starts_again(gap, said):
    rule = Messages(On("odometry", period=0.1, max_gap=1.0))
    start = 10 * SECOND
    for k in range(3):
        assert rule.due(start + k * 100 * MS)[0]
        rule.interval(start + k * 100 * MS)
    stamp = start + 200 * MS + gap
    rule.check(stamp)
    due, why = rule.due(stamp)
    assert due
    assert why == f"{said} s between two messages"
    assert rule.interval(stamp) == 0.0
