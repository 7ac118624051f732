"""The robot: what its devices say on their serial lines, and how it runs control software.

The rooms, from the bottom up:

    protocols/  bytes in, events out, commands to bytes; without input, output or clock
    devices/    ports, settings, starting, measurements, health of lines
    logs/       what happened in a run, and the same decisions again
    run/        a controller on the robot: senses in, wheels out, motors stopped on every way out
    teleop/     a person drives; recordings
    ros/        a node of ROS 1
    setup/      installation, checks, calibration
    cli/        the command mercator-robot

The protocols run on the standard library alone. The others also need pyserial, PyYAML and click.
"""
