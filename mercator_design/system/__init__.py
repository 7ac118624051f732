"""The operating system: files, memory, signals, and the cache of machine code."""
