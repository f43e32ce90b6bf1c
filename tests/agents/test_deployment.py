"""A policy on one's own sensors: the environment's actions to the last bit, and invalid inputs are refused."""

import math
from dataclasses import replace

import numpy as np
import pytest
from bundles import CARD, linear_model

from turtlebot_gym import NAV, Episode, make_filter, make_noise, make_parameters
from turtlebot_gym.estimation.gyro import Gyro
from turtlebot_gym.observations import LOCATED_ROOM, OPEN_GROUND
from turtlebot_gym.rooms.lidar import LIDARS
from turtlebot_gym.rooms.scan import Scan
from turtlebot_gym.tasks import ROOM
from turtlebot_gym.values import STOP
from turtlebot_gym_agents import Deployment, make_policy
from turtlebot_gym_agents.policies.bundle import write_bundle
from turtlebot_gym_agents.policies.fit import describe_robot
from turtlebot_gym_agents.policies.protection import NEARER, SafetyLayer

TURN = 2.0 * math.pi


def scan_of(episode):
    """Return the newest scan of a room as a driver sends it, with its age, s; nothing on open ground."""
    if not episode.parameters.room:
        return None, 0.0
    lidar = episode.parameters.room.lidar
    is_blind = np.isinf(episode.scene.lidar.beams[2, : lidar.beams])
    ranges = np.where(is_blind, np.float32(np.nan), episode.scene.lidar.ranges[1, : lidar.beams])
    return Scan(ranges, 0.0, TURN / lidar.beams, lidar.range_min, lidar.range_max), episode.world.room.scan_age


def differences(steps, *, policy, yaw=0.0, wrong=0.0, **options):
    """Return in how many steps observation or action differ from the environment's loop, with the filter inside and outside.

    Args:
        steps: Number of steps, through as many episodes as they need.
        policy: The policy's name.
        yaw: Direction of the LiDAR, rad.
        wrong: Error of the heading that the deployments receive, rad.
        options: Options of the environment.
    """
    inside = Deployment(policy, lidar_yaw=yaw, filter="matched", noise="rough")
    outside, drive = Deployment(policy, lidar_yaw=yaw), make_policy(policy)
    episode, differ = Episode(make_parameters(noise="rough", **options), seed=5), [0, 0]
    for _ in range(steps):
        seen = np.array(episode.observe(), np.float32)
        action = drive(seen)
        odometry, (mean, P), course = episode.world.senses.odometry, episode.world.estimate.belief, episode.world.course
        scan, age = scan_of(episode)
        if episode.world.steps == 0.0:
            inside.reset()
            outside.reset()
        pose = odometry.pose._replace(theta=odometry.pose.theta + wrong) if odometry.measured else None
        more = {"following": course.following, "scan_age": age}
        inside.act(pose, None, odometry.twist, scan, course.reference, **more)
        pose, variances = (mean.x, mean.y, mean.theta + wrong), (P.xx, P.yy, P.tt)
        outside.act(pose, variances, mean[3:], scan, course.reference, nis=episode.world.estimate.nis, **more)
        for at, driven in enumerate((inside, outside)):
            differ[at] += not (np.array_equal(driven.observation, seen) and np.array_equal(driven.action, action))
        outcome = episode.act(action.tolist())
        if outcome.terminated or outcome.truncated:
            episode.reset()
    return differ


# Blind in four directions and mounted askew, as on a TurtleBot 4; with half of its beams, for time.
SPARSE = replace(LIDARS["a1"], beams=135)
PLACES = {
    "rooms": {
        "policy": "ppo-rooms",
        "task": replace(ROOM, max_steps=150.0),
        "world": "dense",
        "lidar": SPARSE,
        "yaw": SPARSE.yaw,
    },
    "open ground": {"policy": "ppo-nav", "task": replace(NAV, max_steps=150.0)},
}


@pytest.mark.parametrize("place", PLACES)
def test_its_actions_are_those_of_the_environments_loop_to_the_last_bit(place):
    """Through several episodes, with drop-outs of the odometry and bursts of slip."""
    assert differences(400, **PLACES[place]) == [0, 0]


def test_evidence_equals_the_environments_with_an_external_localizer():
    options = {"world": "office", "noise": "wheel", "localizer": "match", "start": "unknown", "observation": "located"}
    episode, deployment = Episode(make_parameters(**options), seed=5), Deployment(f"{__name__}:WithEvidence")
    shown = set()
    for _ in range(60):
        estimate, course, (scan, age) = episode.world.estimate, episode.world.course, scan_of(episode)
        mean, P = estimate.belief
        covariance = ((P.xx, P.xy, P.xt), (P.xy, P.yy, P.yt), (P.xt, P.yt, P.tt))
        more = {"nis": estimate.nis, "scan_age": age, "evidence": (estimate.fits, estimate.weight)}
        deployment.act(mean[:3], covariance, mean[3:], scan, course.reference, following=course.following, **more)
        np.testing.assert_array_equal(deployment.observation, np.array(episode.observe(), np.float32))
        shown.add(estimate.weight)
        episode.act(deployment.action.tolist())
    assert len(shown) > 2
    with pytest.raises(ValueError, match=r"^evidence must be shares of fitting beams .* reads 'evidence', got None"):
        deployment.act(**INPUTS)
    with pytest.raises(ValueError, match=r"^evidence\[1\] must be a probability"):
        deployment.act(**INPUTS, evidence=(0.5, 1.1))
    with pytest.raises(ValueError, match="filter must be None for a policy that reads 'evidence'"):
        Deployment(f"{__name__}:WithEvidence", filter="matched")


class WithEvidence:
    """VFH+ that goes slower where its place is in doubt."""

    terms = LOCATED_ROOM

    def __init__(self, *, robot, dt):
        self._policy = make_policy("vfh", robot=robot, dt=dt)

    def reset(self, mask):
        self._policy.reset(mask)

    def __call__(self, observations):
        return self._policy(observations) * observations[..., 16:17]


def test_an_error_of_a_milliradian_would_be_noticed():
    inside, outside = differences(50, wrong=1e-3, **PLACES["rooms"])
    assert inside > 40
    assert outside > 40


def test_a_command_is_the_limited_action(seeing):
    command = seeing.act(**INPUTS)
    forward, turn = (np.clip(seeing.action, -1.0, 1.0) * (0.2108, 2.635)).tolist()
    assert abs(command.v) + 0.08 * abs(command.omega) <= 0.2097 + 1e-12
    assert command.v * turn == pytest.approx(command.omega * forward)


SCAN = Scan(np.full(360, 2.0, np.float32), 0.0, TURN / 360, 0.1, 3.5)
INPUTS = {"pose": (0.0, 0.0, 0.0), "covariance": (0.0, 0.0, 0.0), "twist": (0.1, 0.0), "scan": SCAN, "goal": (2.0, 1.0, 0.0)}


@pytest.fixture(scope="module")
def deployment():
    return Deployment("vfh")


@pytest.fixture
def seeing(deployment):
    deployment.reset()
    return deployment


def test_a_pose_that_does_not_move_stops_the_robot_until_a_reset(seeing):
    """Partner: a pose that moves as its twist says does not."""
    for x, stops in ((0.0, True), (0.01, False)):
        seeing.reset()
        for k in range(20):
            scan = SCAN._replace(ranges=SCAN.ranges + 0.001 * (k % 2))
            command = seeing.act(**{**INPUTS, "pose": (k * x, 0.0, 0.0), "scan": scan, "goal": (8.0, 0.0, 0.0)})
        assert (command == STOP) is stops
        assert seeing.disagreement.startswith("the pose does not move" if stops else "")
    seeing.reset()
    assert not seeing.disagreement


def test_a_localization_that_finds_the_robot_elsewhere_is_no_contradiction(seeing):
    """Partner: with a filter inside poses are those of odometry, which does not leap."""
    by_odometry = Deployment("bearing", filter="matched", noise="wheel")
    for k in range(20):
        pose = (0.01 * k + (3.0 if k > 10 else 0.0), 0.0, 0.0)
        scan = SCAN._replace(ranges=SCAN.ranges + 0.001 * (k % 2))
        seeing.act(**{**INPUTS, "pose": pose, "scan": scan, "goal": (8.0, 0.0, 0.0)})
        by_odometry.act(pose, None, (0.1, 0.0), None, (8.0, 0.0, 0.0))
    assert not seeing.disagreement
    assert "odometry jumps" in by_odometry.disagreement


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ({"pose": (0.0, math.nan, 0.0)}, r"^pose\[1\] must be a number .*, got nan\.$"),
        ({"pose": None}, "^pose must be given without a filter inside"),
        ({"covariance": None}, "^covariance must be given without a filter inside"),
        ({"covariance": (-0.1, 0.1, 0.1)}, r"^covariance\[0\] must be a number from 0 to"),
        ({"covariance": np.eye(6)}, r"^covariance must be 3 variances, or a 3 x 3 matrix"),
        ({"twist": (math.inf, 0.0)}, r"^twist\[0\] must be a number"),
        ({"goal": (0.0, 0.0, "north")}, r"^goal\[2\] must be a number"),
        ({"nis": math.nan}, "^nis must be a number"),
        ({"evidence": (1.0, 1.0)}, "^evidence must be None for a policy that reads no 'evidence'"),
        ({"scan": None}, "^scan must be a Scan for a policy that reads 'scan', got None"),
        ({"scan": np.full(360, 2.0)}, "^scan must be a turtlebot_gym.rooms.scan.Scan with ranges, first, increment"),
        ({"scan": SCAN._replace(increment=None)}, "^scan.increment must be a number"),
        ({"scan": SCAN._replace(increment=0.0)}, "^the scan's angle_increment must be finite and not 0"),
        ({"scan": SCAN._replace(ranges=["a", "b"])}, "^scan.ranges must be numbers"),
        ({"scan_age": 1.5}, "^scan_age must be a number from 0 to 1 s, got 1.5"),
    ],
)
def test_what_cannot_be_read_is_refused_in_one_line(seeing, changed, message):
    seeing.act(**INPUTS)
    with pytest.raises(ValueError, match=message) as refused:
        seeing.act(**{**INPUTS, **changed})
    assert "\n" not in str(refused.value)


def test_a_clockwise_scan_is_seen_where_it_points(seeing):
    ranges = SCAN.ranges.copy()
    ranges[90] = 0.5  # to the left of one that turns counter-clockwise
    for increment, sector in ((SCAN.increment, 9), (-SCAN.increment, 27)):
        seeing.act(**{**INPUTS, "scan": SCAN._replace(ranges=ranges, increment=increment)})
        assert np.flatnonzero(seeing.observation[13:-1] < 0.5).tolist() == [sector]


def test_robot_and_period_are_those_on_the_card(tmp_path):
    deployment, path = Deployment("ppo-nav"), tmp_path / "waffle.onnx"
    assert (deployment.robot.max_linear, deployment.period, deployment.terms) == (0.2108, 0.1, OPEN_GROUND)
    write_bundle(path, linear_model(), replace(CARD, robot=describe_robot("waffle"), dt=0.2))
    for given in ({}, {"robot": "waffle"}, {"period": 0.2}):
        deployment = Deployment(path, **given)
        assert (deployment.robot.max_linear, deployment.period) == (0.26, 0.2)
    with pytest.raises(ValueError, match="made for 10 Hz burger, asked for 10 Hz waffle"):
        Deployment("ppo-nav", robot="waffle")
    with pytest.raises(ValueError, match="made for 10 Hz burger, asked for 20 Hz burger"):
        Deployment("ppo-nav", period=0.05)


class TestTheFilterInside:
    INPUTS = {**INPUTS, "covariance": None, "scan": None}

    @pytest.fixture
    def estimating(self):
        return Deployment("bearing", filter="matched", noise="documented")

    @pytest.mark.parametrize(
        ("changed", "message"),
        [
            ({"covariance": (0.0, 0.0, 0.0)}, "^covariance must be None and nis 0 with a filter inside"),
            ({"nis": 1.0}, "^covariance must be None and nis 0 with a filter inside"),
            ({"dt": 0.0}, "^dt must be a number above 0 and at most 1 s"),
            ({"pose": None}, "^pose must be given in the first call"),
        ],
    )
    def test_it_needs_a_first_pose_no_covariance_and_a_known_interval(self, estimating, changed, message):
        with pytest.raises(ValueError, match=message):
            estimating.act(**{**self.INPUTS, **changed})

    def test_a_refusal_leaves_it_as_it_was(self, estimating):
        estimating.act(**self.INPUTS)
        before = estimating.filter.belief
        with pytest.raises(ValueError, match="goal"):
            estimating.act(**{**self.INPUTS, "pose": (0.1, 0.0, 0.0), "goal": None})
        assert estimating.filter.belief == before

    def test_it_predicts_for_the_time_that_passed(self, estimating):
        for dt, driven in ((None, 0.0), (0.1, 0.0), (0.3, 0.03)):
            estimating.act(**{**self.INPUTS, "pose": (0.0, 0.0, 0.0) if dt is None else None}, dt=dt)
            assert estimating.filter.belief.mean.x == pytest.approx(driven)

    def test_a_reset_forgets_the_pose(self, estimating):
        estimating.act(**self.INPUTS)
        estimating.reset()
        estimating.act(**{**self.INPUTS, "pose": (5.0, 0.0, 0.0)})
        assert estimating.filter.belief.mean[:3] == (5.0, 0.0, 0.0)

    def test_a_filter_of_another_sensor_is_refused(self):
        tuning = replace(make_filter("matched", make_noise("wheel")), kind=Gyro(variance=1e-4, bias_deviation=0.01))
        with pytest.raises(ValueError, match=r"^filter must read odometry only, but this one also reads imu"):
            Deployment("bearing", filter=tuning)


def test_with_a_margin_a_policy_that_sees_drives_within_a_safety_layer(tmp_path):
    """Towards a wall 0.25 m ahead of the LiDAR: without a layer, with a small margin, and with a large one, where it creeps."""
    angles = 2.0 * math.pi * np.arange(360) / 360.0
    with np.errstate(divide="ignore"):
        wall = np.where(np.cos(angles) > 0.05, 0.25 / np.cos(angles), np.inf).astype(np.float32)
    scan = Scan(wall, 0.0, 2.0 * math.pi / 360.0, 0.12, 3.5)
    (tmp_path / "bold.yaml").write_text("{policy: vfh, caution: 0.1, margin: 0.0, sight: 0.1}")
    drives = [Deployment(str(tmp_path / "bold.yaml"), safety_margin=margin) for margin in (0.0, 0.02, 0.15)]
    speeds = [drive.act((0.0, 0.0, 0.0), np.zeros(3), (0.0, 0.0), scan, (0.3, 0.0, 0.0)).v for drive in drives]
    assert speeds[0] >= speeds[1] > NEARER / SafetyLayer.reserve > speeds[2]
    assert (
        Deployment("bearing", safety_margin=0.02).act((0.0, 0.0, 0.0), np.zeros(3), (0.0, 0.0), None, (1.0, 0.0, 0.0)).v > 0.2
    )
    layer = Deployment("vfh", safety_margin=0.08)._policy
    assert isinstance(layer, SafetyLayer)
    assert layer.least_margin > SafetyLayer.least_margin  # the guard's monitor stops a robot that goes farther in
    with pytest.raises(ValueError, match="safety_margin must be"):
        Deployment("vfh", safety_margin=-0.1)
