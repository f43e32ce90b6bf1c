"""Systems: another plant, sensor, filter or observation is a kernel put in, and still the same in plain Python and compiled."""

import math
from dataclasses import replace

import pytest

from turtlebot_gym import Noise, OdometryNoise, ProcessNoise
from turtlebot_gym.estimation import ekf
from turtlebot_gym.heart import Episode
from turtlebot_gym.observations import Observation
from turtlebot_gym.systems import Options, make_parameters, system_of
from turtlebot_gym.tasks import SQUARE, SQUARE_WAYPOINTS
from turtlebot_gym.values import STOP, Belief, Command, Covariance, Odometry, Pose, Senses, State


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
