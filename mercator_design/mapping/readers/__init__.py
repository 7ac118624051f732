"""Readers: logs of robots, of simulations and of other programs become `RobotLog`s."""
