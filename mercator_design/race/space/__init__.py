"""Spaces: parameters with their domains and conditions, and the expressions in these."""
