"""Subcommands of ``turtlebot-gym`` about recordings and filters."""
