"""The estimator is the environment's filter, run by the odometry, drop-outs included."""

import math
from dataclasses import replace

import numpy as np
import pytest

from turtlebot_gym.heart import Episode
from turtlebot_gym.models.angles import wrap
from turtlebot_gym.presets import FIXES, NOISES
from turtlebot_gym.systems import make_parameters
from turtlebot_gym.tasks import NAV
from turtlebot_gym.values import STOP, Belief, Command, Covariance, Fix, Odometry, Pose, State
from turtlebot_gym_ros.blocks import KalmanFilter, TurtlebotSimulator
from turtlebot_gym_ros.blocks.credible import Gate
from turtlebot_gym_ros.node.block import Resume, Stamped

COMMAND = Command(0.15, 0.4)


pytestmark = pytest.mark.filterwarnings("ignore:filter '.*' changes nothing")  # with its noise, which is said


def estimator(**parameters):
    return KalmanFilter(KalmanFilter.Params(**parameters))


def seen(x, y, theta, twist=STOP, measured=True):
    return Odometry(Pose(x, y, theta), twist, measured)


ALIKE = [
    *(("matched", noise, "none") for noise in NOISES),
    ("calibrated", "wheel", "none"),
    ("tutorial", "rough", "none"),
    ("gated", "rough", "none"),
    *(("matched", "wheel", fix) for fix in FIXES),
    ("gated", "wheel", "late"),
]


@pytest.mark.parametrize(("filter", "noise", "fix"), ALIKE)
def test_its_estimates_are_the_environments(filter, noise, fix):
    """To the bit, also over drop-outs. With fixes, though it remembers more steps; a fix that is heard twice counts once."""
    takes_fixes = fix != "none"
    plant = TurtlebotSimulator(TurtlebotSimulator.Params(noise=noise, seed=3, fix=fix))
    node = estimator(noise=noise, filter=filter, takes_fixes=takes_fixes)
    parameters = make_parameters(replace(NAV, random=False), noise=noise, filter=filter, fix=fix if takes_fixes else None)
    episode = Episode(parameters, (Pose(0.0, 0.0, 0.0),), seed=3)
    said, heard, count = plant.step(0.1, None), None, 0
    assert node.step(0.0, said["odometry"])["estimate"].belief == episode.world.estimate.belief
    for _ in range(100):
        episode.step(COMMAND)
        said = plant.step(0.1, COMMAND)
        heard = said.get("fix", heard and heard._replace(age=heard.age + 0.1))
        count += "fix" in said
        estimate, expected = node.step(0.1, said["odometry"], fix=heard)["estimate"], episode.world.estimate
        assert estimate.belief == expected.belief
        assert takes_fixes or estimate == expected
    assert (count > 10) is takes_fixes


def test_after_a_reset_it_begins_again_wherever_the_robot_is():
    node, elsewhere = estimator(), seen(-1.0, 0.0, 0.5, COMMAND)
    node.step(0.0, seen(1.0, 2.0, 3.0))
    node.step(0.1, seen(1.0, 2.0, 3.0, COMMAND))
    node.reset()
    assert node.step(0.0, elsewhere)["estimate"] == estimator().step(0.0, elsewhere)["estimate"]


def test_it_believes_commands_as_the_robot_executes_them_only_where_asked_to():
    assert estimator().inputs["command"].lock_step == "absent"
    node = estimator(noise="clean", twist="commanded")
    assert node.inputs["command"].lock_step == "refused"
    node.step(0.0, seen(0.0, 0.0, 0.0), None)
    mean = node.step(0.1, seen(0.0, 0.0, 0.0), Command(5.0, 0.0))["estimate"].belief.mean
    assert mean.v == pytest.approx(0.2097)
    mean = node.step(0.1, seen(0.02, 0.0, 0.0, Command(0.1, 0.0)), None)["estimate"].belief.mean
    assert mean.v == pytest.approx(0.0, abs=1e-3)


def driving(**parameters):
    """A filter of a burger's wheels, 1 m into a drive ahead at 0.1 m/s."""
    node = estimator(**{"noise": "wheel", "takes_fixes": True, **parameters})
    for k in range(101):
        node.step(0.1 * (k > 0), seen(0.01 * k, 0.0, 0.0, Command(0.1, 0.0)))
    return node


NEXT = seen(1.01, 0.0, 0.0, Command(0.1, 0.0))


def test_lost_messages_are_predicted_over_and_after_a_pause_it_begins_again():
    node, other = driving(), driving()
    other.step(0.1, NEXT._replace(pose=Pose(1.0, 0.0, 0.0), measured=False))
    after = seen(1.02, 0.0, 0.0, Command(0.1, 0.0))
    assert node.step(0.2, after)["estimate"] == other.step(0.1, after)["estimate"]
    node.pause()
    begun = estimator(noise="wheel").step(0.0, after)["estimate"]
    assert node.step(0.1, after)["estimate"].belief == begun.belief


def test_with_publish_tf_the_estimated_pose_is_a_transform_too():
    answer = estimator(publish_tf=True).step(0.0, seen(1.0, 2.0, 0.5))
    assert answer["tf"].pose == answer["estimate"].belief.mean[:3]
    assert "tf" not in estimator().step(0.0, seen(1.0, 2.0, 0.5))


@pytest.mark.parametrize(
    ("message", "said"),
    [
        (NEXT._replace(twist=Command(50.0, 0.0)), "odometry's twist of 50 m/s is 237 times the robot's limit"),
        (NEXT._replace(twist=Command(50.0, 0.0), measured=False), "odometry's twist of 50 m/s"),
        (NEXT._replace(pose=Pose(3.0, 0.0, 0.0)), "odometry jumps by 2.00 m and 0.00 rad against its twist"),
        (NEXT._replace(pose=Pose(1.0, 0.0, 2.0)), "and 2.00 rad against its twist"),
    ],
)
def test_a_message_that_contradicts_odometry_is_counted_and_not_used_and_the_third_in_a_row_is_final(message, said):
    node, other = driving(), driving()
    for k in (1, 2):
        assert node.step(0.05, message) == {}
        assert said in node.notice if k == 1 else node.notice
        assert node.figures["refused odometry"] == k
    after = seen(1.02, 0.0, 0.0, Command(0.1, 0.0))
    assert node.step(0.1, after)["estimate"] == other.step(0.2, after)["estimate"]  # as if these had been lost
    assert node.notice is None
    cause = None
    for _ in range(3):
        cause = node.step(0.05, message).get("disagreement", cause)
    assert said[-15:] in cause.cause
    assert cause.cause in node.fault


FAR = NEXT._replace(pose=Pose(3.0, 0.0, 0.0))


def final(node, message, count=10):
    for _ in range(count):
        node.step(0.05, message)
    assert node.fault
    return node


def test_enabling_a_controller_lets_the_filter_go_on_from_where_it_knew_the_robot():
    """Partner: while odometry says that the robot drives, nobody can say where it goes on."""
    standing = FAR._replace(twist=STOP)
    node = final(driving(), standing)
    answer = node.step(0.05, standing, resume=Resume())
    assert answer["estimate"].belief.mean[:3] == pytest.approx((1.0, 0.0, 0.0), abs=0.02)
    assert min(answer["estimate"].belief.covariance[at] for at in (0, 3, 5)) > 0.02  # of x, y and heading
    assert answer["disagreement"].cause == ""
    assert node.step(0.05, standing)["estimate"].belief.mean.x == pytest.approx(1.0, abs=0.02)
    assert node.fault is None


def test_odometry_that_contradicts_the_command_is_refused_though_its_parts_agree():
    node = driving()
    for _ in range(20):
        node.step(0.05, STANDING, Command(0.2, 0.0))
    assert "commanded to drive and does not move" in node.fault


SURE = (1e-4, 1e-4, 1e-4)


@pytest.mark.parametrize(
    ("pose", "R", "age", "said"),
    [
        (Pose(1000.0, 1000.0, 0.0), SURE, 0.0, "1413.50 m from the estimate, with a normalized squared innovation of"),
        (Pose(1e300, 0.0, 0.0), SURE, 0.0, "it is at (1e+300, 0), farther than 100000 m"),
        (Pose(1.0, 0.0, 0.0), (1e9, 1e-4, 1e-4), 0.0, "its variance of 1e+09 m^2 says nothing"),
        (Pose(1.01, 0.0, 3.0), SURE, 0.0, "0.00 m from the estimate"),
        (Pose(1.01, 0.0, 0.0), SURE, -9.95, "stamped 9.95 s in the future: are the clocks synchronized"),
        (Pose(1.01, 0.0, 0.0), SURE, 0.6, "0.60 s old: steps are stored for 0.5 s"),
    ],
)
def test_a_fix_that_the_belief_rules_out_is_counted_and_not_used(pose, R, age, said):
    node, other = driving(), driving()
    answer = node.step(0.1, NEXT, fix=Stamped(Fix(pose, R, 0.0, True), age))
    assert answer == other.step(0.1, NEXT)
    assert node.notice.startswith("fixes refused: ")
    assert said in node.notice
    assert node.figures["refused fixes"] == 1
    node.step(0.1, NEXT, fix=Stamped(Fix(NEXT.pose, SURE, 0.0, True), 0.1))
    assert node.notice is None
    assert node.figures["refused fixes"] == 1


def test_a_fix_is_judged_by_the_sum_of_both_covariances_and_the_last_belief_of_its_time():
    rng, gate, off = np.random.default_rng(0), Gate(), np.array([3.0, -2.0, 1.0])
    A, B = (root @ root.T for root in rng.normal(size=(2, 3, 3)))
    belief = Belief(State(*off, 0.0, 0.0), Covariance(*A[np.triu_indices(3)], 1.0, 1.0))
    for mean in (State(0.0, 0.0, 0.0, 0.0, 0.0), belief.mean):
        gate.remember(0.0, belief._replace(mean=mean))
    for n, scale in ((3, 100.0), (2, 30.0)):
        fix = Fix(
            Pose(*(off + scale)), (*np.diag(B)[:2], B[2, 2] if n == 3 else math.inf), 0.0, True, (B[0, 1], B[0, 2], B[1, 2])
        )
        away = np.array([scale, scale, wrap(scale)])[:n]
        squared = away @ np.linalg.solve((A + B)[:n, :n], away)
        assert f"squared innovation of {squared:.3g}, above" in gate.refusal(fix, 0.0)


STANDING = seen(1.0, 0.0, 0.0)
SEAT = Fix(Pose(5.0, -3.0, math.pi / 2.0), (0.25, 0.25, 0.07), 0.0, True)


@pytest.mark.parametrize("filter", ["matched", "gated"])
@pytest.mark.parametrize("noise", ["wheel", "tutorial", "clean"])
def test_a_person_puts_a_standing_robot_elsewhere_and_odometry_goes_on_from_there(noise, filter):
    node = driving(noise=noise, filter=filter)
    belief = node.step(0.1, STANDING, initial_pose=SEAT)["estimate"].belief
    assert belief.mean[:3] == pytest.approx(SEAT.pose)
    assert (belief.covariance.xx, belief.covariance.yy, belief.covariance.tt) == pytest.approx(SEAT.R, rel=0.05)
    for k in range(1, 200):
        belief = node.step(0.1, seen(1.0 + 0.01 * k, 0.0, 0.0, Command(0.1, 0.0)))["estimate"].belief
    assert belief.mean[:3] == pytest.approx((5.0, -3.0 + 1.99, math.pi / 2.0), abs=1e-6 if noise == "wheel" else 0.1)
    node.reset()
    assert node.step(0.0, STANDING)["estimate"].belief.mean.x == 1.0


@pytest.mark.parametrize(
    ("odometry", "initial_pose", "said"),
    [
        (NEXT, SEAT, "the robot must stand, but drives with 0.1 m/s"),
        (STANDING._replace(measured=False), SEAT, "the robot must stand"),
        (STANDING, SEAT._replace(R=(0.25, 0.25, math.inf)), "it has no heading"),
        (STANDING, SEAT._replace(pose=Pose(1e300, 0.0, 0.0)), "it is at (1e+300, 0)"),
    ],
)
def test_a_persons_pose_is_refused_with_the_reason(odometry, initial_pose, said):
    node, other = driving(), driving()
    assert node.step(0.1, odometry, initial_pose=initial_pose) == other.step(0.1, odometry)
    assert node.notice.startswith(f"initial poses refused: {said}")
    assert node.figures["refused initial poses"] == 1
