"""The verbs for robots: models, noise calibration, the program as one file, deployment."""
