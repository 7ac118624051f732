"""What is asked of a swarm: where (arena, floor), from where (placement), and what counts (objectives)."""
