"""Experiments: a mission, robots and a seed become a score and a trace.

simulate     one experiment, the way in
robot_model  a robot's body, drive, sensors and noise, from a YAML file
world        the starting situation of a seed
staging      the part that is equal in all instances, as numbers for the kernels
labels       which colours robots distinguish
devices      what devices measured, computed after an experiment
kernels/     the compiled code
checks/      warnings on a mission before anything runs
"""
