"""Experiments to be shown, as values: simulated now, read from traces, or put together from the logs of robots."""
