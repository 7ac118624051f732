"""The robot: what its devices say on their serial lines.

    framing     frames in a stream of bytes
    rvr         the Sphero RVR: frames, commands, responses, notifications; rvr_messages, rvr_streaming: its tables
    ydlidar     the YDLIDAR X4
    multiflex   the Teraranger Hub Multiflex
    ports       the serial ports: finding and opening them

All but the last do no input or output: bytes in, events out, commands to bytes; both ends of each line from one
definition. Plain Python on the standard library; ports also needs pyserial and PyYAML.
"""
