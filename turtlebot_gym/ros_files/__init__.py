"""Robots and noise from files of other programs: URDF, Nav2's parameters, and those of robot_localization."""
