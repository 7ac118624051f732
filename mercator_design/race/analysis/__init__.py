"""Analyses of the parameters of a finished race: importance and ablation."""
