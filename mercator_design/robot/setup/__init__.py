"""Before a robot runs: installation, checks and calibration."""
