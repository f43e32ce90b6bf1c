"""Subcommands of ``turtlebot-gym`` about recordings, filters and the course."""
