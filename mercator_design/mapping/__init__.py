"""Maps from the lidars and odometries of robots, made after the run."""
