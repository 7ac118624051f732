"""Verbs of `mdesign fsm`."""
