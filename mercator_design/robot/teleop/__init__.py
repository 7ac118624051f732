"""A person drives the robot, and the sensors are recorded."""
