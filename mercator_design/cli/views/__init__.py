"""Verbs that show experiments."""
