"""A controller runs on the robot: senses in, wheels out, and the motors stopped on every way out."""
