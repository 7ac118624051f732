"""The twin: simulated robots on serial lines, in a simulated arena; programs need not know that they are simulated.

    rvr         the Sphero RVR, with drive (its treads) and senses (measurements and streams)
    lidar       the YDLIDAR X4
    hub         the Teraranger Hub Multiflex
    arena       motion of the robots and measurements of their devices, by the simulator's code
    faults      faults, by a script
    twin        the robots of an arena, with their devices, faults and log
    terminals   pseudo-terminals, and the loop that keeps time
    folder      the folder of a twin, and its log
    cli         the verb `twin`

Devices and robots do no input or output: bytes in, bytes out, and the time is an argument [s].
"""
