"""Runs and records experiments: the runner, the journal with its events, and tests of the winner."""
