"""Executors run experiments: in threads, in processes, or on a cluster."""
