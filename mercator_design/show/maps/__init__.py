"""Maps of swarms as files for people and other programs."""
