"""Experiments are run and recorded: executors, the runner, the journal with its events, and tests of the winner."""
