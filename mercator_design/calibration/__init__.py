"""Noise of a robot's sensors, measured from recordings of the robot at rest.

scenes    recordings, cut where the robot was moved
noise     distributions fitted to rounded measurements
sensors   the sensors of a robot model: selection of their measurements, and their noise
"""
