"""Figures of merit of maps and trajectories where the truth is known."""
