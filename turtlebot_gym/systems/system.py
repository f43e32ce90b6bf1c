"""A system: the kernels of one step, and the step assembled from them.

    move -> sense -> estimate -> look -> judge -> reward -> renew -> observe

"Look" works on the surroundings in arrays, a scene: ranges and collisions. Open ground has none, and its step runs without
branches for a whole tile of environments; in rooms what follows "estimate" runs one by one. A filter that reads the scan
estimates after the robot has looked.

What changes the *types* of a step (another sensor, filter or plant) is a kernel of a `System`; numbers are in `Parameters`.
The step runs with the same kernels as plain Python and in a compiled loop (`turtlebot_gym.compiled`), bit-identically.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

from turtlebot_gym.kernel import kernel
from turtlebot_gym.observations import EVIDENCE, SCAN_AGE, ObservationTerm
from turtlebot_gym.rewards import RewardTerm
from turtlebot_gym.systems.sensors import Sensor
from turtlebot_gym.systems.world import Course
from turtlebot_gym.values import Pose

LOCALIZER = "a localizer: choose one, such as localizer='match'"
"""What a robot needs that localizes itself ..."""
ROOM = "a room: choose one with world=..., such as world='office'"
"""... and that sees something around it."""


class RoomParts(NamedTuple):
    """The parts of a step that work on arrays; they update a scene's arrays in place."""

    make: Callable[..., Any]
    """``make(parameters)`` returns the scenes of as many environments as there are parameters: a NamedTuple of arrays."""
    at: Callable[..., Any]
    """``at(scenes, index)`` returns the scene of one environment."""
    first_look: Callable[..., Any]
    """``first_look(world, key, p, scene)`` returns `Snapshot.room` at the start."""
    look: Callable[..., Any]
    """``look(world, key, p, scene)`` moves what moves in the scene, measures ranges, and returns the new `Snapshot.room`."""
    renew: Callable[..., Any] = kernel(lambda world, outcome, key, p, scene: (world, outcome))
    """``renew(world, outcome, key, p, scene)`` ends a step in which a goal was reached: it returns world and outcome, in
    missions with the next goal."""


NOWHERE = RoomParts(
    make=lambda parameters: (),
    at=kernel(lambda scenes, index: ()),
    first_look=kernel(lambda world, key, p, scene: ()),
    look=kernel(lambda world, key, p, scene: ()),
)
"""What stands for surroundings on open ground."""


class System(NamedTuple):
    """The parts of a step. ``p`` is `systems.parameters.Parameters`; ``key`` and ``at`` number the noise of a step."""

    lay_out: Callable[..., Any]
    """``lay_out(key, p, scene)`` returns the start pose of an episode, and the goal, which is the first waypoint if the task
    draws one."""
    start: Callable[..., Any]
    """``start(pose)`` returns the body at the start of an episode."""
    move: Callable[..., Any]
    """``move(body, command, key, at, p)`` returns the body after a control interval: action, limits, delay, plant, slip."""
    sensors: tuple[Sensor, ...]
    """The robot's sensors; their values are the senses, a NamedTuple with a field for each."""
    first_estimate: Callable[..., Any]
    """``first_estimate(senses, p)`` returns the filter's estimate at the start."""
    estimate: Callable[..., Any]
    """``estimate(estimate, before, senses, p)`` returns the filter's estimate after a step; with `reads_scan`,
    ``estimate(estimate, before, senses, p, room, scene)``."""
    judge: Callable[..., Any]
    """``judge(world, after, waypoints, p)`` returns the waypoints visited and the `Outcome`, without its reward, of a step that
    led from ``world`` to ``after``, whose course is still that before; ``waypoints`` is their number."""
    rewards: tuple[RewardTerm, ...]
    """The terms of the reward; their weights are `Parameters.reward`."""
    terms: tuple[ObservationTerm, ...]
    """The terms of the observation."""
    example: Any
    """Example parameters with the types that the kernels take, but for the reward's weights."""
    surroundings: RoomParts = NOWHERE
    """What a robot in a room has besides; on open ground a scene is an empty tuple."""
    reads_scan: bool = False
    """Whether the filter reads the scan, and estimates after the robot has looked."""
    compiled: bool = True
    """Whether all parts are kernels; if one is not, such as a filter in plain Python, the loop runs as plain Python too."""

    @property
    def in_room(self) -> bool:
        """Whether there is a room around the robot."""
        return self.surroundings is not NOWHERE

    def with_sensor(self, sensor: Sensor) -> System:
        """Return the system with a further sensor, or another of its name."""
        sensors = {other.name: other for other in self.sensors} | {sensor.name: sensor}
        example = self.example if sensor.noise is None else self.example._replace(**{sensor.name: sensor.noise})
        return self._replace(sensors=tuple(sensors.values()), example=example)

    def with_rewards(self, *terms: RewardTerm) -> System:
        """Return the system with further terms of the reward; a ``ValueError`` if it has a term of that name."""
        names = [term.name for term in (*self.rewards, *terms)]
        for name in names:
            if names.count(name) > 1:
                raise ValueError(f"the reward has a term {name!r} already: give yours another name.")
        return self._replace(rewards=(*self.rewards, *terms))

    def with_observation(self, *terms: ObservationTerm) -> System:
        """Return the system with another observation, and the sensors that its terms read.

        A ``ValueError`` refuses a term that needs a scan, a localizer or another sensor than the system has.
        """
        system = self._replace(terms=terms)
        for term in terms:
            lacks_scan = not self.in_room and (term.in_scene or term.name == SCAN_AGE.name)
            if lacks_scan or (term.name == EVIDENCE.name and not self.example.localizer):
                raise ValueError(f"observation {term.name!r} needs {ROOM if lacks_scan else LOCALIZER}.")
            if term.sensor:
                if any(other.name == term.sensor.name and other != term.sensor for other in system.sensors):
                    raise ValueError(f"the robot has another sensor {term.sensor.name!r}: give yours another name.")
                system = system.with_sensor(term.sensor)
        return system


@kernel
def course_after(visited: float, waypoints: Any, laps: float) -> Course:
    """Return the course after so many waypoints and rounds; the last waypoint stays."""
    last = len(waypoints) * laps - 1.0
    now = waypoints[int(min(visited, last)) % len(waypoints)]
    then = waypoints[int(min(visited + 1.0, last)) % len(waypoints)]
    return Course(Pose(now[0], now[1], now[2]), Pose(then[0], then[1], then[2]), visited)
