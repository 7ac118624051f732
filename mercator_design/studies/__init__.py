"""Studies: comparisons of design methods over missions and repetitions, of which a design is the unit."""
