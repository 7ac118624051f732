"""A node of ROS 1 in the place of the robot's original nodes."""
