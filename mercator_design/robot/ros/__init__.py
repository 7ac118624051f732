"""A node of ROS 1 that replaces the robot's original nodes."""
