"""The twin: robots at the other end of their serial lines, in a simulated arena, for programs that cannot tell.

    rvr         the Sphero RVR, with drive (what its treads do) and senses (what it measures and streams)
    lidar       the YDLIDAR X4
    hub         the Teraranger Hub Multiflex
    pace        when what happens again and again is due
    arena       where the robots move, and what their devices measure, by the simulator's code
    faults      what goes wrong, by a script
    twin        the robots of an arena, with their devices and faults, and what is logged of them
    terminals   pseudo-terminals, and the loop that keeps time
    folder      where a twin is whose user names no folder
    cli         the verb `twin`

Devices and robots do no input or output: bytes in, bytes out, and the time is an argument [s].
"""
