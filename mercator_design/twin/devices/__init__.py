"""The twin of each device: bytes of commands in, bytes of answers and measurements out."""
