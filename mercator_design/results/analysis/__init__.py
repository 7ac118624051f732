"""Analysis of a finished race: importance of modules, ablation, and the parts that its winner needs."""
