"""Trees in words: what a tree does, and how two of them differ."""
