"""A robot that localizes itself: the same compiled and in plain Python, and much nearer to the truth than its wheels."""

from dataclasses import asdict, fields, replace

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

HALL = FloorPlan(walls=(0.0, 0.0, 2.5, 2.0), boxes=((0.5, 0.5, 1.0, 0.3, 0.4),), start=Pose(-1.5, -1.0, 0.3))


def errors(batch, steps, drives):
    """Drive with random commands, and return the errors of the position, m, shape (steps, N)."""
    rng, off = np.random.default_rng(0), []
    batch.seeds[:] = np.arange(drives)
    batch.reset(np.ones(drives, np.bool_), *batch.empty())
    for step in range(steps):
        if step % 10 == 0:
            actions = rng.uniform([0.0, -0.5], [0.6, 0.5], (drives, 2)).astype(np.float32)
        batch.step(actions)
        off.append(difference(batch.numbers("estimate.belief.mean"), batch.numbers("body.true_state"))[:, :2])
    return np.hypot(*np.moveaxis(off, 2, 0))


@pytest.mark.sample(1)
@pytest.mark.parametrize(
    ("world", "lidar", "start", "observation"),
    [
        ("office", "lds01", "known", "ekf"),
        ("crowd", "a1", "unknown", "located"),
        (HALL, "urg04lx", "known", "located"),
        ({"unmapped": 0.5, "vanished": 0.5, "map_error": 0.1}, "ideal", "unknown", "ekf"),
    ],
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
    options = {"world": "office", "noise": "wheel", "localizer": "match", "start": "unknown"}
    episodes = []
    for observation in ("ekf", "located"):
        p, waypoints, plan, _ = Options(**options, observation=observation).setup()
        episodes.append(Episode(p, waypoints, seed=4, plan=plan))
    two, three = episodes
    assert (two.system.terms, three.system.terms) == (ROOM, LOCATED_ROOM)
    low, high = np.array(bounds_of(LOCATED_ROOM))
    assert low.shape == high.shape == (54,)
    weights = set()
    for _ in range(60):
        shown = three.observe()
        assert shown[:13] + shown[17:] == two.observe()
        estimate = three.world.estimate
        axes = rotation(estimate.belief.mean.theta)
        P = axes.T @ matrix(estimate.belief.covariance)[:2, :2] @ axes
        deviations = np.minimum(np.sqrt(np.diag(P)), 5.0)
        np.testing.assert_allclose(shown[13:17], [*deviations, estimate.fits, estimate.weight], rtol=1e-9)
        weights.add(estimate.weight)
        assert np.all((low <= shown) & (shown <= high))
        for episode in episodes:
            episode.act((0.5, 0.3))
    assert {0.0, 1.0} < weights  # lost, in doubt between several places, and sure


def rotation(angle):
    """Return the axes ahead and aside, as columns."""
    return np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])


def test_scans_keep_the_error_of_the_wheels_from_growing():
    off = {}
    for localizer in (None, "match"):
        p, waypoints, _, _ = Options(world="office", noise="wheel", localizer=localizer).setup()
        off[localizer] = errors(Batch(8, p, waypoints), 600, 8)
    assert np.median(off["match"][-300:]) < min(0.02, 0.25 * np.median(off[None][-300:]))


@pytest.mark.parametrize("world", ["dense", "office"])
def test_obstacles_that_the_map_alone_has_hide_none_of_the_room_and_mislead_little(world):
    fields, rooms, off = [], [], []
    for share in (0.0, 0.3, 1.0):
        p, waypoints, _, _ = Options(
            world={**asdict(ROOMS[world]), "vanished": share}, noise="wheel", localizer="match"
        ).setup()
        batch = Batch(16, p, waypoints)
        off.append(np.median(errors(batch, 300, 16)))
        fields.append(batch.scenes.memory.field)
        rooms.append((batch.scenes.room.circles, batch.scenes.room.boxes))
    np.testing.assert_equal(rooms[1:], rooms[:1] * 2)
    assert np.all(np.diff(fields, axis=0) <= 0.0)
    assert 0.0 < np.mean(fields[1] < fields[0]) < np.mean(fields[2] < fields[0])
    assert off[1] < 0.01


CHANGED = {
    "beams": 30,
    "deviation": 0.05,
    "deviation_share": 0.03,
    "scale": 0.01,
    "grain": 0.03,
    "bias": 0.01,
    "turn_bias": 0.01,
    "length": 0.2,
    "angle": 0.3,
    "gate": 2.0,
    "iterations": 1,
    "wide_steps": 1,
    "thin": 2.0,
    "along_walk": 0.05,
    "along_step": 0.4,
    "aside_walk": 0.05,
    "aside_step": 0.2,
    "aside_turn": 0.2,
    "turn_walk": 0.1,
    "turn_step": 0.5,
    "widening": 2.0,
    "usual": 0.3,
    "memory": 0.2,
    "near": 0.05,
    "doubt": 0.0,
    "short": 0.25,
    "suspicion": 0.5,
    "reach": 0.3,
    "swing": 0.3,
    "temper": 1.0,
    "loosen": 0.2,
    "lead": 1e3,
    "trust": 1.0,
    "evidence": 1e3,
    "patience": 2,
}


def test_each_assumption_changes_the_belief():
    slipping = ProcessNoise(alpha1=0.3, alpha2=0.05, alpha3=1.0, alpha4=0.3)
    usual = LocalizerTuning(
        along_walk=0.02, aside_walk=0.02, aside_step=0.05, aside_turn=0.02, turn_walk=0.02, widening=20.0, doubt=0.95
    )

    def believed(tuning, start="known"):
        world = {**asdict(ROOMS["dense"]), "unmapped": 0.5 if start == "known" else 0.0}
        options = Options(world=world, noise="wheel", localizer=tuning, start=start)
        p, waypoints, plan, _ = options.setup()
        batch, beliefs = Batch(2, p._replace(noise=replace(p.noise, process=slipping)), waypoints, plan=plan), []
        batch.seeds[:] = 4
        batch.reset(np.ones(2, np.bool_), *batch.empty())
        for step in range(120):
            batch.step(np.full((2, 2), (0.4, 1.0 if step % 30 < 15 else -1.0), np.float32))
            beliefs.append(batch.world(0).estimate)
        return beliefs

    usually, lost = believed(usual), believed(usual, "unknown")
    assert CHANGED.keys() == {field.name for field in fields(LocalizerTuning)}
    changed = {name: replace(usual, **{name: value}) for name, value in CHANGED.items()}
    sought = {"lead", "trust", "evidence"}  # they count where a place is looked for
    assert not [name for name, tuning in changed.items() if name not in sought and believed(tuning) == usually]
    assert not [name for name in sought if believed(changed[name], "unknown") == lost]


def test_all_robots_share_the_field_of_a_map():
    grid = GridMap(cells=np.where(hall(), OCCUPIED, FREE), resolution=0.05, origin=(1.0, 2.0, 0.3))
    plan = FloorPlan(walls=grid.walls(), map=grid, max_distance=3.0)
    p, waypoints, plan, _ = Options(world=plan, noise="wheel", localizer="match").setup()
    batch = Batch(3, p, waypoints, plan=plan)
    batch.reset(np.ones(3, np.bool_), *batch.empty())
    batch.step(np.zeros((3, 2), np.float32))
    assert batch.scenes.memory.field.shape[0] == 1
    np.testing.assert_array_equal(batch.system.surroundings.at(batch.scenes, 2).memory.field, make_room(hall()).field)
    assert errors(batch, 20, 3).max() < 0.05


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"localizer": "match", "noise": "wheel"}, "localizer needs the map of a room: choose one with world="),
        ({"localizer": "match", "world": "office"}, "localizer moves with wheel odometry: choose such a noise"),
        ({"localizer": "match", "world": "office", "noise": "wheel", "fix": "beacons"}, "localizer and fix exclude each other"),
        ({"localizer": "amcl", "world": "office", "noise": "wheel"}, "localizer must be one of 'match', 'robot'"),
        (
            {"observation": "located", "world": "office", "noise": "wheel"},
            "observation 'located' needs a localizer: choose one",
        ),
        ({"start": "unknown", "world": "office", "noise": "wheel"}, "start is for robots that localize themselves"),
        ({"localizer": {"grain": 0.0}, "world": "office", "noise": "wheel"}, r"LocalizerTuning\.grain must be"),
    ],
)
def test_invalid_options_are_refused(options, message):
    with pytest.raises(ValueError, match=message):
        Options(**options).setup()
