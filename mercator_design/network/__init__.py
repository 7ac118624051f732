"""Neural networks as control software, of AutoMoDe's EvoStick and of NEAT.

    inputs    readings -> the numbers that a network gets
    network   nodes and genes, what makes them valid, and their tables for the kernels
    control   the control cycle
    genome    files of genomes
    text      a network as one line
    space     the weights as parameters of a race
    words     what a network does

Plain Python on the standard library, as it runs on the robot; the simulator compiles the same functions.
"""
