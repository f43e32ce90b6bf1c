"""Special cases of parameters: their loop leaves out what is idle, and gives the bits of the loop for all cases."""

from dataclasses import replace

import numpy as np
import pytest

from turtlebot_gym import FixNoise
from turtlebot_gym.compiled import batch as batch_module
from turtlebot_gym.compiled.batch import Batch
from turtlebot_gym.compiled.packing import TILE, as_tuple, flatten, layout_of
from turtlebot_gym.presets import NOISES
from turtlebot_gym.robots import ROBOTS, Robot
from turtlebot_gym.systems import make_parameters, system_of
from turtlebot_gym.systems.special import GENERAL, QUIET, SLIPPING, SPECIALS, special_of, with_late_fixes
from turtlebot_gym.tasks import NAV, POSE, SQUARE
from turtlebot_gym.values import Pose

N = TILE + 5
GOAL = (Pose(0.0, 0.0, 0.0),)
COURSE = (*GOAL, Pose(0.4, 0.1, 1.0), Pose(0.0, 0.3, -2.0))
HEAVY = Robot(
    max_linear=0.3, max_angular=1.9, max_wheel=0.306, max_linear_acceleration=0.9, max_angular_acceleration=7.0, reverse=False
)
WORN = replace(NOISES["rough"], process=replace(NOISES["rough"].process, scale=0.97, turn_scale=1.1, veer=0.02))
DRAWN = [make_parameters(noise=("rough", WORN, "tutorial", "documented")[i % 4], delay=i % 4) for i in range(N)]
CASES = {
    "default": (make_parameters(), GOAL),
    "clean": (make_parameters(noise="clean", robot="waffle"), GOAL),
    "documented": (make_parameters(POSE, noise="documented", robot=HEAVY, dt=0.05), GOAL),
    "course": (make_parameters(SQUARE, noise="documented"), COURSE),
    "worn": (make_parameters(noise=WORN, delay=2), GOAL),
    "worn on a course": (make_parameters(SQUARE, noise=WORN), COURSE),
    "drawn": (DRAWN, GOAL),
    "drawn on a course": ([p._replace(task=SQUARE) for p in DRAWN], COURSE),
    "slip, quiet": (make_parameters(noise="documented", filter="slip"), GOAL),
    "slip on a course": (make_parameters(SQUARE, noise="rough", filter="slip", delay=1), COURSE),
    "slip, drawn": ([make_parameters(noise=("rough", "tutorial")[i % 2], filter="slip", delay=i % 4) for i in range(N)], GOAL),
}
"""Parameters and waypoints, in the order of `CHOSEN`."""
CHOSEN = (QUIET, QUIET, *SPECIALS, SLIPPING[0], SLIPPING[3], SLIPPING[4])


def begun(parameters, number=N, waypoints=GOAL):
    batch = Batch(number, parameters, waypoints)
    batch.seeds[:] = np.arange(number)
    batch.reset(np.ones(number, np.bool_), *batch.empty())
    return batch


def acting(steps, number=N):
    """Return actions, some of them zeros of either sign, beyond the limits, or backwards."""
    actions = np.random.default_rng(0).uniform(-1.3, 1.3, (steps, number, 2)).astype(np.float32)
    actions[:, ::5], actions[:, 1::7, 0] = 0.0, -0.0
    actions[steps // 2 :, ::3, 1] = -0.0
    return actions


def bits(batch):
    """Return all that a batch remembers."""
    return batch.numbers("").tobytes()


def step_both(one, other, actions, *, reset_every=25):
    """Step two batches and reset some environments now and then; all that they tell must be the same to the bit."""
    for at, action in enumerate(actions):
        for mine, theirs in zip(one.step(action), other.step(action), strict=True):
            assert mine.tobytes() == theirs.tobytes(), at
        assert bits(one) == bits(other), at
        if at % reset_every == reset_every - 1:
            mask = np.arange(len(action)) % 3 == at % 2
            for batch in (one, other):
                batch.episodes[mask] += 1
                batch.reset(mask, *batch.empty())
            assert bits(one) == bits(other), at


def in_general(parameters, waypoints=GOAL):
    """Return a batch that has begun with the general loop."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(batch_module, "special_of", lambda *arguments: GENERAL)
        return begun(parameters, waypoints=waypoints)


LATE = FixNoise(R=(0.02, 0.01, 0.03), cross=(0.008, 0.01, 0.002), period=0.4, delay=0.3, dropout_probability=0.3)


@pytest.mark.parametrize(
    ("case", "changed"), [(0, {}), (2, {"noise": "rough", "delay": 1}), (0, {"fix": "motion-capture"}), (0, {"fix": "late"})]
)
def test_fixes_that_are_late_are_inserted_in_a_pass_of_their_own(case, changed):
    p = make_parameters(**({"noise": "documented", "fix": LATE} | changed))
    special, general, late = begun(p), in_general(p), round(p.fix.delay / p.dt)
    assert special._special == (with_late_fixes(SPECIALS[case], late) if late else GENERAL)
    step_both(special, general, acting(120))
    assert np.unique(special.numbers("senses.fix.pose")).size > N  # some arrived
    for batch in (special, general):
        batch.set_parameters(p._replace(dt=1.1 * p.dt))
    assert special._special == GENERAL  # fixes no longer belong to the oldest estimate
    step_both(special, general, acting(20))


@pytest.mark.parametrize(("case", "name"), [*zip(CHOSEN, CASES, strict=True)])
def test_a_special_loop_gives_the_bits_of_the_general_one(case, name):
    parameters, waypoints = CASES[name]
    special, general = begun(parameters, waypoints=waypoints), in_general(parameters, waypoints)
    assert (special._special, general._special) == (case, GENERAL)
    step_both(special, general, acting(120))


def test_the_law_notices_a_loop_that_leaves_out_what_is_not_idle(monkeypatch):
    rough = make_parameters(noise=replace(NOISES["tutorial"], process=NOISES["rough"].process))
    general = in_general(rough)
    monkeypatch.setattr(batch_module, "special_of", lambda *arguments: QUIET)
    with pytest.raises(AssertionError):
        step_both(begun(rough), general, acting(120))


def choice(parameters, *, system=None, waypoints=1, **changes):
    of_parameters = system or system_of(parameters)
    numbers = dict(zip(layout_of(of_parameters, GENERAL).parameters.names, flatten(as_tuple(parameters)), strict=True))
    return special_of(of_parameters, {path: np.array([value]) for path, value in (numbers | changes).items()}, waypoints)


@pytest.mark.parametrize("path", [path for path, _ in QUIET.parameters])
def test_a_case_is_left_as_soon_as_one_of_its_parameters_differs(path):
    p = make_parameters()
    usual = dict(zip(layout_of(system_of(p), GENERAL).parameters.names, flatten(as_tuple(p)), strict=True))[path]
    assert choice(p) is QUIET
    other = choice(p, **{path: usual + 1.0 if usual < 9.0 else 5.0})
    assert other is (GENERAL if path in dict(SPECIALS[3].parameters) else SPECIALS[2])


def test_who_brings_a_kernel_a_filter_or_a_system_of_his_own_gets_the_general_loop():
    p = make_parameters()
    assert choice(p, waypoints=4) is SPECIALS[1]
    assert choice(p, system=system_of(p)._replace(move=lambda body, command, key, at, p: body)) is GENERAL
    assert all(choice(make_parameters(**given)) is GENERAL for given in ({"filter": "gated"}, {"observation": "truth"}))
    assert all(choice(make_parameters(robot=robot)) is QUIET for robot in ROBOTS)
    assert Batch(3, p, GOAL, system=system_of(p))._special is GENERAL
    assert Batch(3, [p, p, p], GOAL)._special is QUIET
    assert Batch(2, [p, make_parameters(robot="waffle")], GOAL)._special is GENERAL


LATER = [
    make_parameters(noise="rough", delay=3),
    [make_parameters(noise=("rough", "clean", "tutorial")[i % 3], delay=i % 4) for i in range(N)],
    make_parameters(NAV, noise="documented", robot="waffle"),
    make_parameters(observation="truth"),
]


@pytest.mark.parametrize("later", LATER, ids=["others", "one for each", "still quiet", "no case"])
def test_parameters_may_leave_a_case_in_the_middle_of_an_episode(later):
    actions = acting(90)
    special, general = begun(make_parameters()), in_general(make_parameters())
    step_both(special, general, actions[:40], reset_every=17)
    for batch in (special, general):
        batch.set_parameters(later)
    assert bits(special) == bits(general)
    step_both(special, general, actions[40:], reset_every=17)
    expected = {0: SPECIALS[2], 1: SPECIALS[4], 2: QUIET, 3: GENERAL}[LATER.index(later)]
    assert special._special is expected
    special.set_parameters(make_parameters())
    general.set_parameters(make_parameters())
    step_both(special, general, actions[:20])  # slip that has begun goes on: there is no way back
    assert special._special is (QUIET if expected is QUIET else GENERAL)


def unknown(special):
    """Return the paths of a case that name no number of its system."""
    system = system_of(make_parameters(noise="rough", filter="slip" if special.name.endswith("slip") else "matched"))
    layout = layout_of(system, GENERAL)
    parameters = {path for path, _ in special.parameters} | {*(special.own or ())}
    world = {path for path, _ in special.world} | {path for pair in special.same for path in pair}
    return parameters - {*layout.parameters.names} | world - {*layout.world.names}


@pytest.mark.parametrize("special", [*SPECIALS, *SLIPPING], ids=lambda special: special.name)
def test_every_path_of_a_case_names_a_number_of_its_system(special):
    """A case with a path of a renamed field would never hold, and its loop would be as slow as the general one."""
    assert not unknown(special)
    renamed = special._replace(parameters=(*special.parameters, ("noise.process.alpha5", 0.0)), same=(("body.x", "body.y"),))
    assert unknown(renamed) == {"noise.process.alpha5", "body.x", "body.y"}
