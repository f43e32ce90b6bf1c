"""Observations: tuples of named terms, the same from an environment to a robot.

A term is a kernel of a world. The option ``observation`` names the terms that a policy sees, and adds terms of one's own:

    gym.make("turtlebot_gym/TurtleBotRooms-v0", observation="ekf,scan*2,bumper:BUMPER")

Here "ekf" stands for the task's own terms, computed from the filter's pose; "scan*2" replaces its scan by the present one and
the one before; and ``BUMPER`` is a term of the module ``bumper``. Policies name the terms that they read, and bundles carry
them.
"""

from turtlebot_gym.observations.columns import (
    ColumnRun,
    History,
    SceneColumns,
    bounds_of,
    columns_of,
    observing,
    row_of,
    runs_of,
    size_of,
    slices_of,
)
from turtlebot_gym.observations.known import (
    EVIDENCE,
    GOAL,
    LOCATED_ROOM,
    NEAREST,
    NEXT_GOAL,
    OBSERVED,
    OPEN_GROUND,
    ROOM,
    SCAN,
    SCAN_AGE,
    TERMS,
    TRACK_BOUNDS,
    TRACKS,
    TWIST,
    UNCERTAINTY,
    Observation,
    Observed,
    evidence_of,
    goal_from,
    next_goal_from,
    observe,
    observed_state,
    stated_deviations,
    twist_of,
    uncertainty_of,
)
from turtlebot_gym.observations.reading import own_term, read_items, read_terms
from turtlebot_gym.observations.term import SOURCE, ObservationTerm
