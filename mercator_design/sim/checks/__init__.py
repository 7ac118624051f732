"""Checks of a mission before it runs: unreachable zones, constant scores, conditions that never fire."""
