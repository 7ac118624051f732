"""The robot: the protocols of its devices, and how it runs control software.

The rooms, from the bottom up:

    protocols/  bytes in, events out, commands to bytes; without input, output or clock
    devices/    ports, settings, start-up, measurements, health of lines
    logs/       logs of runs and recordings; replay of a run's decisions
    run/        a controller on the robot: senses in, wheels out, motors stopped on every way out
    teleop/     driving from a terminal; recordings
    ros/        a node of ROS 1
    setup/      installation, checks, calibration
    cli/        the command mercator-robot

The protocols run on the standard library alone. The others also need pyserial, PyYAML and click.
"""
