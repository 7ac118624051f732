"""Software modules: what a robot perceives and does, of which control software of every architecture is made.

    reference   what a module may know and set
    perception, clustering   sensor values -> readings
    module      what a module is
    behaviours, conditions   the modules
    words       modules in words

Plain Python on the standard library, as it runs on the robot; the simulator compiles the same functions.
"""
