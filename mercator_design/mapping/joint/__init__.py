"""The joint refinement: all keyframes of all robots in one frame, by their points, odometry and sightings."""
