"""Loop closures: places that a robot comes back to, and the pose graph that makes them agree."""
