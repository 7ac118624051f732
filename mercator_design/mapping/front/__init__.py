"""The front end: from turns of a lidar and odometry to poses and keyframes."""
