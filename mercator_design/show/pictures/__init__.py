"""Pictures, plots and films, drawn by matplotlib."""
