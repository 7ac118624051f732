"""Protocols without input, output or clock: the bytes of the three devices, and the lines of a joint start."""
