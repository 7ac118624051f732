"""Automatic design of control software for swarms of Mercator robots."""

__version__ = "0.1.0"
