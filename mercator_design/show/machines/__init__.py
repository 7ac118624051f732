"""PFSMs as diagrams, and in the notations of other programs."""
