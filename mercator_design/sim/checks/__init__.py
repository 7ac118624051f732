"""What is wrong with a mission before anything runs: what cannot be reached, cannot score, or never fires."""
