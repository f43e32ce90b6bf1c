"""The faults to inject into a robot's chain, by name and group.

Each begins with a driving robot, and returns why what happened was unsafe, besides what the judge finds after every fault:
motion without a fresh measurement, contact, and nodes that have ended.
"""

from __future__ import annotations

import math
import signal

import faults_ends as ends
import faults_liars as liars
import faults_motions as motions
import faults_processes as processes
import faults_sensors as sensors
import faults_silence as silence
import faults_walls as walls
from faults_lies import FROM_THE_START, FROM_THEN_ON
from faults_robot import Fault

BUTTONS: dict[str, Fault] = {
    "filter suspended, button pressed": processes.suspended_pressed("kalman_filter"),
    "controller suspended, button pressed": processes.suspended_pressed("velocity_controller"),
    "guard suspended, button pressed": processes.suspended_pressed("cmd_vel_guard"),
    "short press": processes.short_press,
    "press lost by a radio": processes.button_lost,
    "one of two buttons held": processes.two_buttons,
    "one of two buttons silent": processes.button_dies,
    "button restarted": processes.button_restarts,
    "flood on emergency_stop": processes.flooded("emergency_stop", "Bool"),
}
MEASUREMENTS: dict[str, Fault] = {
    "odometry late": sensors.odometry_late,
    "odometry in a burst": sensors.odometry_burst,
    "odometry dead": sensors.odometry_dies,
    "odometry repeated": sensors.odometry_repeats,
    "odometry impossible": sensors.odometry_impossible,
    "two odometries": sensors.two_odometries,
    "clock offset": sensors.clocks("offset"),
    "clock set": sensors.clocks("step"),
    "clock drifts": sensors.clocks("drift"),
    "stamps rolled over": sensors.rolled_over,
    "wrong fix": sensors.wrong_fix,
    "hostile variances": sensors.hostile_variances,
    "a stranger's estimate": sensors.stranger(filter_ends=False),
    "a stranger's estimate after the filter": sensors.stranger(filter_ends=True),
    "second source of waypoints": sensors.second_waypoints,
}
PROCESSES: dict[str, Fault] = {
    "filter suspended, sources die": processes.suspended("kalman_filter", dies=True),
    "filter suspended, sources live": processes.suspended("kalman_filter", dies=False),
    "controller suspended, sources die": processes.suspended("velocity_controller", dies=True),
    "controller suspended, sources live": processes.suspended("velocity_controller", dies=False),
    "guard suspended, sources die": processes.guard_suspended_sources_die,
    "guard suspended, sources live": processes.suspended("cmd_vel_guard", dies=False),
    "guard killed": processes.guard_ends(signal.SIGKILL),
    "guard hangs": processes.guard_ends(signal.SIGSTOP),
    "guard restarted": processes.guard_restarts,
    "standby killed or hung": processes.standby_ends,
    "guard disabled": processes.disabled,
    "policy raises an exit": ends.policy("SystemExit", "KeyboardInterrupt", "GeneratorExit"),
    "policy hangs": ends.policy("hang"),
}
MOTIONS: dict[str, Fault] = {
    **{
        f"{what} ends, robot {verb}": motions.ends(name, motion)
        for verb, motion in (("reverses", motions.reverses), ("turns", motions.turns))
        for what, name in (
            ("guard", "cmd_vel_guard"),
            ("standby", "cmd_vel_standby"),
            ("filter", "kalman_filter"),
            ("controller", "velocity_controller"),
            ("odometry", "odometry"),
            ("sticks", "sticks"),
        )
    },
    "filter ends, fence by its estimate": motions.fence_without_filter,
}
FLOODS: dict[str, Fault] = {
    "flood on cmd_vel_in": processes.flooded("cmd_vel_in", "TwistStamped"),
    "flood on cmd_vel_teleop": processes.flooded("cmd_vel_teleop", "TwistStamped"),
    "flood on scan": processes.flooded("scan", "LaserScan"),
    "flood on odom": processes.flooded("odom", "Odometry"),
    "flood on estimate": processes.flooded("estimate", "Odometry"),
    "flood on reference": processes.flooded("reference", "PoseStamped"),
    "flood on pose_fix": processes.flooded("pose_fix", "PoseWithCovarianceStamped"),
    "flood on another topic": processes.flood_elsewhere,
    "commands with old stamps": processes.old_stamp,
    "commands that are nonsense": processes.nonsense,
    "guard hears itself": ends.own_output,
}
ENDS: dict[str, Fault] = {
    "terminal closed": ends.terminal(lambda window: window.close()),
    "Ctrl-C": ends.terminal(lambda window: window.press("C")),
    "Ctrl-Z": ends.terminal(lambda window: window.press("Z")),
    "Ctrl-\\": ends.terminal(lambda window: window.press("\\")),
    "guard and standby hung up": ends.signalled([signal.SIGHUP]),
    "guard and standby ended by a signal": ends.signalled(ends.ENDING),
    "guard and standby suspended by a signal": ends.signalled(ends.SUSPENDING),
    "computer's clock set back": ends.clock_set(-0.775, -2.0, -30.0, -3600.0),
    "computer's clock set ahead": ends.clock_set(0.775, 2.0, 30.0, 3600.0),
}
LIARS: dict[str, Fault] = {
    **{name: liars.lies(name, maker, from_the_start=False) for name, maker in FROM_THEN_ON.items()},
    **{name: liars.lies(name, maker, from_the_start=True) for name, maker in FROM_THE_START.items()},
    **{
        f"pose and twist frozen, a person {verb}": liars.lies(
            "by hand", FROM_THEN_ON["pose and twist frozen"], from_the_start=False, by_hand=command
        )
        for verb, command in (("drives", (0.15, 0.0)), ("reverses", (-0.15, 0.0)), ("turns", (0.0, 1.0)))
    },
    "robot turns the other way": liars.wheels(liars.other_way, turning=True),
    "robot blocked": liars.wheels(liars.blocked, turning=False),
    "robot blocked, a person drives": liars.wheels(liars.blocked, turning=False, by_hand=True),
    "wheels spin": liars.spinning,
    "fence ahead": liars.fence,
    "pose and twist frozen at a fence": liars.frozen_at_a_fence(FROM_THEN_ON["pose and twist frozen"]),
}
WALLS: dict[str, Fault] = {
    "healthy wall": walls.healthy,
    "healthy wall behind": walls.healthy_behind,
    "scans end": walls.ends,
    "scans late": walls.late,
    "scans late with fresh stamps": walls.late_with_fresh_stamps,
    "second source of scans": walls.second_source,
    "LiDAR frozen": walls.frozen(0.0),
    "LiDAR frozen, with noise": walls.frozen(0.005),
    "LiDAR covered": walls.lidar(walls.filled(math.nan)),
    "LiDAR all zero": walls.lidar(walls.filled(0.0)),
    "LiDAR all infinite": walls.lidar(walls.filled(math.inf)),
    "LiDAR turned by 180 degrees": walls.lidar(walls.turned),
    "LiDAR upside down": walls.upside_down,
    "LiDAR in another unit": walls.in_another_unit,
    "LiDAR of another frame": walls.lidar(walls.another_frame),
    "LiDAR of four beams": walls.lidar(walls.beams(4)),
    "post between beams": walls.post_between_beams,
    "LiDAR that sees only behind": walls.partial(math.pi, math.radians(120.0)),
    "LiDAR that sees only the left": walls.partial(0.5 * math.pi, math.radians(120.0)),
    "LiDAR that sees only the right": walls.partial(-0.5 * math.pi, math.radians(120.0)),
    "LiDAR that sees only ahead": walls.ahead_only,
    "LiDAR silent ahead": silence.silent_ahead,
    "LiDAR silent on the left": silence.silent_beside(1.0),
    "LiDAR silent on the right": silence.silent_beside(-1.0),
    "LiDAR silent now and then": silence.silent_now_and_then,
    "LiDAR frozen ahead": silence.frozen_ahead,
}
GROUPS = {
    "buttons": BUTTONS,
    "measurements": MEASUREMENTS,
    "processes": PROCESSES,
    "motions": MOTIONS,
    "floods": FLOODS,
    "ends": ENDS,
    "liars": LIARS,
    "walls": WALLS,
}
FAULTS = {name: fault for kinds in GROUPS.values() for name, fault in kinds.items()}
