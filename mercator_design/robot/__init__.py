"""The robot: what its devices say on their serial lines, and how it runs control software.

    framing     frames in a stream of bytes
    rvr         the Sphero RVR: frames, commands, responses, notifications; rvr_messages, rvr_streaming: its tables
    ydlidar     the YDLIDAR X4
    multiflex   the Teraranger Hub Multiflex
    ports       the serial ports: finding and opening them
    settings    what is particular to one robot: robot.yaml
    settings_file  changes to it, at their place
    talk        what the devices are told and asked, and what is heard meanwhile
    start       what each device is told before it is of use, and to be at rest again
    samples     measurements of the RVR and the hub, with axes and units converted
    sweep       the lidar's last turn
    health      how much of each line arrives whole; battery and motors
    senses      what the robot perceives, from what its devices tell
    mercator    the robot as one object: its senses, wheels, lamps
    safety      what keeps the wheels from turning when nobody is in control of them
    swarm       what is told to all robots
    log         what happened in a run, and the same decisions again
    log_events  what the events of logs and recordings must be
    recording   what sensors measure, as it comes
    control     a robot that somebody has control of
    joint       when a run begins: at once, or with other robots
    channel     lines that another program says over the standard input
    runner      a run
    keyboard    keys and status at a terminal
    teleop      a person drives
    person      who does what the robot cannot
    ground_calibration     labels
    proximity_calibration  which sensor looks where, and offsets
    findings    how things are with a robot, one by one
    check       what may be wrong
    rest        a robot brought to rest, whatever drove it
    install     what the system knows of the robot: udev rules and systemd's services
    service     what systemd hears of a run
    ros         a node of ROS 1; ros_messages: what its topics carry
    cli         the command mercator-robot

framing, rvr, ydlidar and multiflex do no input or output: bytes in, events out, commands to bytes; both ends of each
line from one definition, on the standard library alone. The others also need pyserial, PyYAML and click.
"""
