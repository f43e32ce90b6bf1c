"""Systems: another plant, sensor, filter or observation is a kernel put in, and still the same in plain Python and compiled."""

import math
from dataclasses import replace

import pytest
from own_parts import slide
from scipy import stats

from turtlebot_gym import Noise, OdometryNoise, ProcessNoise
from turtlebot_gym.compiled.batch import Batch
from turtlebot_gym.estimation import ekf
from turtlebot_gym.estimation.ekf import EXTENDED_KALMAN
from turtlebot_gym.estimation.update import Projection, update
from turtlebot_gym.heart import Episode
from turtlebot_gym.kernel import kernel, sqrt
from turtlebot_gym.models.random import normals
from turtlebot_gym.observations import Observation, ObservationTerm
from turtlebot_gym.systems import Options, Sensor, make_parameters, open_ground, system_of
from turtlebot_gym.tasks import SQUARE, SQUARE_WAYPOINTS
from turtlebot_gym.values import STOP, Belief, Command, Covariance, Odometry, Pose, Senses, State

BEACONS = ((2.0, 2.0), (-2.0, 2.0), (0.0, -3.0))


@kernel
def sense_ranges(body, before, key, at, p):
    x, y, (noise, _) = body.true_state.x, body.true_state.y, normals(key, at, 9)
    return tuple(sqrt((a - x) ** 2 + (b - y) ** 2) + 0.01 * noise for a, b in BEACONS)


@kernel
def first_ranges(body, key, p):
    return sense_ranges(body, (), key, 0, p)


@kernel
def estimate_with_ranges(estimate, before, senses, p):
    """Condition a belief on ranges: a second sensor is a call of `update`, not an edit of the filter."""
    estimate = ekf.step(estimate, before, senses, p.tuning, p.dt, p.integrator)
    for beacon, z in zip(BEACONS, senses.ranges, strict=True):
        mean, P = estimate.belief
        dx, dy = mean.x - beacon[0], mean.y - beacon[1]
        predicted = sqrt(dx * dx + dy * dy)
        hx, hy = dx / predicted, dy / predicted
        column = Pose(hx * P.xx + hy * P.xy, hx * P.xy + hy * P.yy, hx * P.xt + hy * P.yt)
        after, _ = update(estimate.belief, Projection(column, hx * column.x + hy * column.y), z - predicted, 1e-4)
        estimate = estimate._replace(belief=after)
    return estimate


@kernel
def see(world, p):
    return world.senses.ranges


RANGES = (
    open_ground(EXTENDED_KALMAN)
    ._replace(estimate=estimate_with_ranges, move=slide)
    .with_sensor(Sensor("ranges", first_ranges, sense_ranges))
    .with_observation(ObservationTerm("ranges", see, (0.0,) * 3, (20.0,) * 3))
)


def test_another_sensor_filter_observation_and_plant_are_the_same_compiled_and_in_plain_python(in_step):
    task, waypoints = Options(task=replace(SQUARE, radius=1.5)).course()
    p = make_parameters(task, noise="rough", integrator="midpoint", delay=1)
    batch, plain = Batch(35, p, waypoints, system=RANGES), {i: Episode(p, waypoints, seed=i, system=RANGES) for i in (0, 34)}
    reached = sum(outcomes[5].sum() for outcomes in in_step(batch, plain, [0.2, -0.2], [1.2, 0.2], 150))
    assert reached > 0, "no waypoint was reached: the test saw too little"


def test_an_episode_takes_another_plant_that_is_no_kernel():
    """It may keep its state to itself."""
    where = [0.0]

    def engine(body, command, key, at, p):
        where[0] += 0.25
        return body._replace(true_state=State(where[0], 0.0, 0.0, 2.5, 0.0), command=command)

    p = make_parameters(SQUARE, noise="clean")
    episode = Episode(p, SQUARE_WAYPOINTS, system=system_of(p)._replace(move=engine))
    assert [episode.step(STOP).reached for _ in range(7)] == [False] * 6 + [True]  # 0.3 m before the first waypoint
    assert episode.world.senses.odometry.pose == (1.75, 0.0, 0.0)


# The parts, by numbers that were worked out by hand.


@pytest.mark.parametrize("delay", [0, 1, 2, 3])
def test_a_command_comes_as_many_steps_late_as_asked_for(delay):
    """Speeds 0.01, 0.02, ... are asked for; the command in force after step k is that of step k - delay."""
    episode = Episode(make_parameters(SQUARE, noise="clean", delay=delay), SQUARE_WAYPOINTS)
    for k in range(1, 9):
        episode.step(Command(0.01 * k, 0.0))
        assert episode.world.body.command.v == (0.01 * (k - delay) if k > delay else 0.0)
        assert episode.world.senses.odometry.twist == episode.world.body.command


@pytest.mark.parametrize("wheel", [True, False])
@pytest.mark.parametrize("integrator", ["euler", "midpoint"])
def test_a_filter_that_knows_the_wheels_follows_the_robot_and_another_one_does_not(wheel, integrator):
    odometry, errors = OdometryNoise(wheel=wheel, dropout_probability=1.0 - wheel), []
    noise = Noise(process=ProcessNoise(scale=0.9, turn_scale=0.62, veer=0.1), odometry=odometry)
    for name in ("calibrated", "matched"):
        episode = Episode(make_parameters(SQUARE, noise=noise, filter=name, integrator=integrator), SQUARE_WAYPOINTS)
        for at in range(50):
            episode.step(Command(0.2, 0.8 if at % 20 < 10 else -0.3))
        true, mean = episode.world.body.true_state, episode.world.estimate.belief.mean
        errors.append(max(abs(mean.x - true.x), abs(mean.y - true.y), abs(mean.theta - true.theta)))
    assert errors[0] < 1e-12
    assert errors[1] > 0.1


@pytest.mark.parametrize("lost", [1.0, 0.3])
def test_a_lost_measurement_leaves_all_of_the_last_pose_and_the_filter_predicts_as_often_as_stated(lost):
    p = make_parameters(SQUARE, noise=Noise(odometry=OdometryNoise(dropout_probability=lost, R=(0.01, 0.01, 0.01))))
    episode, missed = Episode(p, SQUARE_WAYPOINTS, seed=3), 0
    before = episode.world
    assert before.senses.odometry.measured  # the first one always arrives
    for _ in range(500):
        episode.step(Command(0.2, 0.7))
        now = episode.world
        pose, _, measured = now.senses.odometry
        assert [a == b for a, b in zip(pose, before.senses.odometry.pose, strict=True)] == [not measured] * 3
        if not measured:
            predicted = ekf.predict(before.estimate.belief, now.body.command, p.tuning, 0.1, 0.0)
            assert now.estimate == before.estimate._replace(belief=predicted)
        missed += not measured
        before = now
    assert stats.binomtest(missed, 500, lost).pvalue > 1e-4


@pytest.mark.parametrize(
    ("observation", "distance", "sine", "v", "omega", "std_position", "std_heading", "nis"),
    [
        ("ekf", 1.0, 0.0, 0.5, 0.0, 0.5, 0.1, 4.0),
        ("odometry", math.sqrt(5.0), -1.0 / math.sqrt(5.0), 1.0, -1.0, 0.2, 0.5, 0.0),
        ("truth", 2.0, 0.0, 0.0, 0.5, 0.0, 0.0, 0.0),
    ],
)
def test_what_each_observation_shows_and_states(observation, distance, sine, v, omega, std_position, std_heading, nis):
    """The robot believes that it is at (1, 0), measures (0, 1) and is at the origin, looking along x to a goal at (2, 0)."""
    task, waypoints = Options(task="square", waypoints=[Pose(2.0, 0.0, 0.0)]).course()
    p = make_parameters(task, noise="clean", observation=observation)
    episode = Episode(p._replace(tuning=replace(p.tuning, R=(0.03, 0.01, 0.25))), waypoints)
    covariance = Covariance(0.09, 0.0, 0.0, 0.16, 0.0, 0.01, 0.0, 0.0)
    believed = ekf.Estimate(Belief(State(1.0, 0.0, 0.0, 0.1054, 0.0), covariance), 4.0, 0.0)
    body = episode.world.body._replace(true_state=State(0.0, 0.0, 0.0, 0.0, 1.3175))
    senses = Senses(Odometry(Pose(0.0, 1.0, 0.0), Command(0.2108, -2.635), True))
    episode.world = episode.world._replace(body=body, senses=senses, estimate=believed)
    o = Observation(*episode.observe())
    shown = (o.distance, o.sin_bearing, o.v, o.omega, o.std_position, o.std_heading, o.nis)
    assert shown == pytest.approx((distance, sine, v, omega, std_position, std_heading, nis))
