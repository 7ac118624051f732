"""Protocols without input, output or clock: the three devices' bytes, and the lines of a joint start."""
