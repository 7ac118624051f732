"""Pictures: missions from above, PFSMs as diagrams."""
