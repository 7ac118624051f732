"""All PFSMs of a flavour as a space of parameters, and moves from one PFSM to the next."""
