"""A filter that reads the scan estimates after the robot has looked, in the same step: in plain Python and compiled alike."""

import numpy as np
import pytest

from turtlebot_gym.compiled.batch import Batch
from turtlebot_gym.estimation import ekf
from turtlebot_gym.estimation.update import of_x, update
from turtlebot_gym.kernel import kernel
from turtlebot_gym.models.angles import sincos
from turtlebot_gym.parameters import RoomReward
from turtlebot_gym.rooms.lidar import LIDARS
from turtlebot_gym.rooms.plan import FloorPlan
from turtlebot_gym.rooms.scene import Walls
from turtlebot_gym.systems import Episode, make_parameters, make_room, system_of
from turtlebot_gym.tasks import ROOM
from turtlebot_gym.values import Pose

WALL, GOAL = 3.0, Pose(2.0, 0.0, 0.0)
HALL = FloorPlan(walls=Walls(0.0, 0.0, WALL, WALL), start=Pose(0.0, 0.0, 0.0), goal=GOAL)


@kernel
def estimate_by_the_wall_ahead(estimate, before, senses, p, room, scene):
    """Correct x by the range of the beam that looks forward, to a wall whose place is known."""
    estimate = ekf.step(estimate, before, senses, p.tuning, p.dt, p.middle)
    mean, P = estimate.belief
    _, cosine = sincos(mean.theta)
    x = WALL - float(scene.ranges[1, 0]) * cosine  # else single precision in plain Python
    belief, _ = update(estimate.belief, of_x(P), x - mean.x, 1e-4)
    return ekf.Estimate(belief if cosine > 0.9 and room.scan_age == 0.0 else estimate.belief, estimate.nis, estimate.rejections)


@pytest.fixture(scope="module")
def parameters():
    p = make_parameters(ROOM, noise="tutorial")
    return p._replace(reward=RoomReward(), room=make_room(HALL, LIDARS["ideal"], p.dt))


@pytest.fixture(scope="module")
def by_scan(parameters):
    return system_of(parameters)._replace(estimate=estimate_by_the_wall_ahead, reads_scan=True)


def test_a_filter_that_reads_the_scan_is_the_same_compiled_and_in_plain_python(parameters, by_scan, in_step):
    batch = Batch(35, parameters, (GOAL,), system=by_scan, plan=HALL)
    plain = {i: Episode(parameters, seed=i, system=by_scan, plan=HALL) for i in (0, 33)}
    reached = sum(outcomes[5].sum() for outcomes in in_step(batch, plain, [0.8, -0.1], [1.2, 0.1], 120))
    assert reached > 0, "no goal was reached: the test saw too little"


def test_it_uses_the_scan_of_its_own_step(parameters, by_scan):
    """At full speed the scan of the step before would be off by 2 cm; this one is exact, so the estimate of x is."""
    errors = {}
    for name, system in {"without": system_of(parameters), "with": by_scan}.items():
        episode = Episode(parameters, seed=1, system=system, plan=HALL)
        off = []
        for _ in range(60):
            episode.act((1.0, 0.0))
            off.append(abs(episode.world.estimate.belief.mean.x - episode.world.body.true_state.x))
        errors[name] = float(np.mean(off[5:]))
    assert errors["with"] < 0.01 < errors["without"]


def test_without_surroundings_there_is_no_scan():
    p = make_parameters()
    with pytest.raises(ValueError, match=r"System\.reads_scan must be false without surroundings"):
        Batch(1, p, (GOAL,), system=system_of(p)._replace(reads_scan=True))
