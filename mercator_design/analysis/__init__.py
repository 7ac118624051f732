"""What can be learned of a finished race: importance of modules, ablation, and what its winner needs."""
