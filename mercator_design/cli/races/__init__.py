"""The verbs that race: race, tune, runs."""
