"""Pages and pictures of experiments and races."""
