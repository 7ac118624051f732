"""Plugins: a user's own behaviours, conditions, flavours, objectives and floor dynamics.

    sources     what a plugin is: its files
    importing   imports modules from the sources that were read
    registries  the tables in which plugins enter what they define
    loading     runs plugins
    marks       checks what is given to the marks of modules
    places      lines of plugins in errors

Plain Python on the standard library, as robots load plugins, too.
"""
