"""New configurations: even first samples, irace's sampling model, moves, and proposals of a surrogate."""
