"""Drive the robot from a terminal; record the sensors."""
