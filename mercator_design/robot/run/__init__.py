"""Run a controller on the robot: read senses, drive wheels, and stop the motors on every way out."""
