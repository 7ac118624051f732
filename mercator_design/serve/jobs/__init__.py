"""Jobs: each designs control software for a mission, by one race in one run folder."""
