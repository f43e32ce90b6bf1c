"""Guard, standby, emergency stop and collision monitor for any robot that takes ``cmd_vel``."""

__version__ = "0.2.0"
