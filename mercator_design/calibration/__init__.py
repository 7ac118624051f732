"""Noise of a robot's sensors, measured from recordings of the robot at rest.

scenes    recordings, cut where the robot was moved
noise     distributions fitted to measurements that are rounded
sensors   each sensor of a robot model: what of its measurements counts, and the noise that fits them
"""
