"""Logs of runs and recordings: their events, written and read."""
