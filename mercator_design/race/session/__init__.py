"""Experiments are run and recorded: the runner, the journal with its events, and tests of the winner."""
