"""The faults to inject into a robot's chain, by name.

Each begins with a driving robot, and returns the number of unsafe motions besides those that were later than 0.6 s after the
newest measurement: motions after a stop that a person has not ended, or towards a wall inside the stopping zone.
"""

from __future__ import annotations

import math
import signal

import faults_processes as processes
import faults_sensors as sensors
from faults_robot import Fault

WITH_BUTTONS: dict[str, Fault] = {
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
WITHOUT_BUTTONS: dict[str, Fault] = {
    "odometry late": sensors.odometry_late,
    "odometry in a burst": sensors.odometry_burst,
    "odometry dead": sensors.odometry_dies,
    "odometry repeated": sensors.odometry_repeats,
    "odometry impossible": sensors.odometry_impossible,
    "scans late": sensors.scan_late,
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
    "flood on cmd_vel_in": processes.flooded("cmd_vel_in", "TwistStamped"),
    "flood on cmd_vel_teleop": processes.flooded("cmd_vel_teleop", "TwistStamped"),
    "flood on scan": processes.flooded("scan", "LaserScan"),
    "flood on odom": processes.flooded("odom", "Odometry"),
    "flood on estimate": processes.flooded("estimate", "Odometry"),
    "flood on reference": processes.flooded("reference", "PoseStamped"),
    "flood on pose_fix": processes.flooded("pose_fix", "PoseWithCovarianceStamped"),
    "flood on another topic": processes.flood_elsewhere,
    "clock offset": sensors.clocks("offset"),
    "clock set": sensors.clocks("step"),
    "clock drifts": sensors.clocks("drift"),
    "LiDAR frozen": sensors.lidar_frozen,
    "LiDAR covered": sensors.lidar(sensors.filled(math.nan)),
    "LiDAR all zero": sensors.lidar(sensors.filled(0.0)),
    "LiDAR all infinite": sensors.lidar(sensors.filled(math.inf)),
    "LiDAR turned by 180 degrees": sensors.lidar(sensors.turned),
    "LiDAR of four beams": sensors.lidar(sensors.four_beams),
    "wrong fix": sensors.wrong_fix,
    "two odometries": sensors.two_odometries,
    "commands with old stamps": processes.old_stamp,
    "commands that are nonsense": processes.nonsense,
    "guard disabled": processes.disabled,
}
FAULTS = {**WITHOUT_BUTTONS, **WITH_BUTTONS}
