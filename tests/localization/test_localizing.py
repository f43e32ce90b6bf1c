"""A robot that localizes itself: the same compiled and in plain Python, and much nearer to the truth than its wheels."""

from dataclasses import asdict, replace

import numpy as np
import pytest
from localization_rooms import hall, make_room

from turtlebot_gym.compiled.batch import Batch
from turtlebot_gym.estimation.consistency import difference
from turtlebot_gym.estimation.filters import matrix
from turtlebot_gym.heart import Episode
from turtlebot_gym.localization.tuning import LocalizerTuning
from turtlebot_gym.observations import LOCATED_ROOM, ROOM
from turtlebot_gym.observations.columns import bounds_of
from turtlebot_gym.parameters import ProcessNoise
from turtlebot_gym.rooms.grid import FREE, OCCUPIED, GridMap
from turtlebot_gym.rooms.plan import FloorPlan
from turtlebot_gym.rooms.rules import ROOMS
from turtlebot_gym.systems import Options
from turtlebot_gym.values import Pose

IN_OFFICE = {"world": "office", "noise": "wheel"}
HALL = FloorPlan(walls=(0.0, 0.0, 2.5, 2.0), boxes=((0.5, 0.5, 1.0, 0.3, 0.4),), start=Pose(-1.5, -1.0, 0.3))


def batch_of(drives, localizer="match", noise="wheel", **options):
    """Return a batch whose episodes have begun, with its plan."""
    p, waypoints, plan, _ = Options(localizer=localizer, noise=noise, **options).setup()
    batch = Batch(drives, p, waypoints, plan=plan)
    batch.seeds[:] = np.arange(drives)
    batch.reset(np.ones(drives, np.bool_), *batch.empty())
    return batch


def errors(batch, steps):
    """Drive with random commands, and return the errors of the position, m, shape (steps, N)."""
    rng, off = np.random.default_rng(0), []
    for step in range(steps):
        if step % 10 == 0:
            actions = rng.uniform([0.0, -0.5], [0.6, 0.5], (batch.num_envs, 2)).astype(np.float32)
        batch.step(actions)
        off.append(difference(batch.numbers("estimate.belief.mean"), batch.numbers("body.true_state"))[:, :2])
    return np.hypot(*np.moveaxis(off, 2, 0))


@pytest.mark.parametrize(
    ("world", "lidar", "start", "observation"),
    [(HALL, "urg04lx", "known", "located"), ("crowd", "ideal", "unknown", "ekf")],
)
def test_it_is_the_same_compiled_and_in_plain_python(world, lidar, start, observation, in_step):
    options = Options(world=world, lidar=lidar, noise="wheel", localizer="match", start=start, observation=observation)
    p, waypoints, plan, _ = options.setup()
    batch = Batch(35, p, waypoints, plan=plan)
    plain = {i: Episode(p, waypoints, seed=i, plan=plan) for i in (0, 33)}
    for _ in in_step(batch, plain, [0.0, -0.5], [1.2, 0.5], 40):
        pass
    for i, episode in plain.items():
        assert episode.world.estimate.scans > 10
        scene = batch.system.surroundings.at(batch.scenes, i)
        np.testing.assert_array_equal(scene.memory.field, episode.scene.memory.field)
        np.testing.assert_array_equal(scene.memory.trail, episode.scene.memory.trail)


def test_evidence_shows_deviations_ahead_and_aside_fit_and_weight_before_the_scan():
    setups = [Options(**IN_OFFICE, localizer="match", start="unknown", observation=name).setup() for name in ("ekf", "located")]
    two, three = (Episode(p, waypoints, seed=4, plan=plan) for p, waypoints, plan, _ in setups)
    assert (two.system.terms, three.system.terms) == (ROOM, LOCATED_ROOM)
    low, high, weights = *np.array(bounds_of(LOCATED_ROOM)), set()
    for _ in range(60):
        shown, estimate = three.observe(), three.world.estimate
        assert shown[:13] + shown[17:] == two.observe()
        c, s = np.cos(estimate.belief.mean.theta), np.sin(estimate.belief.mean.theta)
        axes = np.array([[c, -s], [s, c]])  # ahead and aside, as columns
        P = axes.T @ matrix(estimate.belief.covariance)[:2, :2] @ axes
        deviations = np.minimum(np.sqrt(np.diag(P)), 5.0)
        np.testing.assert_allclose(shown[13:17], [*deviations, estimate.fits, estimate.weight], rtol=1e-9)
        weights.add(estimate.weight)
        assert np.all((low <= shown) & (shown <= high))
        for episode in (two, three):
            episode.act((0.5, 0.3))
    assert {0.0, 1.0} < weights  # lost, in doubt between several places, and sure


def test_scans_keep_the_error_of_the_wheels_from_growing():
    wheels, located = (errors(batch_of(8, localizer, world="office"), 600)[-300:] for localizer in (None, "match"))
    assert np.median(located) < min(0.02, 0.25 * np.median(wheels))


CHANGED = {"beams": 30, "iterations": 1, "wide_steps": 1, "patience": 2, "thin": 2.0, "reach": 2.0, "swing": 2.0}
CHANGED |= {name: 1.0 - getattr(LocalizerTuning(), name) for name in ("short", "suspicion", "temper", "trust")}
"""Others are halved, and 0 becomes large."""


def test_each_assumption_changes_the_belief():
    slipping = ProcessNoise(alpha1=0.3, alpha2=0.05, alpha3=1.0, alpha4=0.3)
    noises = {"along_walk": 0.02, "aside_walk": 0.02, "aside_step": 0.05, "aside_turn": 0.02, "turn_walk": 0.02}
    usual, sought = LocalizerTuning(**noises, widening=20.0, doubt=0.95), {"lead", "trust", "evidence"}

    def believed(tuning, start):
        world = {**asdict(ROOMS["dense"]), "speed": (0.1, 0.3) if start == "known" else (0.0, 0.0)}
        p, waypoints, plan, _ = Options(world=world, noise="wheel", localizer=tuning, start=start).setup()
        batch, beliefs = Batch(2, p._replace(noise=replace(p.noise, process=slipping)), waypoints, plan=plan), []
        batch.seeds[:] = 4
        batch.reset(np.ones(2, np.bool_), *batch.empty())
        for step in range(120):
            batch.step(np.full((2, 2), (0.4, 1.0 if step % 30 < 15 else -1.0), np.float32))
            beliefs.append(batch.world(0).estimate)
        return beliefs

    usually = {start: believed(usual, start) for start in ("known", "unknown")}
    for name, value in asdict(usual).items():
        start = "unknown" if name in sought else "known"  # these count where a place is looked for
        tuning = replace(usual, **{name: CHANGED.get(name, 0.5 * value if value > 0.0 else 1e3)})
        assert believed(tuning, start) != usually[start], name


def test_all_robots_share_the_field_of_a_map():
    grid = GridMap(cells=np.where(hall(), OCCUPIED, FREE), resolution=0.05, origin=(1.0, 2.0, 0.3))
    plan = FloorPlan(walls=grid.walls(), map=grid, max_distance=3.0)
    batch = batch_of(3, world=plan)
    assert batch.scenes.memory.field.shape[0] == 1
    assert errors(batch, 20).max() < 0.05
    np.testing.assert_array_equal(batch.system.surroundings.at(batch.scenes, 2).memory.field, make_room(hall()).field)


@pytest.mark.parametrize(
    ("options", "rule"),
    [
        ({"noise": "wheel"}, "localizer needs the map of a room"),
        ({"world": "office"}, "localizer moves with wheel odometry"),
        ({**IN_OFFICE, "fix": "beacons"}, "localizer and fix exclude each other"),
        ({**IN_OFFICE, "start": "unknown", "localizer": None}, "start is for robots that localize themselves"),
    ],
)
def test_options_that_need_others_are_refused(options, rule):
    with pytest.raises(ValueError, match=rule):
        Options(**{"localizer": "match"} | options).setup()
