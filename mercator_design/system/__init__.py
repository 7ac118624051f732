"""What the operating system gives: files, memory, signals, and the cache of machine code."""
