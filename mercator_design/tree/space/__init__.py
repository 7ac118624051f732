"""All trees of a flavour as a space of parameters, and moves from one tree to the next."""
