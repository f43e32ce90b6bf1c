"""The safety layer: it prevents all contacts where a stop is possible, and changes nothing else."""

import numpy as np
import pytest
from sights import BURGER, random_sights, sight, wall_ahead

from turtlebot_gym.models.unicycle import execution_variances
from turtlebot_gym.presets import NOISES
from turtlebot_gym.rooms.lidar import SECTORS, SIGHT
from turtlebot_gym.values import Command
from turtlebot_gym_agents.policies import make_policy
from turtlebot_gym_agents.policies.protection import CREEP, SURE, SafetyLayer
from turtlebot_gym_agents.policies.sight import UNSEEN, arc


def layered(forward, turn, seen, **numbers):
    """Return what the safety layer makes of the same command in each row."""
    action = np.array([forward, turn], np.float32)
    return SafetyLayer(lambda observations: np.broadcast_to(action, (*observations.shape[:-1], 2)), **numbers)(seen)


def test_the_safety_layer_drives_the_nearest_arc_that_is_free_and_changes_nothing_else():
    near, far, gate = sight(shares=wall_ahead(0.15)), sight(shares=wall_ahead(0.6)), np.ones(SECTORS)
    assert layered(1.0, 0.2, far).tolist() == pytest.approx([1.0, 0.2])
    assert layered(-1.0, 0.0, near).tolist() == [-1.0, 0.0]
    assert layered(1.0, 0.0, near)[0] == pytest.approx(0.0, abs=1e-6)
    # 0.207 m less the LiDAR's place, the radius and the margin is 0.05 m: 0.5 s at 0.1 m/s, so 0.4 of 0.2108 m/s is the first
    # that will do.
    assert layered(1.0, 0.0, sight(shares=wall_ahead(0.207)))[0] == pytest.approx(0.4)
    gate[[0, -1, -2]] = 0.232 / SIGHT  # a post ahead on the right: around it on the left, at full speed
    forward, turn = layered(1.0, 0.0, sight(shares=gate))
    assert forward == 1.0
    assert turn > 0.1
    rows, changed = random_sights(500), 0
    for wish in ((1.0, 0.0), (1.0, 0.6), (-1.0, 0.3), (0.0, 1.0)):
        limited = layered(*wish, rows, way_out=0.0)
        share = limited[:, 0] * np.sign(wish[0])
        assert ((share >= 0.0) & (share <= abs(wish[0]))).all()
        changed += int((limited != np.float32(wish)).any(axis=1).sum())
    assert 50 < changed < 1500


def test_a_robot_inside_the_margins_of_two_posts_goes_on_between_them_down_to_the_least_margin():
    posts = np.ones(SECTORS)
    posts[[8, 28]] = 0.175 / SIGHT  # 0.065 m beside it, a little ahead
    inside = sight(shares=posts)
    assert layered(1.0, 0.0, inside, margin=0.08, way_out=0.0)[0] == 1.0
    assert layered(1.0, 0.0, inside, margin=0.08, least_margin=0.08, way_out=0.0)[0] == 0.0
    posts[[8, 28]] = 0.15 / SIGHT
    assert layered(1.0, 0.0, sight(shares=posts), margin=0.08, least_margin=0.06, way_out=0.0)[0] == 0.0
    posts[[8, 28]] = 0.125 / SIGHT  # inside the 2 cm that the layer keeps by itself
    assert layered(1.0, 0.0, sight(shares=posts), way_out=0.0)[0] == 1.0
    assert layered(1.0, 0.0, sight(shares=posts), least_margin=0.02, way_out=0.0)[0] == 0.0


def test_a_robot_that_sways_leaves_a_wall_beside_which_it_may_not_turn_as_fast_as_it_wants():
    near, far = sight(shares=wall_ahead(0.167)), sight(shares=wall_ahead(0.6))  # 0.03 m from the footprint
    variance = NOISES["wheel"].process.alpha2
    assert NOISES["rough"].process.alpha2 == 0.0 < variance
    assert layered(0.0, 1.0, near, noise="rough").tolist() == [0.0, 1.0]
    assert layered(0.0, 1.0, far, noise="wheel").tolist() == [0.0, 1.0]
    most = 0.03 / (SURE * np.sqrt(variance * 0.1 * SafetyLayer.reserve))  # 0.1 s is the period to which noise refers
    for dt in (0.05, 0.1):
        for turn in (-1.0, 1.0):
            away, slow = layered(0.0, turn, near, noise="wheel", dt=dt)
            assert away == np.float32(-CREEP)
            assert slow * BURGER.max_angular == pytest.approx(turn * most, rel=0.02)
    assert layered(0.5, 0.1, near, noise="wheel", way_out=0.0)[0] >= 0.0  # one that wants to drive never turns back


def test_a_layer_within_another_policy_allows_for_the_noise_too():
    alone, stopping = (make_policy(f"vfh+safety{within}", noise="wheel") for within in ("", "+yield"))
    assert alone.noise == stopping.policy.noise == "wheel"


def least_clearance(drive, *, delay, blind=0.0, noise="clean", robots=150, steps=60):
    """Return the least clearance of robots among posts, m, each of which starts where it could have stopped.

    Args:
        drive: The policy, from observations to actions.
        delay: Steps by which commands are late, at least 1.
        blind: Distance within which the LiDAR sees nothing, m.
        noise: Name of the noise of the robots' speeds.
        robots: Number of robots.
        steps: Number of steps.
    """
    random = np.random.default_rng(0)
    posts = random.uniform(-1.2, 1.2, (robots, 40)) + 1j * random.uniform(-1.2, 1.2, (robots, 40))
    posts[np.abs(posts) < max(BURGER.radius + 0.03, blind)] = UNSEEN
    at, heading = np.zeros(robots, complex), np.zeros(robots)
    commands, least = [np.zeros((robots, 2))] * delay, np.inf
    for _ in range(steps):
        seen = (posts - at[:, None]) * np.exp(-1j * heading)[:, None]
        sector = np.round(np.angle(seen) / (2.0 * np.pi) * SECTORS).astype(int) % SECTORS
        shares = np.ones((robots, SECTORS))
        ranges = np.where(np.abs(seen) < blind, np.inf, np.abs(seen))
        np.minimum.at(shares, (np.arange(robots)[:, None], sector), np.minimum(ranges / SIGHT, 1.0))
        belief = np.tile(sight()[:13], (robots, 1))
        belief[:, 5:7] = commands[-delay]  # which are executed until the next observation
        commands.append(np.asarray(drive(np.column_stack([belief, shares, np.zeros(robots)]).astype(np.float32)), float))
        v, omega = commands[-1 - delay].T * np.array([[BURGER.max_linear], [BURGER.max_angular]])
        variance, _ = execution_variances(Command(v, omega), NOISES[noise].process, 0.1)
        v = v + np.sqrt(variance) * random.standard_normal(robots)
        for _ in range(10):
            step, turned = arc(v, omega, 0.01)
            at, heading = at + step * np.exp(1j * heading), heading + np.angle(turned)
            least = min(least, np.abs(posts - at[:, None]).min() - BURGER.radius)
    return least


def reckless(seed):
    """Return a policy that drives at full speed, either way, and turns as it likes, for half a second each time."""
    random, state = np.random.default_rng(seed), {"left": 0}

    def drive(rows):
        if state["left"] == 0:
            forward = np.where(random.random(len(rows)) < 0.8, 1.0, -1.0)
            state.update(left=5, action=np.column_stack([forward, random.uniform(-1.0, 1.0, len(rows))]).astype(np.float32))
        state["left"] -= 1
        return state["action"]

    return drive


@pytest.mark.parametrize("delay", [1, pytest.param(2, marks=pytest.mark.slow)])
def test_within_the_layer_no_robot_touches_a_post_if_a_stop_was_possible(delay):
    """150 reckless robots among posts that stand still, with a perfect LiDAR, whose commands are a step late or two."""
    assert least_clearance(SafetyLayer(reckless(1), lag=0.0), delay=delay) > 0.0


@pytest.mark.parametrize("delay", [1, pytest.param(2, marks=pytest.mark.slow)])
def test_within_the_layer_no_robot_touches_a_post_that_came_too_near_for_the_lidar(delay, monkeypatch):
    """An LDS-02 sees nothing below 0.16 m; without a memory of such posts the robots touch them."""
    assert least_clearance(SafetyLayer(reckless(1), lag=0.0, lidar_x=0.0), delay=delay, blind=0.16) > 0.0
    monkeypatch.setattr(SafetyLayer, "_remembered", lambda self, rows, *since: rows)
    assert least_clearance(SafetyLayer(reckless(1), lag=0.0, lidar_x=0.0), delay=delay, blind=0.16) < -0.01


@pytest.mark.parametrize("forward", [0.0, 0.5])
def test_robots_that_sway_in_quick_turns_touch_a_post_only_within_a_layer_that_takes_their_motion_for_exact(forward):
    """150 robots that turn at full rate for two seconds, on the spot and on an arc, with the noise `wheel`, a step late."""
    turning = lambda rows: np.broadcast_to(np.float32([forward, 1.0]), (len(rows), 2))  # noqa: E731
    allowing, exact = (
        least_clearance(SafetyLayer(turning, lag=0.0, noise=noise), delay=1, noise="wheel", steps=20)
        for noise in ("wheel", "clean")
    )
    assert allowing > 0.0
    assert exact < -0.03


def test_a_layer_that_admits_every_arc_is_noticed(monkeypatch):
    monkeypatch.setattr(SafetyLayer, "_admits", lambda self, actions, points: np.ones(actions.shape[:-1], bool))
    assert least_clearance(SafetyLayer(reckless(1), lag=0.0), delay=1) < -0.05


def test_what_came_too_near_for_the_lidar_is_remembered_until_its_row_is_forgotten():
    post, ahead = np.ones(SECTORS), np.full((2, 2), [1.0, 0.0], np.float32)
    post[0] = 0.15 / SIGHT
    layer = SafetyLayer(lambda rows: ahead, way_out=0.0)
    layer(np.array([sight(shares=post)] * 2))
    layer.reset(np.array([False, True]))
    assert layer(np.array([sight()] * 2))[:, 0].tolist() == [0.0, 1.0]


def test_where_the_layer_has_stopped_a_robot_geometry_steers_for_a_while_until_its_row_is_forgotten():
    """A robot that only wants to drive straight into a wall: it turns along it, and then may try again."""
    ahead = lambda rows: np.broadcast_to(np.float32([1.0, 0.0]), (*rows.shape[:-1], 2))  # noqa: E731
    layer, wall, free = (
        SafetyLayer(ahead, way_out=0.3, margin=0.07),
        *(np.array([sight((2.0, 1.0, 0.0), shares=s)] * 2) for s in (wall_ahead(0.2), None)),
    )
    assert (layer(wall)[:, 1] != 0.0).all()
    layer.reset(np.array([False, True]))
    for expected in (True, True, False):
        guided, own = layer(free)[:, 1] != 0.0
        assert guided == expected
        assert not own
